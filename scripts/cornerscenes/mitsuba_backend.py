"""The only module that imports Mitsuba: scenes to radiance, ray casts to visibility."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mitsuba
import numpy as np
from jaxtyping import Bool, Float, UInt32

from cornerscenes.camera import Camera, inverse, looking_at, transformed
from cornerscenes.room import Surface
from cornerscenes.shape import Material, Part, vertex_normals

mi: Any = mitsuba  # its stubs describe one variant only; which one runs is known at start

# In order of preference; `llvm` needs a shared libLLVM, `cuda` a GPU.
VARIANTS = ("cuda_ad_rgb", "llvm_ad_rgb", "scalar_rgb")

# A ray to a point stops this share of its length short of it, so that the surface the point lies on
# does not hide it: 10 micrometres at one metre.
SHORTENED = 1.0 - 1e-5


@dataclass(frozen=True)
class Light:
    """Sky from above and one square area light.

    Attributes
    ----------
    sky_zenith, sky_horizon : tuple[float, float, float]
        Radiance, linear Rec. 709; the sky blends between them with the sine of elevation.
    area_radiance : float
        Radiance of the area light, white.
    area_position_m : tuple[float, float, float]
        Its centre in the world [m].
    area_size_m : float
        Its side [m].
    aim_m : tuple[float, float, float]
        The point in the world that it faces [m].
    """

    sky_zenith: tuple[float, float, float]
    sky_horizon: tuple[float, float, float]
    area_radiance: float
    area_position_m: tuple[float, float, float]
    area_size_m: float
    aim_m: tuple[float, float, float]


@dataclass(frozen=True)
class Solid:
    """A mesh in the world; all parts of one object share its id."""

    object_id: int
    part: Part
    world_from_object: Float[np.ndarray, "4 4"]


@dataclass(frozen=True)
class Hits:
    """What rays met first: distance [m], object id (0 where nothing), triangle, world normal."""

    distance_m: Float[np.ndarray, " n"]
    object_id: UInt32[np.ndarray, " n"]
    triangle: UInt32[np.ndarray, " n"]
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


class World:
    """A scene as the renderer holds it."""

    def __init__(
        self,
        solids: list[Solid],
        surfaces: tuple[Surface, ...],
        first_surface_id: int,
        light: Light | None,
        max_depth: int,
    ) -> None:
        description: dict[str, Any] = {
            "type": "scene",
            # Measured on the paper's scene: variance times time is the same for 2, 3 and 5.
            "integrator": {"type": "path", "max_depth": max_depth, "rr_depth": 3},
        }
        self._id_of_shape: dict[str, int] = {}
        for index, solid in enumerate(solids):
            name = f"solid{index}"
            description[name] = _mesh(name, solid)
            self._id_of_shape[name] = solid.object_id
        for index, surface in enumerate(surfaces):
            name = f"surface{index}"
            description[name] = _rectangle(name, surface)
            self._id_of_shape[name] = first_surface_id + index
        if light is not None:
            description.update(_lights(light))
        self._scene = mi.load_dict(description)

    def radiance(
        self,
        camera: Camera,
        world_from_camera: Float[np.ndarray, "4 4"],
        oversampling: int,
        window: tuple[int, int, int, int],
        samples: int,
        seed: int,
    ) -> Float[np.ndarray, "h w 3"]:
        """Render linear radiance on the film cells of a window of the sensor.

        Parameters
        ----------
        camera, world_from_camera
            The camera.
        oversampling : int
            Film cells per pixel and direction.
        window : tuple[int, int, int, int]
            First column, first row, one past the last column, one past the last row [px].
        samples : int
            Paths per film cell.
        seed : int
            Seed of the sampler.
        """
        x0, y0, x1, y1 = (oversampling * edge for edge in window)
        flipped = world_from_camera @ np.diag([-1.0, -1.0, 1.0, 1.0])  # Mitsuba: x left, y up
        sensor = mi.load_dict(
            {
                "type": "perspective",
                "fov": float(np.rad2deg(2.0 * np.arctan(0.5 * camera.width / camera.fx_px))),
                "fov_axis": "x",
                "to_world": mi.ScalarTransform4f(flipped),
                "film": {
                    "type": "hdrfilm",
                    "width": oversampling * camera.width,
                    "height": oversampling * camera.height,
                    "crop_offset_x": x0,
                    "crop_offset_y": y0,
                    "crop_width": x1 - x0,
                    "crop_height": y1 - y0,
                    "rfilter": {"type": "box"},
                    "pixel_format": "rgb",
                    "component_format": "float32",
                },
                "sampler": {"type": "multijitter", "sample_count": samples},
            }
        )
        return np.array(mi.render(self._scene, sensor=sensor, spp=samples, seed=seed))

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
        ids = np.zeros(int(shape_index.max(initial=0)) + 1, dtype=np.uint32)
        for shape in self._scene.shapes():
            index = np.array(drjit.reinterpret_array(mi.UInt32, mi.ShapePtr(shape)))[0]
            if index < len(ids):
                ids[index] = self._id_of_shape.get(shape.id(), 0)
        return Hits(
            distance_m=np.where(valid, np.array(found.t, dtype=np.float64), 0.0),
            object_id=np.where(valid, ids[shape_index], 0).astype(np.uint32),
            triangle=np.where(valid, np.array(found.prim_index), 0).astype(np.uint32),
            normal=np.where(valid[:, None], np.array(found.n, dtype=np.float64).T, 0.0),
        )

    def _first_hits_one_by_one(
        self, origin: Float[np.ndarray, "3"], directions: Float[np.ndarray, "n 3"]
    ) -> Hits:
        count = len(directions)
        hits = Hits(
            np.zeros(count),
            np.zeros(count, dtype=np.uint32),
            np.zeros(count, dtype=np.uint32),
            np.zeros((count, 3)),
        )
        for index, direction in enumerate(directions):
            found = self._scene.ray_intersect(mi.Ray3f(origin, direction))
            if found.is_valid():
                hits.distance_m[index] = found.t
                hits.object_id[index] = self._id_of_shape.get(found.shape.id(), 0)
                hits.triangle[index] = found.prim_index
                hits.normal[index] = np.array(found.n)
        return hits


class Occluder:
    """One object's shape, built once, asked from any pose: what placing objects needs."""

    def __init__(self, parts: tuple[Part, ...]) -> None:
        solids = [Solid(0, part, np.eye(4)) for part in parts]
        self._world = World(solids, (), 0, None, 1)

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


