"""Surfaces swept along curves: lathes and tubes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from .grid import grid_triangles, without_points
from .mesh import Mesh


def smooth_curve(
    points: Sequence[Sequence[float] | Float[np.ndarray, " d"]], count: int
) -> Float[np.ndarray, "count d"]:
    """Draw a smooth curve through points (Catmull-Rom, evenly spread in parameter).

    Parameters
    ----------
    points : sequence of points
        At least two points of the same dimension.
    count : int
        Number of samples along the whole curve.

    Returns
    -------
    Float[np.ndarray, "count d"]
        The samples, the first and the last point included.
    """
    given = np.asarray(points, float)
    padded = np.concatenate([[2 * given[0] - given[1]], given, [2 * given[-1] - given[-2]]])
    position = np.linspace(0, len(given) - 1, count)
    piece = np.minimum(position.astype(int), len(given) - 2)
    t = (position - piece)[:, None]
    a, b, c, d = (padded[piece + k] for k in range(4))
    return b + 0.5 * t * (c - a + t * (2 * a - 5 * b + 4 * c - d + t * (3 * (b - c) + d - a)))


def rounded(
    profile: Sequence[tuple[float, float]], radius: float, steps: int = 4
) -> Float[np.ndarray, "k 2"]:
    """Round the inner corners of an open polyline with arcs.

    Parameters
    ----------
    profile : sequence of (float, float)
        The corners; the two ends stay as they are.
    radius : float
        How far from a corner its rounding starts, cut short where the sides are short.
    steps : int
        Number of segments in each rounding.

    Returns
    -------
    Float[np.ndarray, "k 2"]
        The rounded polyline. A point a little outside each arc keeps the straight sides flat
        under smooth shading.
    """
    corners = np.asarray(profile, float)
    result = [corners[0]]
    for before, here, after in zip(corners[:-2], corners[1:-1], corners[2:], strict=True):
        back, on = before - here, after - here
        reach = min(radius, 0.4 * float(np.linalg.norm(back)), 0.4 * float(np.linalg.norm(on)))
        start = here + back / np.linalg.norm(back) * reach
        end = here + on / np.linalg.norm(on) * reach
        t = np.linspace(0, 1, steps + 1)[:, None]
        result.append(start + 0.2 * (start - here))
        result.extend((1 - t) ** 2 * start + 2 * t * (1 - t) * here + t**2 * end)
        result.append(end + 0.2 * (end - here))
    result.append(corners[-1])
    return np.array(result)


def lathe(profile: Sequence[Sequence[float]] | Float[np.ndarray, "k 2"], segments: int) -> Mesh:
    """Turn a profile around the z axis.

    Parameters
    ----------
    profile : Float[np.ndarray, "k 2"]
        Radius and height. From the bottom outwards, up and in again, the outside faces outwards;
        a profile that starts and ends on the axis gives a closed surface.
    segments : int
        Number of steps around the axis.

    Returns
    -------
    Mesh
        The surface, with one vertex for each point of the profile on the axis.
    """
    line = np.asarray(profile, float)
    angle = np.linspace(0, 2 * np.pi, segments, endpoint=False)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    vertices = np.concatenate(
        [
            np.concatenate(
                [
                    line[:, None, :1] * ring,
                    np.broadcast_to(line[:, None, 1:], (len(line), segments, 1)),
                ],
                axis=2,
            ).reshape(-1, 3)
        ]
    )
    index = np.arange(len(line) * segments).reshape(len(line), segments)
    # All the vertices of a ring on the axis are one vertex.
    index[line[:, 0] < 1e-12] = index[line[:, 0] < 1e-12, :1]
    return without_points(Mesh(vertices, grid_triangles(index, wrap=True)))


def frames(
    paths: Float[np.ndarray, "m n 3"],
    up: Sequence[float] | None = None,
    closed: bool = False,
) -> tuple[Float[np.ndarray, "m n 3"], Float[np.ndarray, "m n 3"]]:
    """Find two directions across each point of curves.

    Parameters
    ----------
    paths : Float[np.ndarray, "m n 3"]
        The curves.
    up : sequence of 3 floats or None
        The first direction is this one made perpendicular to the curve; `None` carries it along
        the curve without twist from an arbitrary start.
    closed : bool
        True where the last point of a curve is followed by its first.

    Returns
    -------
    tuple of Float[np.ndarray, "m n 3"]
        First and second direction, unit vectors; tangent = first x second.
    """
    if closed:
        tangent = np.roll(paths, -1, axis=1) - np.roll(paths, 1, axis=1)
    else:
        tangent = np.gradient(paths, axis=1)
    tangent = tangent / np.linalg.norm(tangent, axis=2, keepdims=True)
    first = np.empty_like(tangent)
    if up is not None:
        first[:] = np.asarray(up, float)
        first -= np.sum(first * tangent, axis=2, keepdims=True) * tangent
        first /= np.linalg.norm(first, axis=2, keepdims=True)
    else:
        axis = np.eye(3)[np.argmin(np.abs(tangent[:, 0]), axis=1)]
        for k in range(paths.shape[1]):
            t = tangent[:, k]
            axis = axis - np.sum(axis * t, axis=1, keepdims=True) * t
            axis = axis / np.linalg.norm(axis, axis=1, keepdims=True)
            first[:, k] = axis
    return first, np.cross(tangent, first)


def tubes(
    paths: Float[np.ndarray, "m n 3"],
    radii: Float[np.ndarray, "m n"] | Float[np.ndarray, "m n 2"],
    sides: int,
    up: Sequence[float] | None = None,
    closed: bool = False,
) -> Mesh:
    """Sweep ellipses along curves.

    Parameters
    ----------
    paths : Float[np.ndarray, "m n 3"]
        The curves.
    radii : Float[np.ndarray, "m n"] or Float[np.ndarray, "m n 2"]
        Radius at each point, or the two half axes along the first and the second direction.
    sides : int
        Number of vertices around each tube.
    up : sequence of 3 floats or None
        See `frames`.
    closed : bool
        True for rings; otherwise the ends are closed with flat caps.

    Returns
    -------
    Mesh
        The closed tubes.
    """
    count, length, _ = paths.shape
    half = np.stack([radii, radii], axis=-1) if radii.ndim == 2 else radii
    first, second = frames(paths, up, closed)
    angle = np.linspace(0, 2 * np.pi, sides, endpoint=False)[:, None]
    rings = (
        paths[:, :, None]
        + np.cos(angle) * (first * half[..., :1])[:, :, None]
        + np.sin(angle) * (second * half[..., 1:])[:, :, None]
    )
    index = np.arange(length * sides).reshape(length, sides)
    if closed:
        one = grid_triangles(np.concatenate([index, index[:1]]), wrap=True)
        vertices = rings.reshape(count, -1, 3)
    else:
        tips = length * sides + np.arange(2)
        whole = np.concatenate([np.full((1, sides), tips[0]), index, np.full((1, sides), tips[1])])
        one = grid_triangles(whole, wrap=True)
        one = one[(one[:, 0] != one[:, 1]) & (one[:, 1] != one[:, 2]) & (one[:, 2] != one[:, 0])]
        vertices = np.concatenate([rings.reshape(count, -1, 3), paths[:, [0, -1]]], axis=1)
    starts = np.arange(count)[:, None, None] * vertices.shape[1]
    return Mesh(vertices.reshape(-1, 3), (one + starts).reshape(-1, 3))


def tube(
    path: Sequence[Sequence[float]] | Float[np.ndarray, "n 3"],
    radii: float | Sequence[float] | Float[np.ndarray, " n"] | Float[np.ndarray, "n 2"],
    sides: int,
    up: Sequence[float] | None = None,
    closed: bool = False,
) -> Mesh:
    """Sweep one ellipse along one curve: `tubes` for a single path.

    Parameters
    ----------
    path : Float[np.ndarray, "n 3"]
        The curve.
    radii : float or array
        One radius, one for each point, or two half axes for each point.
    sides : int
        Number of vertices around.
    up : sequence of 3 floats or None
        See `frames`.
    closed : bool
        True for a ring.

    Returns
    -------
    Mesh
        The closed tube.
    """
    line = np.asarray(path, float)
    half = np.asarray(radii, float)
    if half.ndim == 0:
        half = np.full(len(line), float(half))
    return tubes(line[None], half[None], sides, up, closed)
