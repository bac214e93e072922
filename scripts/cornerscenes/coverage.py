"""The coverage of the target: how much of each film cell each of its regions fills, as seen."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from cornerscenes.film import Window, significant
from cornerscenes.mitsuba_backend import World, target_solids
from cornerscenes.scene import Scene
from cornerscenes.shape import Rgb

# Samples of a film cell in a pass. Where a pixel shows more than one region, passes are averaged.
SAMPLES = 16
PASSES = 4

_CHANNELS: tuple[Rgb, ...] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
_DARK: Rgb = (0.0, 0.0, 0.0)


def coverage(
    scene: Scene, world: World, oversampling: int, fovea: Window, key: str
) -> Float[np.ndarray, "h w 3"]:
    """Return the share of each film cell of the fovea in which regions of the target are seen.

    Of a cuboid the channels are its facing faces, in the order of their indices, without rounded
    edges; of a board its black squares, and all else of it.

    Parameters
    ----------
    scene : Scene
        The scene.
    world : World
        The same scene as the renderer holds it.
    oversampling : int
        Film cells per pixel and direction.
    fovea : Window
        Where [px].
    key : str
        Names the random stream.
    """
    solids = target_solids(scene)
    shining = world.shining(list(zip(solids, _radiances(scene), strict=True)))
    view = shining.seen_by(scene.camera, scene.world_from_camera, scene.lens)
    samples = SAMPLES * oversampling**2
    pixels = fovea.pixels()

    def covered(pixels: Int[np.ndarray, "n 2"], passes: int, name: str) -> np.ndarray:
        images = view.passes(pixels, 1, oversampling, samples, passes, f"{key}/coverage/{name}")
        return np.mean(list(images), axis=0)

    cells = covered(pixels, 1, "all")
    mixed = (np.ptp(cells, axis=(1, 2)) > 0.0).any(axis=1) | (cells % 1.0 > 0.0).any(axis=(1, 2, 3))
    if mixed.any():
        more = covered(pixels[mixed], PASSES - 1, "mixed")
        cells[mixed] += (more - cells[mixed]) * (PASSES - 1) / PASSES
    return significant(fovea.image_of(cells), bits=8)


def _radiances(scene: Scene) -> list[Rgb]:
    parts = scene.target.parts
    if scene.target.kind == "board":
        return [_CHANNELS[0] if part.name == "black" else _CHANNELS[1] for part in parts]
    facing = sorted(scene.target.facing(scene.eye_m))
    return [_CHANNELS[facing.index(p.face)] if p.face in facing else _DARK for p in parts]
