"""Drawing a scene: a recipe becomes dimensions, poses, materials, objects and light.

Every continuous factor is a point of a sequence of its own, keyed by names (see `streams`), so
adding a scene or a factor moves no other.
"""

from __future__ import annotations

from contextlib import suppress

import numpy as np
from jaxtyping import Float

from cornerscenes import board, cuboid
from cornerscenes import room as rooms
from cornerscenes.camera import (
    Camera,
    inverse,
    looking_at,
    looking_down,
    standing,
    transformed,
)
from cornerscenes.library import Library, MaterialEntry, SurfaceEntry, of_split
from cornerscenes.light import Lamp, Light, Point
from cornerscenes.objects import BUILDERS
from cornerscenes.placement import place
from cornerscenes.recipes import (
    BoardRecipe,
    CameraRecipe,
    Family,
    LensRecipe,
    ObjectRecipe,
    PoseRecipe,
    RangeSensorRecipe,
    RoomRecipe,
    SceneRecipe,
    TargetRecipe,
)
from cornerscenes.room import Surface
from cornerscenes.scene import FIRST_OBJECT_ID, Lens, Line, PlacedObject, Scene, Shape
from cornerscenes.shape import Material, Rgb, Texture
from cornerscenes.streams import Factors, stream
from cornerscenes.tables import RecipeError, unknown_name
from cornerscenes.target import Target, Wireframe
from cornerscenes.textures import BACKGROUNDS, TILE_M, label, scratches, wood

# How often a scene's objects are drawn anew where they cannot be placed as the recipe wants.
REDRAWN = 3

# The stripe on the wall: the red of paint.
_STRIPE: Rgb = (0.62, 0.03, 0.03)


def lay_out(suite: str, recipe: SceneRecipe, family: Family, library: Library) -> Scene:
    """Draw one scene.

    Parameters
    ----------
    suite : str
        Name of its suite.
    recipe : SceneRecipe
        The scene.
    family : Family
        Its family.
    library : Library
        Materials, backgrounds and lights.

    Raises
    ------
    RecipeError
        When a name is unknown or no placement meets the wanted visible fraction.
    """
    try:
        return _Drawing(suite, recipe, family, library).scene()
    except RecipeError as error:
        raise RecipeError(f"scene {recipe.name}: {error}") from None


