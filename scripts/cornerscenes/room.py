"""The corner of a room: floor, two walls, and what hangs on them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from cornerscenes.shape import Texture


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
    repeats : tuple[float, float]
        How often the texture is repeated along the first and the last edge.
    roughness : float or None
        GGX roughness of its varnish; `None` for a matt surface.
    is_decal : bool
        Whether it lies on another surface, so that its outline is seen.
    """

    name: str
    corners_m: Float[np.ndarray, "4 3"]
    texture: Texture
    repeats: tuple[float, float] = (1.0, 1.0)
    roughness: float | None = None
    is_decal: bool = False


def corners(
    wall_x_m: float, wall_y_m: float, extent_m: float, height_m: float
) -> dict[str, Float[np.ndarray, "4 3"]]:
    """Return the corners of floor and two walls that meet at (wall_x_m, wall_y_m) [m].

    The room extends towards smaller x and y, floor and walls reach `extent_m` from the corner, the
    walls are `height_m` high.
    """
    far_x, far_y = wall_x_m - extent_m, wall_y_m - extent_m
    found = {
        "floor": [
            [far_x, far_y, 0],
            [wall_x_m, far_y, 0],
            [wall_x_m, wall_y_m, 0],
            [far_x, wall_y_m, 0],
        ],
        "wall_x": [
            [wall_x_m, wall_y_m, 0],
            [wall_x_m, far_y, 0],
            [wall_x_m, far_y, height_m],
            [wall_x_m, wall_y_m, height_m],
        ],
        "wall_y": [
            [far_x, wall_y_m, 0],
            [wall_x_m, wall_y_m, 0],
            [wall_x_m, wall_y_m, height_m],
            [far_x, wall_y_m, height_m],
        ],
    }
    return {name: np.array(points, dtype=np.float64) for name, points in found.items()}


def stripe(
    wall: Float[np.ndarray, "4 3"], low_m: float, high_m: float, texture: Texture
) -> Surface:
    """Return a level stripe on a wall, between two heights [m], half a millimetre before it."""
    first, second, _, fourth = wall
    normal = np.cross(second - first, fourth - first)
    before = 5e-4 * normal / np.linalg.norm(normal)
    up = (fourth - first) / np.linalg.norm(fourth - first)
    points = [first + low_m * up, second + low_m * up, second + high_m * up, first + high_m * up]
    return Surface("stripe", np.array(points) + before, texture, is_decal=True)
