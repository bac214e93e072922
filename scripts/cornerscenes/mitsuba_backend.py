"""The only module that imports Mitsuba: scenes to radiance, ray casts to visibility."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import mitsuba
import numpy as np
from jaxtyping import Bool, Float, Int, UInt32

from cornerscenes.camera import Camera, inverse, looking_at, transformed
from cornerscenes.light import Lamp, Light
from cornerscenes.room import Surface
from cornerscenes.scene import FIRST_SURFACE_ID, NO_FACE, TARGET_ID, Lens, Scene
from cornerscenes.shape import Material, Part, Rgb, Texture, joined, vertex_normals
from cornerscenes.streams import seed

mi: Any = mitsuba  # its stubs describe one variant only; which one runs is known at start

# In order of preference; `llvm` needs a shared libLLVM, `cuda` a GPU.
VARIANTS = ("cuda_ad_rgb", "llvm_ad_rgb", "scalar_rgb")

# A ray to a point stops this share of its length short of it, so that the surface the point lies on
# does not hide it: 10 micrometres at one metre.
SHORTENED = 1.0 - 1e-5

# Paths that are followed at once; the renderer's memory grows with them.
MOST_PATHS = 2**21


@dataclass(frozen=True)
class Solid:
    """A mesh in the world; all parts of one object share its id."""

    object_id: int
    part: Part
    world_from_object: Float[np.ndarray, "4 4"]


@dataclass(frozen=True)
class Hits:
    """What rays met first: distance [m], object id (0 where nothing), the target's face, normal."""

    distance_m: Float[np.ndarray, " n"]
    object_id: UInt32[np.ndarray, " n"]
    face_id: UInt32[np.ndarray, " n"]
    normal: Float[np.ndarray, "n 3"]


def choose_variant(wanted: str | None = None) -> str:
    """Make the fastest variant of this machine the current one and return its name.

    Parameters
    ----------
    wanted : str, optional
        Take this one instead.
    """
    candidates = VARIANTS if wanted is None else (wanted,)
    for variant in candidates:
        try:
            mi.set_variant(variant)
            if not variant.startswith("scalar"):
                import drjit

                drjit.eval(mi.Float([0.0]))  # fails here without a GPU or libLLVM
            return variant
        except (ImportError, RuntimeError, AttributeError):
            continue
    raise RuntimeError(f"mitsuba runs none of {', '.join(candidates)} on this machine")


def target_solids(scene: Scene) -> list[Solid]:
    """Return the target's meshes, placed."""
    pose = scene.target.world_from_target
    return [Solid(TARGET_ID, part, pose) for part in scene.target.parts]


def _object_solids(scene: Scene) -> list[Solid]:
    return [
        Solid(item.object_id, part, item.world_from_object)
        for item in scene.objects
        for part in item.shape.parts
    ]


