"""From a recipe to one scene: every size, pose and light drawn, every object placed.

Each factor has a random stream of its own, keyed by suite, scene and factor. The target's visible
fraction is met by drawing many placements of the objects and keeping the one that comes nearest.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import ConvexHull

from cornerscenes import cuboid
from cornerscenes.camera import (
    Camera,
    inverse,
    looking_at,
    looking_down,
    standing,
    transformed,
)
from cornerscenes.mitsuba_backend import Light, Occluder, Solid, World
from cornerscenes.objects import BUILDERS
from cornerscenes.recipes import Family, ObjectRecipe, RecipeError, SceneRecipe, unknown_name
from cornerscenes.room import Surface, room
from cornerscenes.shape import Material, Part
from cornerscenes.streams import stream

TARGET_ID = 1
FIRST_OBJECT_ID = 10
FIRST_SURFACE_ID = 100

# Placements of all objects drawn before a wanted visible fraction is given up, and places tried for
# one object before a placement is.
PLACEMENTS = 400
TRIES = 40

# Cells per side of a face from which a placement's visible fraction is estimated.
PLACEMENT_CELLS = 24

# Objects keep this distance from the target, the walls and each other's feet.
CLEARANCE_M = 0.012


@dataclass(frozen=True)
class Target:
    """The cuboid: dimensions along its own axes [m], pose, material."""

    size_m: tuple[float, float, float]
    world_from_cuboid: Float[np.ndarray, "4 4"]
    material: Material

    def vertices_m(self) -> Float[np.ndarray, "8 3"]:
        """Return the eight vertices in the world [m]."""
        return transformed(self.world_from_cuboid, cuboid.vertices(self.size_m))

    def face_points_m(self, face: int, count: int) -> Float[np.ndarray, "n 3"]:
        """Return a count x count grid of cell centres on a face, in the world [m]."""
        return transformed(self.world_from_cuboid, cuboid.face_points(self.size_m, face, count))

    def normal(self, face: int) -> Float[np.ndarray, "3"]:
        """Return a face's outward normal in the world."""
        return self.world_from_cuboid[:3, :3] @ cuboid.NORMALS[face]

    def facing(self, eye_m: Float[np.ndarray, "3"]) -> list[int]:
        """Return the faces whose outside is towards an eye in the world [m]."""
        vertices = self.vertices_m()
        return [
            face
            for face, corners in enumerate(cuboid.FACES)
            if self.normal(face) @ (eye_m - vertices[corners[0]]) > 0.0
        ]


@dataclass(frozen=True)
class Shape:
    """An object as built, in its own frame [m], with what deciding on a place needs to know.

    Attributes
    ----------
    parts : tuple[Part, ...]
        Its meshes.
    vertices_m : Float[np.ndarray, "n 3"]
        The vertices of all parts.
    outline_m : Float[np.ndarray, "m 3"]
        Those that bound it seen from above.
    feet_middle_m, feet_radius_m
        A circle on the floor around all of it that is lower than 12 cm.
    """

    parts: tuple[Part, ...]
    vertices_m: Float[np.ndarray, "n 3"]
    outline_m: Float[np.ndarray, "m 3"]
    feet_middle_m: Float[np.ndarray, "3"]
    feet_radius_m: float

    @classmethod
    def of(cls, parts: tuple[Part, ...]) -> Shape:
        """Return the shape of an object's parts."""
        vertices = np.concatenate([part.vertices for part in parts])
        feet = vertices[vertices[:, 2] < 0.12][:, :2]
        middle = 0.5 * (feet.min(axis=0) + feet.max(axis=0))
        return cls(
            parts=parts,
            vertices_m=vertices,
            outline_m=vertices[ConvexHull(vertices[:, :2]).vertices],
            feet_middle_m=np.append(middle, 0.0),
            feet_radius_m=float(np.linalg.norm(feet - middle, axis=1).max()),
        )


@dataclass(frozen=True)
class PlacedObject:
    """One object of the scene."""

    object_id: int
    builder: str
    height_m: float
    shape: Shape
    world_from_object: Float[np.ndarray, "4 4"]

    def solids(self) -> list[Solid]:
        """Return its meshes for the renderer."""
        return [Solid(self.object_id, part, self.world_from_object) for part in self.shape.parts]


@dataclass(frozen=True)
class Scene:
    """Everything that is resolved about a scene before it is rendered."""

    camera: Camera
    range_camera: Camera
    world_from_camera: Float[np.ndarray, "4 4"]
    target: Target
    objects: tuple[PlacedObject, ...]
    surfaces: tuple[Surface, ...]
    light: Light

    def world(self, max_depth: int) -> World:
        """Return the scene as the renderer holds it."""
        part = cuboid.part(self.target.size_m, self.target.material)
        solids = [Solid(TARGET_ID, part, self.target.world_from_cuboid)]
        solids += [solid for item in self.objects for solid in item.solids()]
        return World(solids, self.surfaces, FIRST_SURFACE_ID, self.light, max_depth)


