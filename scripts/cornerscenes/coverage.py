"""The coverage of the target: how much of each film cell each of its regions fills, as seen."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from cornerscenes.film import Window, significant
from cornerscenes.mitsuba_backend import World, target_solids
from cornerscenes.scene import Scene
from cornerscenes.shape import Rgb
from cornerscenes.streams import seed

# Samples of a film cell: a power of four, as the sampler wants.
SAMPLES = 64

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
    image = shining.radiance(
        scene.camera,
        scene.world_from_camera,
        oversampling,
        fovea,
        SAMPLES,
        seed(f"{key}/coverage"),
        scene.lens,
    )
    return significant(image, bits=8)


def _radiances(scene: Scene) -> list[Rgb]:
    parts = scene.target.parts
    if scene.target.kind == "board":
        return [_CHANNELS[0] if part.name == "black" else _CHANNELS[1] for part in parts]
    facing = sorted(scene.target.facing(scene.eye_m))
    return [_CHANNELS[facing.index(p.face)] if p.face in facing else _DARK for p in parts]
