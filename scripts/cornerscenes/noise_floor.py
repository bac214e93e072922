"""The render noise floor: how well a corner could be located if the render's noise were all.

An edge whose position is known over a length L carries lambda L of information on its place across,
lambda = A^2 / (2 sqrt(pi) sigma_e sigma_n^2), for a contrast A, noise sigma_n per pixel and a blur
of standard deviation sigma_e, the pixel's box included; a quarter of it where the edge's direction
is unknown, too. A corner's covariance is the inverse of the sum over its edges.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np
from jaxtyping import Float

# Length of an edge that counts [px].
LONGEST_PX = 10.0

# How far to either side of an edge its contrast is taken [px].
_OFFSET_PX = 1.5

# Share of the information on an edge's place that is left when its direction is unknown.
_ANGLE_UNKNOWN = 0.25

_BOX_VARIANCE_PX2 = 1.0 / 12.0


@dataclass(frozen=True)
class SeenEdge:
    """An edge as seen from one of its ends.

    Attributes
    ----------
    direction : Float[np.ndarray, "2"]
        Unit vector in the image, away from the corner.
    visible_length_px : float
        How far it is seen from the corner.
    """

    direction: Float[np.ndarray, "2"]
    visible_length_px: float


@dataclass(frozen=True)
class Sides:
    """What the film shows to both sides of an edge: means over its first pixels.

    Attributes
    ----------
    contrast : Float[np.ndarray, "3"]
        Radiance to the right of the direction minus that to the left (right as seen with y down).
    variance : Float[np.ndarray, "3"]
        The render's variance of one pixel.
    """

    contrast: Float[np.ndarray, "3"]
    variance: Float[np.ndarray, "3"]


def sides(
    radiance: Float[np.ndarray, "h w 3"],
    variance: Float[np.ndarray, "h w 3"],
    corner_px: Float[np.ndarray, "2"],
    edge: SeenEdge,
) -> Sides | None:
    """Return what is to both sides of an edge, or `None` where too little of it is in the image.

    Parameters
    ----------
    radiance, variance
        Of the pixels, at sensor resolution.
    corner_px : Float[np.ndarray, "2"]
        Where the edge starts.
    edge : SeenEdge
        The edge.
    """
    length = min(edge.visible_length_px, LONGEST_PX)
    if length < 1.0:
        return None
    # Not the first pixels, where the corner's other edges are near.
    along = corner_px + np.linspace(0.35 * length, length, 24)[:, None] * edge.direction
    right = np.array([-edge.direction[1], edge.direction[0]])
    offset = min(_OFFSET_PX, 0.35 * length) * right
    found = []
    for points in (along + offset, along - offset):
        x, y = np.round(points).astype(int).T
        inside = (x >= 0) & (y >= 0) & (x < radiance.shape[1]) & (y < radiance.shape[0])
        if inside.sum() < 8:
            return None
        x, y = x[inside], y[inside]
        found.append((np.median(radiance[y, x], axis=0), variance[y, x].mean(axis=0)))
    (to_right, variance_right), (to_left, variance_left) = found
    return Sides(to_right - to_left, 0.5 * (variance_right + variance_left))


def noise_floor_px(
    edges: list[tuple[SeenEdge, Sides | None]], blur_px: float = 0.0
) -> float | None:
    """Return the root mean square error that the render's noise alone enforces [px].

    The information of the three channels is added up. Their noise is correlated, but with the full
    covariance of the channels the result is the same to a tenth (measured on scenes of `quick`).
    `None` where fewer than two edges that are seen cross at the corner, or have no contrast at all.

    Parameters
    ----------
    edges : list[tuple[SeenEdge, Sides | None]]
        The corner's edges and what is to their sides.
    blur_px : float
        Standard deviation of the optics' blur.
    """
    sigma_e = sqrt(blur_px**2 + _BOX_VARIANCE_PX2)
    information = np.zeros((2, 2))
    for edge, side in edges:
        if side is None:
            continue
        signal = float((side.contrast**2 / np.maximum(side.variance, 1e-20)).sum())
        per_px = signal / (2.0 * sqrt(np.pi) * sigma_e)
        normal = np.array([-edge.direction[1], edge.direction[0]])
        length = min(edge.visible_length_px, LONGEST_PX)
        information += _ANGLE_UNKNOWN * per_px * length * np.outer(normal, normal)
    smallest, largest = np.linalg.eigvalsh(information)
    if smallest <= 1e-9 * largest:
        return None
    return sqrt(1.0 / smallest + 1.0 / largest)