def _bsdf(material: Material) -> dict[str, Any]:
    reflectance = {"type": "rgb", "value": list(material.colour)}
    if material.roughness is None:
        bsdf: dict[str, Any] = {"type": "diffuse", "reflectance": reflectance}
    else:
        bsdf = {
            "type": "roughplastic",
            "distribution": "ggx",
            "alpha": material.roughness,
            "diffuse_reflectance": reflectance,
        }
    return {"type": "twosided", "bsdf": bsdf} if material.two_sided else bsdf


def _mesh(name: str, solid: Solid) -> Any:
    part = solid.part
    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict(_bsdf(part.material))
    mesh = mi.Mesh(
        name,
        vertex_count=len(part.vertices),
        face_count=len(part.triangles),
        has_vertex_normals=part.smooth,
        props=properties,
    )
    mesh.set_id(name)
    parameters = mi.traverse(mesh)
    positions = transformed(solid.world_from_object, part.vertices)
    parameters["vertex_positions"] = positions.astype(np.float32).ravel()
    parameters["faces"] = part.triangles.astype(np.uint32).ravel()
    parameters.update()
    if part.smooth:
        # After the positions, whose update makes normals of its own: in parallel, so that their
        # last bits, and with them whole paths, would differ from run to run.
        normals = vertex_normals(positions, part.triangles)
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
    texture = {
        "type": "bitmap",
        "bitmap": mi.Bitmap(np.ascontiguousarray(surface.texture, dtype=np.float32)),
        "raw": True,
    }
    bsdf: dict[str, Any] = {"type": "diffuse", "reflectance": texture}
    if surface.roughness is not None:
        bsdf = {
            "type": "roughplastic",
            "distribution": "ggx",
            "alpha": surface.roughness,
            "diffuse_reflectance": texture,
        }
    return {
        "type": "rectangle",
        "id": name,
        "to_world": mi.ScalarTransform4f(matrix),
        "bsdf": bsdf,
    }


def _lights(light: Light) -> dict[str, Any]:
    elevation = np.linspace(np.pi / 2, -np.pi / 2, 64)  # rows of the map from zenith to nadir
    blend = np.clip(np.sin(elevation), 0.0, 1.0)[:, None]
    sky = (1.0 - blend) * np.array(light.sky_horizon) + blend * np.array(light.sky_zenith)
    sky[elevation < 0.0] = 0.0  # below the floor: no path may be wasted on it
    pixels = np.repeat(sky[:, None, :], 128, axis=1).astype(np.float32)
    towards_aim = looking_at(np.array(light.area_position_m), np.array(light.aim_m))
    scale = np.diag([0.5 * light.area_size_m, 0.5 * light.area_size_m, 1.0, 1.0])
    upright = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]], dtype=np.float64)
    return {
        "sky": {
            "type": "envmap",
            "bitmap": mi.Bitmap(pixels),
            "to_world": mi.ScalarTransform4f(upright),  # Mitsuba's maps have y up
        },
        "area": {
            "type": "rectangle",
            "id": "area",
            "to_world": mi.ScalarTransform4f(towards_aim @ scale),
            "emitter": {
                "type": "area",
                "radiance": {"type": "rgb", "value": [light.area_radiance] * 3},
            },
        },
    }