class World:
    """A scene as the renderer holds it.

    Attributes
    ----------
    traced : list[tuple[int, float]]
        For each time that its radiance was rendered how many paths that took, and how long [s].
    """

    def __init__(
        self,
        solids: list[Solid],
        surfaces: tuple[Surface, ...] = (),
        light: Light | None = None,
        max_depth: int = 1,
    ) -> None:
        """Hand meshes, textured rectangles and light to the renderer.

        Parameters
        ----------
        solids : list[Solid]
            Meshes in the world.
        surfaces : tuple[Surface, ...]
            Rectangles; surface i gets the object id `FIRST_SURFACE_ID` + i.
        light : Light or None
            Sky and lamps; without them only visibility can be asked.
        max_depth : int
            Longest path; 2 is direct light.
        """
        self.traced: list[tuple[int, float]] = []
        self._ids: dict[str, tuple[int, int]] = {}  # shape: its object id and face
        self._shapes: dict[str, Any] = {}
        materials = _Materials(light is None)
        for index, solid in enumerate(solids):
            face = NO_FACE if solid.part.face is None else solid.part.face
            mesh = _mesh(f"solid{index}", solid, materials.of(solid.part.material))
            self._add(f"solid{index}", mesh, solid.object_id, face)
        for index, surface in enumerate(surfaces):
            shape = mi.load_dict(_rectangle(f"surface{index}", surface))
            self._add(f"surface{index}", shape, FIRST_SURFACE_ID + index, NO_FACE)
        description: dict[str, Any] = {
            "type": "scene",
            # Measured on the paper's scene: variance times time is the same for 2, 3 and 5.
            "integrator": {"type": "path", "max_depth": max_depth, "rr_depth": 3},
            **self._shapes,
        }
        if light is not None:
            description.update(_sky(light))
            for index, lamp in enumerate(light.lamps):
                description[f"lamp{index}"] = _lamp(lamp)
        self._scene = mi.load_dict(description)

    @classmethod
    def of(cls, scene: Scene, max_depth: int) -> World:
        """Return a scene as the renderer holds it."""
        return cls(
            target_solids(scene) + _object_solids(scene), scene.surfaces, scene.light, max_depth
        )

    def _add(self, name: str, shape: Any, object_id: int, face: int) -> None:
        self._shapes[name] = shape
        self._ids[name] = object_id, face

    def without(self, object_id: int) -> World:
        """Return what is left without an object, in the dark."""
        left = {
            name: shape for name, shape in self._shapes.items() if self._ids[name][0] != object_id
        }
        return self._in_the_dark(left)

    def _in_the_dark(self, shapes: dict[str, Any]) -> World:
        dark = World.__new__(World)
        dark.traced, dark._ids, dark._shapes = [], self._ids, shapes
        integrator = {"type": "path", "max_depth": 1}
        dark._scene = mi.load_dict({"type": "scene", "integrator": integrator, **shapes})
        return dark

    def shining(self, solids: list[tuple[Solid, Rgb]]) -> World:
        """Return the same geometry in the dark, but for some of its meshes, which shine.

        What is rendered of it is their coverage: the share of each film cell they are seen in.

        Parameters
        ----------
        solids : list[tuple[Solid, Rgb]]
            First meshes of this world, in its order, and the radiance of each.
        """
        shapes = dict(self._shapes)
        black = _Materials(dark=True).of(solids[0][0].part.material)
        for index, (solid, radiance) in enumerate(solids):
            shapes[f"solid{index}"] = _mesh(f"solid{index}", solid, black, radiance)
        return self._in_the_dark(shapes)

    def seen_by(
        self, camera: Camera, world_from_camera: Float[np.ndarray, "4 4"], lens: Lens | None = None
    ) -> View:
        """Return what a camera sees of it, through a lens or as a pinhole."""
        return View(self._scene, camera, world_from_camera, lens, self.traced)

    def occluded(
        self, origin: Float[np.ndarray, "3"], points: Float[np.ndarray, "n 3"]
    ) -> Bool[np.ndarray, " n"]:
        """Return whether anything stands between an origin and points that lie on surfaces [m]."""
        towards = points - origin
        distance = np.linalg.norm(towards, axis=1)
        directions = towards / distance[:, None]
        if mi.variant().startswith("scalar"):
            return np.array(
                [
                    self._scene.ray_test(mi.Ray3f(origin, d, float(t) * SHORTENED, 0.0, []))
                    for d, t in zip(directions, distance, strict=True)
                ]
            )
        rays = mi.Ray3f(_vector(mi.Point3f, origin), _vector(mi.Vector3f, directions))
        rays.maxt = mi.Float(np.float32(distance * SHORTENED))
        return np.array(self._scene.ray_test(rays)).astype(bool)

    def first_hits(
        self, origin: Float[np.ndarray, "3"], directions: Float[np.ndarray, "n 3"]
    ) -> Hits:
        """Cast rays from an origin along unit directions in the world."""
        if mi.variant().startswith("scalar"):
            return self._first_hits_one_by_one(origin, directions)
        import drjit

        rays = mi.Ray3f(_vector(mi.Point3f, origin), _vector(mi.Vector3f, directions))
        found = self._scene.ray_intersect(rays)
        valid = np.array(found.is_valid())
        shape_index = np.array(drjit.reinterpret_array(mi.UInt32, found.shape))
        ids = np.zeros((int(shape_index.max(initial=0)) + 1, 2), dtype=np.uint32)
        for shape in self._scene.shapes():
            index = np.array(drjit.reinterpret_array(mi.UInt32, mi.ShapePtr(shape)))[0]
            if index < len(ids):
                ids[index] = self._ids_of(shape)
        return Hits(
            distance_m=np.where(valid, np.array(found.t, dtype=np.float64), 0.0),
            object_id=np.where(valid, ids[shape_index, 0], 0).astype(np.uint32),
            face_id=np.where(valid, ids[shape_index, 1], NO_FACE).astype(np.uint32),
            normal=np.where(valid[:, None], np.array(found.n, dtype=np.float64).T, 0.0),
        )

    def _ids_of(self, shape: Any) -> tuple[int, int]:
        return self._ids.get(shape.id(), (0, NO_FACE))  # a lamp has no id

    def _first_hits_one_by_one(
        self, origin: Float[np.ndarray, "3"], directions: Float[np.ndarray, "n 3"]
    ) -> Hits:
        count = len(directions)
        hits = Hits(
            np.zeros(count),
            np.zeros(count, dtype=np.uint32),
            np.full(count, NO_FACE, dtype=np.uint32),
            np.zeros((count, 3)),
        )
        for index, direction in enumerate(directions):
            found = self._scene.ray_intersect(mi.Ray3f(origin, direction))
            if found.is_valid():
                hits.distance_m[index] = found.t
                hits.object_id[index], hits.face_id[index] = self._ids_of(found.shape)
                hits.normal[index] = np.array(found.n)
        return hits