class _Drawing:
    """One scene on its way from recipe to resolved."""

    def __init__(self, suite: str, recipe: SceneRecipe, family: Family, library: Library) -> None:
        self.key = f"{suite}/{recipe.name}"
        self.factors = Factors(f"{suite}/{recipe.group}", recipe.index)
        self.recipe, self.family, self.library = recipe, family, library

    def scene(self) -> Scene:
        """Draw everything, from what is fixed first to what depends on it."""
        family = self.family
        material_name = self._material_name(family.target)
        material = self.library.materials[material_name]
        target = self._target(family.target, material, bevel_radius_m=0.0)
        pose_name = self._pose_name()
        camera = _camera(family.camera)
        pose = self._pose(family.poses[pose_name], target, camera)
        if family.target.bevel_px is not None:
            target = self._bevelled(family.target, material, target, pose, camera)
        _check_view(target, pose, pose_name)
        surfaces: tuple[Surface, ...] = ()
        lines: tuple[Line, ...] = ()
        walls = np.full(2, np.inf)
        names = {"pose": pose_name, "material": material_name}
        if family.room is not None:
            names["background"] = self._name("room.backgrounds", family.room.backgrounds)
            surfaces, lines = self._room(family.room, names["background"])
            walls = surfaces[0].corners_m[2, :2]
            if (target.vertices_m()[:, :2].max(axis=0) > walls).any():
                raise RecipeError("the target stands in a wall; move it or the wall")
        names["light"] = self._name("lights", family.lights)
        return Scene(
            camera=camera,
            range_camera=_camera(family.range_sensor),
            world_from_camera=pose,
            world_from_range=pose @ _shifted(family.range_sensor.position_in_camera_m),
            lens=self._lens(family.camera.lens, target, pose),
            target=target,
            objects=self._objects(target, pose[:3, 3], walls),
            surfaces=surfaces,
            lines=lines,
            light=self._light(names["light"], target),
            names=names,
            is_red=material.red,
        )

    def _name(self, key: str, names: tuple[str, ...]) -> str:
        """Draw one of the names that belong to this scene's split."""
        kind = key.rpartition(".")[2]
        entries = getattr(self.library, "materials" if "materials" in kind else kind)
        return self.factors.one_of(key, of_split(key, entries, names, self.recipe.split))

    def _material_name(self, recipe: TargetRecipe) -> str:
        if self.factors.unit("target.other")[0] < recipe.other_share:
            return self._name("target.other_materials", recipe.other_materials)
        return self._name("target.materials", recipe.materials)

    def _pose_name(self) -> str:
        known = sorted(self.family.poses)
        for name in self.recipe.poses:
            if name not in known:
                raise RecipeError(unknown_name("pose", name, known))
        return self.factors.one_of("pose", list(self.recipe.poses) or known)

    def _target(self, recipe: TargetRecipe, entry: MaterialEntry, bevel_radius_m: float) -> Target:
        """Draw the target and stand it, its lowest point on the floor or above it."""
        size_m, wireframe, parts, texture_corners = (
            self._cuboid(recipe, entry, bevel_radius_m)
            if recipe.board is None
            else self._board(recipe.board, entry)
        )
        draw = self.factors.within
        x, y = draw("target.x", recipe.position_x_m), draw("target.y", recipe.position_y_m)
        pose = standing(x, y, np.deg2rad(draw("target.yaw", recipe.yaw_deg)))
        pose = pose @ _tilted(np.deg2rad(draw("target.tilt", recipe.tilt_deg)))
        lowest = min(transformed(pose, part.vertices)[:, 2].min() for part in parts)
        pose[2, 3] += draw("target.lift", recipe.lift_m) - lowest
        return Target(
            kind="cuboid" if recipe.board is None else "board",
            size_m=size_m,
            wireframe=wireframe,
            parts=parts,
            world_from_target=pose,
            bevel_radius_m=bevel_radius_m,
            texture_corners_m=texture_corners,
        )

    def _cuboid(
        self, recipe: TargetRecipe, entry: MaterialEntry, bevel_radius_m: float
    ) -> tuple[Point, Wireframe, tuple, Float[np.ndarray, "k 3"]]:
        sides = (recipe.length_m, recipe.width_m, recipe.height_m)
        length, width, height = (
            self.factors.within(f"target.{name}", bounds or (0.0, 0.0))
            for name, bounds in zip(("length", "width", "height"), sides, strict=True)
        )
        size = length, width, height
        material = self._material(entry)
        if bevel_radius_m > 0.0:
            parts = cuboid.bevelled(size, bevel_radius_m, material)
            return size, cuboid.wireframe(size), parts, np.zeros((0, 3))
        textures, corners = self._printed(entry, material.colour, size)
        parts = cuboid.sharp(size, material, textures)
        return size, cuboid.wireframe(size), parts, corners

    def _board(
        self, recipe: BoardRecipe, entry: MaterialEntry
    ) -> tuple[Point, Wireframe, tuple, Float[np.ndarray, "k 3"]]:
        square_m = self.factors.within("board.square", recipe.square_m)
        roughness = self._material(entry).roughness
        return (
            board.size_m(recipe.columns, recipe.rows, square_m),
            board.wireframe(recipe.columns, recipe.rows, square_m),
            board.parts(recipe.columns, recipe.rows, square_m, roughness),
            np.zeros((0, 3)),
        )

    def _bevelled(
        self,
        recipe: TargetRecipe,
        entry: MaterialEntry,
        sharp: Target,
        pose: Float[np.ndarray, "4 4"],
        camera: Camera,
    ) -> Target:
        """Return the target with edges whose radius is given in the image."""
        radius_px = self.factors.within("target.bevel", recipe.bevel_px or (0.0, 0.0))
        depth_m = transformed(inverse(pose), _centre(sharp)[None])[0, 2]
        radius_m = min(radius_px * depth_m / camera.fx_px, 0.45 * min(sharp.size_m))
        return self._target(recipe, entry, radius_m)

    def _material(self, entry: MaterialEntry) -> Material:
        low, high = entry.colour
        shares = self.factors.unit("material.colour", 3)
        red, green, blue = (
            a + share * (b - a) for a, b, share in zip(low, high, shares, strict=True)
        )
        roughness = None
        if entry.roughness is not None:
            roughness = self.factors.within("material.roughness", entry.roughness)
        return Material((red, green, blue), roughness, metallic=entry.metallic)

    def _printed(
        self, entry: MaterialEntry, colour: Rgb, size_m: Point
    ) -> tuple[dict[int, Texture], Float[np.ndarray, "k 3"]]:
        """Return what is on the cuboid's faces, and the corners of labels in its frame [m]."""
        textures: dict[int, Texture] = {}
        corners: list[Float[np.ndarray, "4 3"]] = []
        vertices = cuboid.vertices(size_m)
        for face, quad in enumerate(cuboid.FACES):
            first, second, _, last = vertices[list(quad)]
            extent = float(np.linalg.norm(second - first)), float(np.linalg.norm(last - first))
            generator = stream(self.key, "print", face)
            if entry.pattern == "wood":
                textures[face] = wood(generator, colour, extent)
            elif entry.pattern == "scratches":
                textures[face] = scratches(generator, colour, extent)
            elif entry.pattern == "label":
                textures[face], shares = label(generator, colour, extent)
                steps = np.stack([second - first, last - first])
                corners.append(first + shares @ steps)
        return textures, np.concatenate(corners) if corners else np.zeros((0, 3))

    def _pose(self, recipe: PoseRecipe, target: Target, camera: Camera) -> Float[np.ndarray, "4 4"]:
        """Draw the camera's pose."""
        centre = _centre(target)
        if recipe.position_m is not None:
            eye = np.array(self._jittered("camera.position", recipe.position_m, recipe.jitter_m))
            return looking_down(_point(eye)) if recipe.looks == "down" else looking_at(eye, centre)
        draw = self.factors.within
        azimuth = np.deg2rad(draw("camera.azimuth", recipe.azimuth_deg or (0.0, 0.0)))
        elevation = np.deg2rad(draw("camera.elevation", recipe.elevation_deg or (0.0, 0.0)))
        if recipe.across_px is not None:
            # By ratios, as sizes in an image are.
            low, high = np.log(recipe.across_px)
            across_px = np.exp(draw("camera.across", (float(low), float(high))))
            distance = camera.fx_px * float(np.linalg.norm(target.size_m)) / across_px
        else:
            distance = draw("camera.distance", recipe.distance_m or (1.0, 1.0))
        level = np.cos(elevation)
        towards = np.array([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)])
        eye = centre + distance * towards
        straight = looking_at(eye, centre)
        shift = np.array(self.factors.unit("camera.off_centre", 2)) * 2.0 - 1.0
        shift *= recipe.off_centre * distance * np.array([camera.width, camera.height])
        aim = centre - straight[:3, :2] @ (shift / camera.fx_px)
        return looking_at(eye, aim)

    def _lens(
        self, recipe: LensRecipe | None, target: Target, pose: Float[np.ndarray, "4 4"]
    ) -> Lens | None:
        if recipe is None:
            return None
        depth_m = float(transformed(inverse(pose), _centre(target)[None])[0, 2])
        offset_m = self.factors.within("lens.focus", recipe.focus_offset_m)
        aperture_m = self.factors.within("lens.aperture", recipe.aperture_radius_m)
        return Lens(aperture_m, depth_m + offset_m)

    def _room(
        self, recipe: RoomRecipe, background: str
    ) -> tuple[tuple[Surface, ...], tuple[Line, ...]]:
        entry = self.library.backgrounds[background]
        wall_x = self.factors.within("room.wall_x", recipe.wall_x_m)
        wall_y = self.factors.within("room.wall_y", recipe.wall_y_m)
        corners = rooms.corners(wall_x, wall_y, recipe.extent_m, recipe.height_m)
        surfaces = [
            self._surface(name, points, entry.floor if name == "floor" else entry.walls)
            for name, points in corners.items()
        ]
        if recipe.red_stripe_m is not None:
            wall = self.factors.one_of("room.stripe", ["wall_x", "wall_y"])
            paint = np.tile(np.array(_STRIPE), (2, 2, 1))
            surfaces.append(rooms.stripe(corners[wall], *recipe.red_stripe_m, paint))
        inner = corners["floor"][2]
        lines = (
            Line("floor and wall_x", inner, corners["wall_x"][1]),
            Line("floor and wall_y", inner, corners["wall_y"][0]),
            Line("wall_x and wall_y", inner, corners["wall_x"][3]),
        )
        return tuple(surfaces), lines

    def _surface(
        self, name: str, corners: Float[np.ndarray, "4 3"], entry: SurfaceEntry
    ) -> Surface:
        texture = BACKGROUNDS[entry.pattern](stream(self.key, name), entry.colour)
        sides = np.linalg.norm(corners[[1, 3]] - corners[0], axis=1) / TILE_M
        return Surface(name, corners, texture, (float(sides[0]), float(sides[1])), entry.roughness)

    def _light(self, name: str, target: Target) -> Light:
        entry = self.library.lights[name]
        lamps = []
        for index, lamp in enumerate(entry.lamps):
            key = f"lamp{index}"
            strength = self.factors.within(f"{key}.strength", lamp.strength)
            red, green, blue = (strength * share for share in lamp.colour)
            size_m = 0.0
            if lamp.size_m is not None:
                size_m = self.factors.within(f"{key}.size", lamp.size_m)
            lamps.append(
                Lamp(
                    kind=lamp.kind,
                    strength=(red, green, blue),
                    position_m=self._jittered(key, lamp.position_m, lamp.jitter_m),
                    aim_m=_point(_centre(target)),
                    size_m=size_m,
                )
            )
        return Light(entry.zenith, entry.horizon, entry.nadir, tuple(lamps))

    def _objects(
        self, target: Target, eye_m: Float[np.ndarray, "3"], walls_m: Float[np.ndarray, "2"]
    ) -> tuple[PlacedObject, ...]:
        """Draw objects and place them; draw others where these cannot be placed as is wanted."""

        def attempt(prefix: str) -> tuple[PlacedObject, ...]:
            keys = [f"{prefix}object{index}" for index in range(len(self.family.objects))]
            built = tuple(
                self._build(index, key, item)
                for index, (key, item) in enumerate(zip(keys, self.family.objects, strict=True))
                if self.factors.unit(f"{key}.share")[0] < item.share
            )
            return place(self.key, built, target, eye_m, walls_m, self.recipe.visible_fraction)

        try:
            return attempt("")
        except RecipeError:
            for count in range(REDRAWN):
                with suppress(RecipeError):
                    return attempt(f"redrawn{count}.")
            raise

    def _build(self, index: int, key: str, recipe: ObjectRecipe) -> PlacedObject:
        builder = self.factors.one_of(f"{key}.builder", recipe.builders)
        height_m = self.factors.within(f"{key}.height", recipe.height_m)
        parts = BUILDERS[builder](stream(self.key, key, builder), height_m)
        number = FIRST_OBJECT_ID + index
        return PlacedObject(number, builder, recipe.role, height_m, Shape.of(parts), np.eye(4))

    def _jittered(self, factor: str, point_m: Point, jitter_m: float) -> Point:
        shares = 2.0 * np.array(self.factors.unit(factor, 3)) - 1.0
        return _point(np.array(point_m) + jitter_m * shares)


