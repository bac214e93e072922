"""The files of one scene, as `scenes/FORMAT.md` describes them."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from cornerscenes import buffers, exr
from cornerscenes.dataset import FORMAT, write_json
from cornerscenes.layout import TARGET_ID, Scene
from cornerscenes.recipes import FilmRecipe, SceneRecipe
from cornerscenes.truth import image_of, truth


def write(
    folder: Path, scene: Scene, recipe: FilmRecipe, scene_recipe: SceneRecipe, key: str
) -> float:
    """Render a scene, write its files into a folder, return the target's visible fraction."""
    world = scene.world(recipe.max_depth)
    film = buffers.render_film(
        scene, world, recipe, key, image_of(scene, scene.target.vertices_m())
    )
    geometry = buffers.cast_geometry(scene, world)
    attributes = {
        "cornerbenchScene": key,
        "reconstructionFilter": "box",
        "colourSpace": "linear Rec. 709",
    }
    exr.write(
        folder / "film.exr",
        (
            exr.Layer("radiance", _rgb(film.radiance)),
            exr.Layer("variance", _rgb(film.variance)),
        ),
        attributes,
    )
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
    exr.write(
        folder / "range.exr",
        (exr.Layer("range", dict(zip("XYZ", np.moveaxis(points, 2, 0), strict=True))),),
        attributes,
    )
    true = truth(scene, world)
    write_json(folder / "truth.json", true)
    write_json(folder / "scene.json", description(scene, recipe, scene_recipe, key, film.fovea_px))
    _preview(folder / "preview.png", film, recipe.oversampling)
    return true["target_visible_fraction"]


def description(
    scene: Scene,
    recipe: FilmRecipe,
    scene_recipe: SceneRecipe,
    key: str,
    fovea_px: tuple[int, int, int, int],
) -> dict[str, Any]:
    """Return the content of scene.json: all that was resolved."""
    return {
        "format": FORMAT,
        "key": key,
        "family": scene_recipe.family,
        "pose": scene_recipe.pose,
        "camera": asdict(scene.camera),
        "range_camera": asdict(scene.range_camera),
        "world_from_camera": _rows(scene.world_from_camera),
        "film": {
            "oversampling": recipe.oversampling,
            "reconstruction_filter": "box",
            "fovea_px": list(fovea_px),
            "fovea_samples": recipe.fovea_samples,
            "periphery_samples": recipe.periphery_samples,
            "passes": recipe.passes,
            "max_depth": recipe.max_depth,
        },
        "target": {
            "object_id": TARGET_ID,
            "size_m": list(scene.target.size_m),
            "world_from_cuboid": _rows(scene.target.world_from_cuboid),
            "colour": list(scene.target.material.colour),
            "roughness": scene.target.material.roughness,
        },
        "objects": [
            {
                "object_id": item.object_id,
                "builder": item.builder,
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


def _preview(path: Path, film: buffers.Film, scale: int) -> None:
    height, width, _ = film.radiance.shape
    cells = film.radiance.reshape(height // scale, scale, width // scale, scale, 3)
    linear = np.clip(cells.mean(axis=(1, 3)), 0.0, 1.0)
    encoded = np.where(
        linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055
    )
    Image.fromarray(np.round(encoded * 255.0).astype(np.uint8)).save(path)