class View:
    """A scene as a camera sees it: linear radiance on cells of its sensor."""

    def __init__(
        self,
        scene: Any,
        camera: Camera,
        world_from_camera: Float[np.ndarray, "4 4"],
        lens: Lens | None,
        traced: list[tuple[int, float]],
    ) -> None:
        """Take a scene of the renderer, a camera and its lens, and where to note paths and time."""
        self._scene, self._camera, self._traced = scene, camera, traced
        flipped = world_from_camera @ np.diag([-1.0, -1.0, 1.0, 1.0])  # Mitsuba: x left, y up
        self._sensor: dict[str, Any] = {
            "type": "perspective",
            "fov": float(np.rad2deg(2.0 * np.arctan(0.5 * camera.width / camera.fx_px))),
            "fov_axis": "x",
            "to_world": mi.ScalarTransform4f(flipped),
        }
        if lens is not None:
            self._sensor |= {
                "type": "thinlens",
                "aperture_radius": lens.aperture_radius_m,
                "focus_distance": lens.focus_distance_m,
            }

    def passes(
        self,
        tiles_px: Int[np.ndarray, "n 2"],
        side_px: int,
        divisions: int,
        samples: int,
        count: int,
        key: str,
    ) -> Iterator[Float[np.ndarray, "n d d 3"]]:
        """Render square tiles of the sensor several times, each time with other samples.

        The samples of a tile are stratified as a whole, and over its cells.

        Parameters
        ----------
        tiles_px : Int[np.ndarray, "n 2"]
            First column and first row of each tile [px], inside the frame.
        side_px : int
            Side of a tile [px].
        divisions : int
            Cells of a tile in each direction, d: a power of two, and a multiple of its side.
        samples : int
            Paths per tile: a power of four, at least 4 per cell. A square number, because the
            multi-jittered sampler rounds all others. A power of two, because then no tile's samples
            are split between threads, whose sums would differ in the last bit from run to run.
        count : int
            How often.
        key : str
            Names the random stream.

        Yields
        ------
        Float[np.ndarray, "n d d 3"]
            Mean radiance of each tile's cells, row by row.
        """
        one_by_one = mi.variant().startswith("scalar")
        render = self._crop if one_by_one else self._wavefront
        at_once = 1 if one_by_one else max(1, MOST_PATHS // (len(tiles_px) * samples))
        most_tiles = len(tiles_px) if one_by_one else max(1, MOST_PATHS // samples)
        for first in range(0, count, at_once):
            times = min(at_once, count - first)
            tiles = np.tile(tiles_px, (times, 1))
            started_s = time.monotonic()
            parts = [
                render(tiles[i : i + most_tiles], side_px, divisions, samples, seed(key, first, i))
                for i in range(0, len(tiles), most_tiles)
            ]
            self._traced.append((len(tiles) * samples, time.monotonic() - started_s))
            yield from np.concatenate(parts).reshape(times, -1, divisions, divisions, 3)

    def _wavefront(
        self,
        tiles_px: Int[np.ndarray, "n 2"],
        side_px: int,
        divisions: int,
        samples: int,
        seed: int,
    ) -> Float[np.ndarray, "n d d 3"]:
        import drjit

        # What differs from call to call is opaque, and no sum is kept per thread (its size would be
        # part of the code): then one compiled kernel serves all of a scene.
        sampler = mi.load_dict({"type": "multijitter", "sample_count": samples})
        sampler.set_samples_per_wavefront(samples)
        sampler.seed(seed, len(tiles_px) * samples)
        index = drjit.arange(mi.UInt32, len(tiles_px) * samples) // samples
        first = mi.Point2f(*(mi.Float(np.float32(tiles_px[:, axis])) for axis in range(2)))
        side = drjit.opaque(mi.Float, side_px)
        in_tile = sampler.next_2d()
        size = mi.Point2f(self._camera.width, self._camera.height)
        place = (drjit.gather(mi.Point2f, first, index) + side * in_tile) / size
        ray, _ = self._loaded().sample_ray(0.0, 0.0, place, sampler.next_2d())
        radiance, _, _ = self._scene.integrator().sample(self._scene, sampler, ray)
        across = drjit.opaque(mi.UInt32, divisions)
        cell = drjit.minimum(mi.Point2u(in_tile * mi.Float(across)), across - 1)
        place_in_sums = (index * across + cell.y) * across + cell.x
        cells = len(tiles_px) * divisions**2
        sums = [drjit.zeros(mi.Float, cells) for _ in range(4)]
        for sum_, value in zip(sums, (*radiance, mi.Float(1.0)), strict=True):
            drjit.scatter_add(sum_, value, place_in_sums, mode=drjit.ReduceMode.Direct)
        drjit.eval(sums)
        red, green, blue, counted = (np.array(sum_, dtype=np.float64) for sum_ in sums)
        mean = np.stack([red, green, blue], axis=-1) / counted[:, None]
        return mean.reshape(-1, divisions, divisions, 3)

    def _crop(
        self,
        tiles_px: Int[np.ndarray, "n 2"],
        side_px: int,
        divisions: int,
        samples: int,
        seed: int,
    ) -> Float[np.ndarray, "n d d 3"]:
        """Do the same where the renderer handles one path at a time: all about the tiles, too."""
        scale = divisions // side_px
        (left, top), (right, bottom) = tiles_px.min(axis=0), tiles_px.max(axis=0) + side_px
        film = {
            "type": "hdrfilm",
            "width": scale * self._camera.width,
            "height": scale * self._camera.height,
            "crop_offset_x": int(scale * left),
            "crop_offset_y": int(scale * top),
            "crop_width": int(scale * (right - left)),
            "crop_height": int(scale * (bottom - top)),
            "rfilter": {"type": "box"},
            "pixel_format": "rgb",
            "component_format": "float32",
        }
        each = samples // divisions**2
        sampler = {"type": "multijitter", "sample_count": each}
        sensor = mi.load_dict({**self._sensor, "film": film, "sampler": sampler})
        image = np.array(mi.render(self._scene, sensor=sensor, spp=each, seed=seed))
        within = scale * (tiles_px - [left, top])
        x, y = (within[:, axis, None] + np.arange(divisions) for axis in range(2))
        return image[y[:, :, None], x[:, None, :]].astype(np.float64)

    def _loaded(self) -> Any:
        film = {
            "type": "hdrfilm",
            "width": self._camera.width,
            "height": self._camera.height,
            "rfilter": {"type": "box"},
        }
        return mi.load_dict({**self._sensor, "film": film})


class Occluder:
    """One object's shape, built once, asked from any pose: what placing objects needs."""

    def __init__(self, parts: tuple[Part, ...]) -> None:
        self._world = World([Solid(0, joined(parts), np.eye(4))])

    def hides(
        self,
        world_from_object: Float[np.ndarray, "4 4"],
        origin: Float[np.ndarray, "3"],
        points: Float[np.ndarray, "n 3"],
    ) -> Bool[np.ndarray, " n"]:
        """Return whether the object stands between an origin and points in the world [m]."""
        object_from_world = inverse(world_from_object)
        (eye,) = transformed(object_from_world, origin[None])
        return self._world.occluded(eye, transformed(object_from_world, points))


def _vector(kind: Any, values: Float[np.ndarray, "..."]) -> Any:
    return kind(*(np.ascontiguousarray(values[..., axis], dtype=np.float32) for axis in range(3)))


def _bitmap(texture: Texture, repeats: tuple[float, float]) -> dict[str, Any]:
    return {
        "type": "bitmap",
        "bitmap": mi.Bitmap(np.ascontiguousarray(texture, dtype=np.float32)),
        "raw": True,
        "wrap_mode": "clamp" if repeats == (1.0, 1.0) else "repeat",
        "to_uv": mi.ScalarTransform4f(np.diag([*repeats, 1.0, 1.0])),
    }


def _bsdf(
    reflectance: dict[str, Any], roughness: float | None, metallic: float = 0.0
) -> dict[str, Any]:
    if metallic > 0.0:
        return {
            "type": "principled",
            "base_color": reflectance,
            "metallic": metallic,
            "roughness": 0.3 if roughness is None else roughness,
            "clearcoat": 1.0,
            "clearcoat_gloss": 0.9,
        }
    if roughness is None:
        return {"type": "diffuse", "reflectance": reflectance}
    return {
        "type": "roughplastic",
        "distribution": "ggx",
        "alpha": roughness,
        "diffuse_reflectance": reflectance,
    }


class _Materials:
    """The materials of a scene, each loaded once: that takes the renderer some 40 ms."""

    def __init__(self, dark: bool) -> None:
        self._dark = dark
        self._loaded: dict[tuple[Any, ...], Any] = {}

    def of(self, material: Material) -> Any:
        """Return a material as the renderer holds it; in the dark all are the same."""
        if self._dark:
            key, description = (), {"type": "diffuse"}
        else:
            key = (
                id(material.texture),
                material.colour,
                material.roughness,
                material.metallic,
                material.two_sided,
            )
            description = _bsdf_of(material)
        if key not in self._loaded:
            self._loaded[key] = mi.load_dict(description)
        return self._loaded[key]


def _bsdf_of(material: Material) -> dict[str, Any]:
    reflectance: dict[str, Any] = {"type": "rgb", "value": list(material.colour)}
    if material.texture is not None:
        reflectance = _bitmap(material.texture, (1.0, 1.0))
    bsdf = _bsdf(reflectance, material.roughness, material.metallic)
    return {"type": "twosided", "bsdf": bsdf} if material.two_sided else bsdf


def _mesh(name: str, solid: Solid, bsdf: Any, radiance: Rgb | None = None) -> Any:
    """Return a mesh of a material; it shines where a radiance is given."""
    part = solid.part
    properties = mi.Properties()
    properties["bsdf"] = bsdf
    if radiance is not None:
        shine = {"type": "area", "radiance": {"type": "rgb", "value": list(radiance)}}
        properties["emitter"] = mi.load_dict(shine)
    mesh = mi.Mesh(
        name,
        vertex_count=len(part.vertices),
        face_count=len(part.triangles),
        has_vertex_normals=part.smooth,
        has_vertex_texcoords=part.uv is not None,
        props=properties,
    )
    mesh.set_id(name)
    parameters = mi.traverse(mesh)
    positions = transformed(solid.world_from_object, part.vertices)
    parameters["vertex_positions"] = positions.astype(np.float32).ravel()
    parameters["faces"] = part.triangles.astype(np.uint32).ravel()
    if part.uv is not None:
        parameters["vertex_texcoords"] = part.uv.astype(np.float32).ravel()
    parameters.update()
    if part.smooth:
        # After the positions, whose update makes normals of its own: in parallel, so that their
        # last bits, and with them whole paths, would differ from run to run.
        if part.normals is None:
            normals = vertex_normals(positions, part.triangles)
        else:
            normals = part.normals @ solid.world_from_object[:3, :3].T
        parameters["vertex_normals"] = normals.astype(np.float32).ravel()
        parameters.update()
    return mesh


def _rectangle(name: str, surface: Surface) -> dict[str, Any]:
    first, second, _, fourth = surface.corners_m
    along, up = (second - first) / 2.0, (fourth - first) / 2.0
    normal = np.cross(along, up)
    matrix = np.eye(4)  # Mitsuba's rectangle spans [-1, 1]^2 in its xy plane
    matrix[:3, 0], matrix[:3, 1] = along, up
    matrix[:3, 2] = normal / np.linalg.norm(normal)
    matrix[:3, 3] = first + along + up
    return {
        "type": "rectangle",
        "id": name,
        "to_world": mi.ScalarTransform4f(matrix),
        "bsdf": _bsdf(_bitmap(surface.texture, surface.repeats), surface.roughness),
    }


def _sky(light: Light) -> dict[str, Any]:
    if max(*light.zenith, *light.horizon, *light.nadir) == 0.0:
        return {}
    elevation = np.linspace(np.pi / 2, -np.pi / 2, 64)  # rows of the map from zenith to nadir
    blend = np.abs(np.sin(elevation))[:, None]
    pole = np.where(elevation[:, None] > 0.0, np.array(light.zenith), np.array(light.nadir))
    sky = (1.0 - blend) * np.array(light.horizon) + blend * pole
    if max(light.nadir) == 0.0:
        sky[elevation < 0.0] = 0.0  # below the floor: no path may be wasted on it
    pixels = np.repeat(sky[:, None, :], 128, axis=1).astype(np.float32)
    upright = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]], dtype=np.float64)
    return {
        "sky": {
            "type": "envmap",
            "bitmap": mi.Bitmap(pixels),
            "to_world": mi.ScalarTransform4f(upright),  # Mitsuba's maps have y up
        }
    }


def _lamp(lamp: Lamp) -> dict[str, Any]:
    strength = {"type": "rgb", "value": list(lamp.strength)}
    if lamp.kind == "point":
        return {"type": "point", "position": list(lamp.position_m), "intensity": strength}
    if lamp.kind == "sun":
        towards = np.array(lamp.aim_m) - np.array(lamp.position_m)
        return {"type": "directional", "direction": towards.tolist(), "irradiance": strength}
    towards_aim = looking_at(np.array(lamp.position_m), np.array(lamp.aim_m))
    scale = np.diag([0.5 * lamp.size_m, 0.5 * lamp.size_m, 1.0, 1.0])
    return {
        "type": "rectangle",
        "to_world": mi.ScalarTransform4f(towards_aim @ scale),
        "emitter": {"type": "area", "radiance": strength},
    }