def _camera(recipe: CameraRecipe | RangeSensorRecipe) -> Camera:
    degrees = recipe.horizontal_field_of_view_deg
    return Camera.with_field_of_view(recipe.width, recipe.height, degrees)


def _centre(target: Target) -> Float[np.ndarray, "3"]:
    """Return the middle of the target's vertices in the world [m]."""
    return target.vertices_m().mean(axis=0)


def _point(values: Float[np.ndarray, "3"]) -> Point:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _shifted(position_m: Point) -> Float[np.ndarray, "4 4"]:
    pose = np.eye(4)
    pose[:3, 3] = position_m
    return pose


def _tilted(angle_rad: float) -> Float[np.ndarray, "4 4"]:
    """Return a turn about the x axis."""
    cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
    pose = np.eye(4)
    pose[1:3, 1:3] = [[cosine, -sine], [sine, cosine]]
    return pose


def _check_view(target: Target, world_from_camera: Float[np.ndarray, "4 4"], pose: str) -> None:
    """Refuse a target behind the camera, and a camera whose upright is undefined."""
    if not np.isfinite(world_from_camera).all():
        raise RecipeError(
            f"pose {pose!r} is straight above its target; "
            'looks = "down" with position_m is the pose for that'
        )
    nearest_m = transformed(inverse(world_from_camera), target.vertices_m())[:, 2].min()
    if nearest_m < 0.02:
        raise RecipeError(
            f"a vertex of the target has depth {nearest_m:.3f} m, must be at least 0.02; move "
            f"pose {pose!r} or the target"
        )