def lay_out(suite: str, recipe: SceneRecipe, family: Family) -> Scene:
    """Draw one scene.

    Raises
    ------
    RecipeError
        When a name is unknown or no placement meets the wanted visible fraction.
    """
    key = f"{suite}/{recipe.name}"

    def draw(factor: str, bounds: tuple[float, float]) -> float:
        return float(stream(key, factor).uniform(*bounds))

    wall_x, wall_y = draw("wall_x", family.room.wall_x_m), draw("wall_y", family.room.wall_y_m)
    surfaces = room(wall_x, wall_y, family.room.extent_m, family.room.height_m, key)
    target = _target(family, draw)
    world_from_camera = _pose(recipe, family, target, key)
    _check_view(recipe, target, world_from_camera, surfaces)
    camera_recipe = family.camera
    fov = camera_recipe.horizontal_field_of_view_deg
    camera = Camera.with_field_of_view(camera_recipe.width, camera_recipe.height, fov)
    sensor = family.range_sensor
    range_camera = Camera.with_field_of_view(sensor.width, sensor.height, fov)

    built = [
        _build(f"{key}/object{index}", FIRST_OBJECT_ID + index, item)
        for index, item in enumerate(family.objects)
    ]
    occluders = {item.object_id: Occluder(item.shape.parts) for _, item in built}
    low, high = recipe.visible_fraction
    best: tuple[float, tuple[PlacedObject, ...], float] | None = None
    for attempt in range(PLACEMENTS):
        placed = _place(f"{key}/attempt{attempt}", built, target, world_from_camera, surfaces)
        if placed is None:
            continue
        eye = world_from_camera[:3, 3]
        hidden = _hidden_by(placed, occluders, eye)
        fraction = visible_fraction(target, eye, hidden, PLACEMENT_CELLS)
        distance = max(low - fraction, fraction - high, 0.0)
        if best is None or distance < best[0]:
            best = distance, placed, fraction
        if distance == 0.0:
            break
    if best is None or best[0] > 0.0:
        nearest = "none" if best is None else f"{best[2]:.3f}"
        raise RecipeError(
            f"scene {recipe.name}: visible_fraction [{low}, {high}] not met in {PLACEMENTS} "
            f"placements, nearest {nearest}; widen the range or move the family's occluders"
        )
    light = Light(
        sky_zenith=family.light.sky_zenith,
        sky_horizon=family.light.sky_horizon,
        area_radiance=draw("area_radiance", family.light.area_radiance),
        area_position_m=_jittered(
            family.light.area_position_m, family.light.area_jitter_m, f"{key}/area"
        ),
        area_size_m=family.light.area_size_m,
        aim_m=_point(target.vertices_m().mean(axis=0)),
    )
    return Scene(camera, range_camera, world_from_camera, target, best[1], surfaces, light)


