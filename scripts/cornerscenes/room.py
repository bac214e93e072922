"""The corner of a room: floor, two walls, and their procedural textures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter

from cornerscenes.streams import stream

Texture = Float[np.ndarray, "h w 3"]


@dataclass(frozen=True)
class Surface:
    """A textured rectangle.

    Attributes
    ----------
    name : str
        What it is.
    corners_m : Float[np.ndarray, "4 3"]
        Its corners in the world [m], counter-clockwise seen from the room.
    texture : Texture
        Diffuse reflectance, linear Rec. 709, row 0 along the first edge.
    roughness : float or None
        GGX roughness of its varnish; `None` for a matt surface.
    """

    name: str
    corners_m: Float[np.ndarray, "4 3"]
    texture: Texture
    roughness: float | None


def room(
    wall_x_m: float, wall_y_m: float, extent_m: float, height_m: float, key: str
) -> tuple[Surface, ...]:
    """Return floor and two walls that meet in a corner at (wall_x_m, wall_y_m).

    Parameters
    ----------
    wall_x_m, wall_y_m : float
        Where the walls stand [m]; the room extends towards smaller x and y.
    extent_m : float
        How far floor and walls reach from the corner [m].
    height_m : float
        Height of the walls [m].
    key : str
        Names the random streams of the textures.
    """
    far_x, far_y = wall_x_m - extent_m, wall_y_m - extent_m
    floor = [[far_x, far_y, 0], [wall_x_m, far_y, 0], [wall_x_m, wall_y_m, 0], [far_x, wall_y_m, 0]]
    wall_x = [
        [wall_x_m, wall_y_m, 0],
        [wall_x_m, far_y, 0],
        [wall_x_m, far_y, height_m],
        [wall_x_m, wall_y_m, height_m],
    ]
    wall_y = [
        [far_x, wall_y_m, 0],
        [wall_x_m, wall_y_m, 0],
        [wall_x_m, wall_y_m, height_m],
        [far_x, wall_y_m, height_m],
    ]
    planks = _planks(stream(key, "planks"), extent_m)
    return (
        Surface("floor", np.array(floor, dtype=np.float64), planks, 0.35),
        Surface(
            "wall_x", np.array(wall_x, dtype=np.float64), _plaster(stream(key, "wall_x")), None
        ),
        Surface(
            "wall_y", np.array(wall_y, dtype=np.float64), _plaster(stream(key, "wall_y")), None
        ),
    )


def _planks(generator: np.random.Generator, extent_m: float) -> Texture:
    """Oak boards 12 cm wide: grain along x, a tone per board, dark joints 2 mm wide."""
    size = 1536
    board_px = round(0.12 / extent_m * size)
    grain = gaussian_filter(generator.standard_normal((size, size)), (0.8, 40.0))
    grain /= grain.std()
    rows = np.arange(size)
    board = rows // board_px
    tone = generator.uniform(0.82, 1.12, board.max() + 1)[board]
    shade = tone[:, None] * (1.0 + 0.06 * grain)
    joint_px = max(1, round(0.002 / extent_m * size))
    shade[rows % board_px < joint_px] *= 0.35
    for index in range(board.max() + 1):  # one butt joint per board and 1.2 m
        start = int(generator.integers(0, size))
        shade[board == index, start : start + joint_px] *= 0.35
    return np.clip(shade[..., None] * np.array([0.42, 0.30, 0.19]), 0.02, 0.9)


def _plaster(generator: np.random.Generator) -> Texture:
    """Painted plaster: nearly uniform, with faint roller marks."""
    size = 512
    marks = gaussian_filter(generator.standard_normal((size, size)), 3.0)
    marks /= marks.std()
    return np.clip((1.0 + 0.012 * marks)[..., None] * np.array([0.44, 0.44, 0.42]), 0.0, 0.95)
