"""Film, geometry and range of a scene: arrays, before they are files."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt32

from cornerscenes.camera import Camera
from cornerscenes.layout import TARGET_ID, Scene
from cornerscenes.mitsuba_backend import World
from cornerscenes.recipes import FilmRecipe
from cornerscenes.streams import seed

# Face id of what is not the target.
NO_FACE = 255


@dataclass(frozen=True)
class Film:
    """Radiance of a scene.

    Attributes
    ----------
    radiance : Float[np.ndarray, "h w 3"]
        Linear Rec. 709 on the oversampled grid; outside the fovea one value per pixel, repeated.
    variance : Float[np.ndarray, "h w 3"]
        Variance of the mean radiance of each pixel, at sensor resolution.
    fovea_px : tuple[int, int, int, int]
        First column, first row, one past the last column, one past the last row.
    """

    radiance: Float[np.ndarray, "h w 3"]
    variance: Float[np.ndarray, "h w 3"]
    fovea_px: tuple[int, int, int, int]


@dataclass(frozen=True)
class Geometry:
    """What one ray through each pixel's centre meets: z-depth [m], normal, object id, face id."""

    depth_m: Float[np.ndarray, "h w"]
    normal: Float[np.ndarray, "h w 3"]
    object_id: UInt32[np.ndarray, "h w"]
    face_id: UInt32[np.ndarray, "h w"]


def render_film(
    scene: Scene,
    world: World,
    recipe: FilmRecipe,
    key: str,
    target_px: Float[np.ndarray, "8 2"],
) -> Film:
    """Render the film: finely in the target's box and its margin, one value per pixel elsewhere."""
    camera, scale = scene.camera, recipe.oversampling
    low = np.floor(target_px.min(axis=0)).astype(int) - recipe.margin_px
    high = np.ceil(target_px.max(axis=0)).astype(int) + recipe.margin_px + 1
    x0, y0 = np.clip(low, 0, [camera.width, camera.height])
    x1, y1 = np.clip(high, 0, [camera.width, camera.height])
    fovea = (int(x0), int(y0), int(x1), int(y1))
    whole = (0, 0, camera.width, camera.height)
    coarse, coarse_variance = _passes(
        scene, world, recipe.passes, recipe.periphery_samples, 1, whole, f"{key}/periphery"
    )
    radiance = np.repeat(np.repeat(coarse, scale, axis=0), scale, axis=1)
    variance = coarse_variance
    if x1 > x0 and y1 > y0:
        fine, fine_variance = _passes(
            scene, world, recipe.passes, recipe.fovea_samples, scale, fovea, f"{key}/fovea"
        )
        radiance[scale * y0 : scale * y1, scale * x0 : scale * x1] = fine
        variance[y0:y1, x0:x1] = fine_variance
    return Film(radiance, variance, fovea)


def _passes(
    scene: Scene,
    world: World,
    passes: int,
    samples: int,
    scale: int,
    window: tuple[int, int, int, int],
    key: str,
) -> tuple[Float[np.ndarray, "h w 3"], Float[np.ndarray, "h w 3"]]:
    """Return the mean of independent passes and the variance of its pixel means."""
    height, width = window[3] - window[1], window[2] - window[0]
    images, binned = [], []
    for index in range(passes):
        image = world.radiance(
            scene.camera,
            scene.world_from_camera,
            scale,
            window,
            samples // passes,
            seed(key, index),
        )
        images.append(image)
        cells = image.reshape(height, scale, width, scale, 3)
        binned.append(cells.mean(axis=(1, 3), dtype=np.float64))
    mean = np.stack(images).mean(axis=0, dtype=np.float64)
    variance = np.stack(binned).var(axis=0, ddof=1) / passes
    return mean.astype(np.float32), variance.astype(np.float32)


def cast_geometry(scene: Scene, world: World) -> Geometry:
    """Cast one ray through each pixel's centre."""
    camera = scene.camera
    rays, directions = _rays(scene, camera)
    hits = world.first_hits(scene.world_from_camera[:3, 3], directions)
    depth = hits.distance_m / np.linalg.norm(rays, axis=1)
    face = np.where(hits.object_id == TARGET_ID, hits.triangle // 2, NO_FACE)
    shape = camera.height, camera.width
    return Geometry(
        depth_m=depth.reshape(shape).astype(np.float32),
        normal=hits.normal.reshape(*shape, 3).astype(np.float32),
        object_id=hits.object_id.reshape(shape),
        face_id=face.astype(np.uint32).reshape(shape),
    )


def cast_range(scene: Scene, world: World) -> Float[np.ndarray, "h w 3"]:
    """Return the camera-frame point [m] that each range cell's ray meets; 0 where nothing."""
    camera = scene.range_camera
    rays, directions = _rays(scene, camera)
    hits = world.first_hits(scene.world_from_camera[:3, 3], directions)
    points = rays * (hits.distance_m / np.linalg.norm(rays, axis=1))[:, None]
    return points.reshape(camera.height, camera.width, 3).astype(np.float32)


def _rays(
    scene: Scene, camera: Camera
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """Return a camera's rays scaled to z = 1, and the same as unit directions in the world."""
    rays = camera.rays(camera.pixel_centres())
    directions = rays @ scene.world_from_camera[:3, :3].T
    return rays, directions / np.linalg.norm(directions, axis=1, keepdims=True)
