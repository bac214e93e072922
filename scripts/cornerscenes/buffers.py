"""Geometry and range of a scene: arrays, before they are files."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt32

from cornerscenes.camera import Camera
from cornerscenes.mitsuba_backend import World
from cornerscenes.scene import Scene

# Rays across a cell of the range sensor, and down.
RANGE_OVERSAMPLING = 8


@dataclass(frozen=True)
class Geometry:
    """What one ray through each pixel's centre meets: z-depth [m], normal, object id, face id."""

    depth_m: Float[np.ndarray, "h w"]
    normal: Float[np.ndarray, "h w 3"]
    object_id: UInt32[np.ndarray, "h w"]
    face_id: UInt32[np.ndarray, "h w"]


def cast_geometry(scene: Scene, world: World) -> Geometry:
    """Cast one ray through each pixel's centre."""
    camera = scene.camera
    rays, directions = _rays(scene.world_from_camera, camera)
    hits = world.first_hits(scene.eye_m, directions)
    depth = hits.distance_m / np.linalg.norm(rays, axis=1)
    shape = camera.height, camera.width
    return Geometry(
        depth_m=depth.reshape(shape).astype(np.float32),
        normal=hits.normal.reshape(*shape, 3).astype(np.float32),
        object_id=hits.object_id.reshape(shape),
        face_id=hits.face_id.reshape(shape),
    )


def cast_range(scene: Scene, world: World) -> Float[np.ndarray, "h w 3"]:
    """Return the point in the range sensor's frame [m] that each cell's ray meets; 0 where none."""
    camera = scene.range_camera
    rays, directions = _rays(scene.world_from_range, camera)
    hits = world.first_hits(scene.world_from_range[:3, 3], directions)
    points = rays * (hits.distance_m / np.linalg.norm(rays, axis=1))[:, None]
    return points.reshape(camera.height, camera.width, 3).astype(np.float32)


def cast_footprints(scene: Scene, world: World) -> Float[np.ndarray, "h w"]:
    """Return the z-depth [m] that rays all over the range sensor's cells meet; 0 where none.

    Every cell is divided into RANGE_OVERSAMPLING x RANGE_OVERSAMPLING parts, a ray through the
    middle of each.
    """
    camera = scene.range_camera.finer(RANGE_OVERSAMPLING)
    rays, directions = _rays(scene.world_from_range, camera)
    hits = world.first_hits(scene.world_from_range[:3, 3], directions)
    depth = hits.distance_m / np.linalg.norm(rays, axis=1)
    return depth.reshape(camera.height, camera.width).astype(np.float32)


def _rays(
    world_from_camera: Float[np.ndarray, "4 4"], camera: Camera
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """Return a camera's rays scaled to z = 1, and the same as unit directions in the world."""
    rays = camera.rays(camera.pixel_centres())
    directions = rays @ world_from_camera[:3, :3].T
    return rays, directions / np.linalg.norm(directions, axis=1, keepdims=True)
