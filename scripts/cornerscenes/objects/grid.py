"""Grids of points joined to sheets, and convex solids."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import ConvexHull

from .mesh import Mesh


def grid_triangles(index: Int[np.ndarray, "rows columns"], wrap: bool) -> Int[np.ndarray, "m 3"]:
    """Join a grid of vertices with triangles.

    Parameters
    ----------
    index : Int[np.ndarray, "rows columns"]
        The vertex at each node. With columns to the right and rows upwards it is seen from
        outside.
    wrap : bool
        True to join the last column to the first.

    Returns
    -------
    Int[np.ndarray, "m 3"]
        Two triangles for each cell.
    """
    right = np.roll(index, -1, axis=1)
    if not wrap:
        index, right = index[:, :-1], right[:, :-1]
    a, b, c, d = index[:-1], right[:-1], right[1:], index[1:]
    return np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)


def without_points(mesh: Mesh) -> Mesh:
    """Drop triangles with a repeated vertex, and vertices no longer used.

    Parameters
    ----------
    mesh : Mesh
        A mesh in which some cells have collapsed, as at the pole of a sphere.

    Returns
    -------
    Mesh
        The same surface.
    """
    t = mesh.triangles
    t = t[(t[:, 0] != t[:, 1]) & (t[:, 1] != t[:, 2]) & (t[:, 2] != t[:, 0])]
    used, numbers = np.unique(t, return_inverse=True)
    return Mesh(mesh.vertices[used], numbers.reshape(-1, 3))


def sheets(
    points: Float[np.ndarray, "n rows columns 3"],
    chosen: Bool[np.ndarray, "n rows_1 columns_1"] | None = None,
) -> Mesh:
    """Mesh grids of points, or some of their cells.

    Parameters
    ----------
    points : Float[np.ndarray, "n rows columns 3"]
        Positions of the nodes of each sheet.
    chosen : Bool[np.ndarray, "n rows_1 columns_1"] or None
        True for the cells (one fewer each way than nodes) to keep; `None` keeps all.

    Returns
    -------
    Mesh
        Open sheets, with vertices shared inside each sheet.
    """
    count, rows, columns, _ = points.shape
    index = np.arange(count * rows * columns).reshape(count, rows, columns)
    a, b = index[:, :-1, :-1], index[:, :-1, 1:]
    c, d = index[:, 1:, 1:], index[:, 1:, :-1]
    cells = np.stack([a, b, c, a, c, d], axis=-1)
    if chosen is not None:
        cells = cells[chosen]
    return without_points(Mesh(points.reshape(-1, 3), cells.reshape(-1, 3)))


def convex(points: Float[np.ndarray, "n 3"]) -> Mesh:
    """Wrap points in their convex hull.

    Parameters
    ----------
    points : Float[np.ndarray, "n 3"]
        Corners, not all in a plane.

    Returns
    -------
    Mesh
        The closed hull.
    """
    hull = ConvexHull(points)
    t = hull.simplices.astype(np.int64)
    a, b, c = (points[t[:, k]] for k in range(3))
    inward = np.sum(np.cross(b - a, c - a) * hull.equations[:, :3], axis=1) < 0
    t[inward] = t[inward][:, ::-1]
    return without_points(Mesh(points, t))


def box(size: Sequence[float], bevel: float) -> Mesh:
    """Make a box with bevelled edges, centred on the origin; shade it flat.

    Parameters
    ----------
    size : sequence of 3 floats
        Full extents along x, y and z.
    bevel : float
        How much each edge is cut back.

    Returns
    -------
    Mesh
        The closed box.
    """
    half = np.asarray(size, float) / 2
    signs = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3, indexing="ij")).reshape(3, -1).T
    corners = [signs * (half - bevel * (1 - np.eye(3)[k])) for k in range(3)]
    return convex(np.concatenate(corners))
