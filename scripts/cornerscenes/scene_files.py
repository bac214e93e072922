"""The files of one scene, as `scenes/FORMAT.md` describes them."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from PIL import Image

from cornerscenes import buffers, exr
from cornerscenes.coverage import coverage
from cornerscenes.dataset import FORMAT, write_json
from cornerscenes.film import CORNER_RADIUS_PX, Film, FilmRenderer, SeenCorner, binned, significant
from cornerscenes.mitsuba_backend import World
from cornerscenes.recipes import FilmRecipe, SceneRecipe
from cornerscenes.scene import TARGET_ID, Scene
from cornerscenes.truth import add_from_film, seen_corners, truth

# Significant bits of the film's radiance and of its variance. The radiance is rounded by 1e-4 of
# itself; its noise per film cell is a hundred times that.
_RADIANCE_BITS = 13
_VARIANCE_BITS = 8

# Significant bits of the depth in the range sensor's footprints: 4 um at 1 m.
_DEPTH_BITS = 17


def write(
    folder: Path,
    scene: Scene,
    world: World,
    recipe: FilmRecipe,
    scene_recipe: SceneRecipe,
    key: str,
) -> float:
    """Render a scene, write its files into a folder, return the target's visible fraction."""
    true = truth(scene, world)
    corners = seen_corners(true)
    film = FilmRenderer(scene, world, recipe, key).film(corners)
    attributes = {
        "cornerbenchScene": key,
        "reconstructionFilter": "box",
        "colourSpace": "linear Rec. 709",
    }
    radiance = significant(film.radiance, _RADIANCE_BITS)
    variance = significant(film.variance, _VARIANCE_BITS)
    exr.write(
        folder / "film.exr",
        (exr.Layer("radiance", _rgb(radiance)), exr.Layer("variance", _rgb(variance))),
        attributes,
    )
    if not film.fovea_px.is_empty:
        covered = coverage(scene, world, recipe.oversampling, film.fovea_px, key)
        exr.write(folder / "coverage.exr", (exr.Layer("coverage", _rgb(covered)),), attributes)
    geometry = buffers.cast_geometry(scene, world)
    exr.write(
        folder / "geometry.exr",
        (
            exr.Layer(
                "geometry",
                {
                    "depth.Z": geometry.depth_m,
                    "normal.X": geometry.normal[..., 0],
                    "normal.Y": geometry.normal[..., 1],
                    "normal.Z": geometry.normal[..., 2],
                    "object.id": geometry.object_id,
                    "face.id": geometry.face_id,
                },
            ),
        ),
        attributes,
    )
    points = buffers.cast_range(scene, world)
    footprints = buffers.cast_footprints(scene, world)
    exr.write(
        folder / "range.exr",
        (
            exr.Layer("range", dict(zip("XYZ", np.moveaxis(points, 2, 0), strict=True))),
            exr.Layer("footprints", {"Z": significant(footprints, _DEPTH_BITS)}),
        ),
        attributes,
    )
    pixels = binned(film.radiance, recipe.oversampling)
    add_from_film(true, pixels, film.variance)
    write_json(folder / "truth.json", true)
    described = description(scene, recipe, scene_recipe, key, film, corners)
    write_json(folder / "scene.json", described)
    _preview(folder / "preview.png", pixels)
    return true["target_visible_fraction"]


def description(
    scene: Scene,
    recipe: FilmRecipe,
    scene_recipe: SceneRecipe,
    key: str,
    film: Film,
    corners: list[SeenCorner],
) -> dict[str, Any]:
    """Return the content of scene.json: all that was resolved."""
    target = scene.target
    return {
        "format": FORMAT,
        "key": key,
        "family": scene_recipe.family,
        "split": scene_recipe.split,
        **scene.names,
        "camera": asdict(scene.camera),
        "lens": None if scene.lens is None else asdict(scene.lens),
        "world_from_camera": _rows(scene.world_from_camera),
        "range_camera": asdict(scene.range_camera),
        "range_oversampling": buffers.RANGE_OVERSAMPLING,
        "world_from_range": _rows(scene.world_from_range),
        "film": {
            "oversampling": recipe.oversampling,
            "reconstruction_filter": "box",
            "fovea_px": list(film.fovea_px),
            "fovea_samples": recipe.fovea_samples,
            "periphery_samples": recipe.periphery_samples,
            "corner_radius_px": CORNER_RADIUS_PX,
            "corners": [
                {"image_point_px": corner.image_point_px.tolist(), "samples": samples}
                for corner, samples in zip(corners, film.corner_samples, strict=True)
            ],
            "max_depth": recipe.max_depth,
        },
        "target": {
            "object_id": TARGET_ID,
            "kind": target.kind,
            "size_m": list(target.size_m),
            "bevel_radius_m": target.bevel_radius_m,
            "is_red": scene.is_red,
            "world_from_target": _rows(target.world_from_target),
            "parts": [
                {
                    "name": part.name,
                    "colour": list(part.material.colour),
                    "roughness": part.material.roughness,
                    "metallic": part.material.metallic,
                }
                for part in target.parts
            ],
        },
        "objects": [
            {
                "object_id": item.object_id,
                "builder": item.builder,
                "role": item.role,
                "height_m": item.height_m,
                "triangles": sum(len(part.triangles) for part in item.shape.parts),
                "world_from_object": _rows(item.world_from_object),
            }
            for item in scene.objects
        ],
        "surfaces": [
            {"name": surface.name, "corners_m": surface.corners_m.tolist()}
            for surface in scene.surfaces
        ],
        "light": asdict(scene.light),
    }


def _rows(pose: np.ndarray) -> list[list[float]]:
    return pose[:3].tolist()


def _rgb(image: np.ndarray) -> dict[str, np.ndarray]:
    return {name: image[..., channel] for channel, name in enumerate("RGB")}


def _preview(path: Path, pixels: Float[np.ndarray, "h w 3"]) -> None:
    linear = np.clip(pixels, 0.0, 1.0)
    encoded = np.where(
        linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055
    )
    Image.fromarray(np.round(encoded * 255.0).astype(np.uint8)).save(path)