def visible_fraction(
    target: Target,
    eye_m: Float[np.ndarray, "3"],
    hidden: Callable[[Float[np.ndarray, "n 3"]], Bool[np.ndarray, " n"]],
    count: int,
) -> float:
    """Return the share of the target's image area that nothing hides, whatever the frame cuts.

    Parameters
    ----------
    target : Target
        The cuboid.
    eye_m : Float[np.ndarray, "3"]
        The camera's place in the world [m].
    hidden : Callable
        Says of points on the target [m] whether something stands before them.
    count : int
        Every face that looks at the camera is sampled on a grid of count x count cells.
    """
    seen = total = 0.0
    for face in target.facing(eye_m):
        points = target.face_points_m(face, count)
        towards = eye_m - points
        weight = (towards @ target.normal(face)) / np.linalg.norm(towards, axis=1) ** 3
        weight *= np.delete(np.array(target.size_m), face // 2).prod()
        seen += float(weight[~hidden(points)].sum())
        total += float(weight.sum())
    return seen / total


def _hidden_by(
    objects: tuple[PlacedObject, ...],
    occluders: Mapping[int, Occluder],
    eye_m: Float[np.ndarray, "3"],
) -> Callable[[Float[np.ndarray, "n 3"]], Bool[np.ndarray, " n"]]:
    """Return what says whether any of the objects stands before points [m]."""

    def hidden(points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        found = np.zeros(len(points), dtype=bool)
        for item in objects:
            found |= occluders[item.object_id].hides(item.world_from_object, eye_m, points)
        return found

    return hidden


def _target(family: Family, draw: Callable[[str, tuple[float, float]], float]) -> Target:
    recipe = family.target
    size_m = (
        draw("target.length", recipe.length_m),
        draw("target.width", recipe.width_m),
        draw("target.height", recipe.height_m),
    )
    pose = standing(
        draw("target.x", recipe.position_x_m),
        draw("target.y", recipe.position_y_m),
        np.deg2rad(draw("target.yaw", recipe.yaw_deg)),
    )
    return Target(size_m, pose, Material(recipe.colour, recipe.roughness))


def _pose(
    recipe: SceneRecipe, family: Family, target: Target, key: str
) -> Float[np.ndarray, "4 4"]:
    if recipe.pose not in family.poses:
        place = f"scene {recipe.name}: pose"
        raise RecipeError(unknown_name(place, recipe.pose, sorted(family.poses)))
    pose = family.poses[recipe.pose]
    position = _jittered(pose.position_m, pose.jitter_m, f"{key}/camera")
    if pose.looks == "down":
        return looking_down(position)
    centre = target.vertices_m().mean(axis=0)
    return looking_at(np.array(position), centre)


def _point(values: Float[np.ndarray, "3"]) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _check_view(
    recipe: SceneRecipe,
    target: Target,
    world_from_camera: Float[np.ndarray, "4 4"],
    surfaces: tuple[Surface, ...],
) -> None:
    """Refuse a target behind the camera or in a wall, and a camera whose upright is undefined."""
    vertices = target.vertices_m()
    if not np.isfinite(world_from_camera).all():
        raise RecipeError(
            f"scene {recipe.name}: pose {recipe.pose!r} is straight above its target; "
            'looks = "down" is the pose for that'
        )
    nearest_m = transformed(inverse(world_from_camera), vertices)[:, 2].min()
    if nearest_m < 0.02:
        raise RecipeError(
            f"scene {recipe.name}: a vertex of the target has depth {nearest_m:.3f} m, must be at "
            f"least 0.02; move pose {recipe.pose!r} or the target"
        )
    if (vertices[:, :2].max(axis=0) > surfaces[0].corners_m[2, :2]).any():
        raise RecipeError(f"scene {recipe.name}: the target stands in a wall; move it or the wall")


def _jittered(
    point_m: tuple[float, float, float], jitter_m: float, key: str
) -> tuple[float, float, float]:
    return _point(stream(key, "jitter").uniform(-jitter_m, jitter_m, 3) + point_m)


def _build(key: str, object_id: int, recipe: ObjectRecipe) -> tuple[ObjectRecipe, PlacedObject]:
    for name in recipe.builders:
        if name not in BUILDERS:
            raise RecipeError(unknown_name("objects.builders", name, sorted(BUILDERS)))
    builder = recipe.builders[int(stream(key, "builder").integers(len(recipe.builders)))]
    height_m = float(stream(key, "height").uniform(*recipe.height_m))
    parts = BUILDERS[builder](stream(key, builder), height_m)
    return recipe, PlacedObject(object_id, builder, height_m, Shape.of(parts), np.eye(4))


def _place(
    key: str,
    built: list[tuple[ObjectRecipe, PlacedObject]],
    target: Target,
    world_from_camera: Float[np.ndarray, "4 4"],
    surfaces: tuple[Surface, ...],
) -> tuple[PlacedObject, ...] | None:
    """Place every object once, or return `None` when they do not fit."""
    centre = target.world_from_cuboid[:2, 3]
    eye = world_from_camera[:3, 3]
    walls = surfaces[0].corners_m[2, :2]
    towards_eye = _bearing(eye[:2] - centre)
    towards_room = _bearing(centre - walls)
    placed: list[PlacedObject] = []
    for recipe, item in built:
        generator = stream(key, item.object_id)
        for _ in range(TRIES):
            if recipe.role == "occluder":
                angle = towards_eye + generator.uniform(-1.3, 1.3)
                distance = generator.uniform(0.12, 0.36)
            else:
                angle = towards_room + generator.uniform(-2.2, 2.2)
                distance = generator.uniform(0.16, 0.70)
            x, y = centre + distance * np.array([np.cos(angle), np.sin(angle)])
            pose = standing(float(x), float(y), float(generator.uniform(-np.pi, np.pi)))
            candidate = replace(item, world_from_object=pose)
            if _fits(candidate, placed, target, eye, walls):
                placed.append(candidate)
                break
        else:
            return None
    return tuple(placed)


def _bearing(direction: Float[np.ndarray, "2"]) -> float:
    return float(np.arctan2(direction[1], direction[0]))


def _fits(
    candidate: PlacedObject,
    placed: list[PlacedObject],
    target: Target,
    eye_m: Float[np.ndarray, "3"],
    walls_m: Float[np.ndarray, "2"],
) -> bool:
    """Whether an object keeps clear of feet, walls, target and camera; cheap tests first."""
    if not all(_apart(candidate, other) for other in placed):
        return False
    outline = transformed(candidate.world_from_object, candidate.shape.outline_m)
    if (outline[:, :2].max(axis=0) > walls_m - 0.002).any():
        return False
    vertices = transformed(candidate.world_from_object, candidate.shape.vertices_m)
    inside = transformed(inverse(target.world_from_cuboid), vertices)
    inside[:, 2] -= 0.5 * target.size_m[2]
    if (np.abs(inside) < 0.5 * np.array(target.size_m) + CLEARANCE_M).all(axis=1).any():
        return False
    return bool(np.linalg.norm(vertices - eye_m, axis=1).min() > 0.15)


def _apart(first: PlacedObject, second: PlacedObject) -> bool:
    """Whether the feet of two objects keep clear of each other."""
    middles = [
        transformed(item.world_from_object, item.shape.feet_middle_m[None])[0, :2]
        for item in (first, second)
    ]
    reach_m = first.shape.feet_radius_m + second.shape.feet_radius_m
    return bool(np.linalg.norm(middles[0] - middles[1]) > reach_m + CLEARANCE_M)
