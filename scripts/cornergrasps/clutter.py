"""What stands around the target as convex pieces, which is what physics engines collide."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull

from cornerscenes.shape import Part

# Side of the cells that what is not convex is cut into [m]: a piece stands out by less.
CELL_M = 0.03

# Pieces are this thick at least [m]: a flat one has no volume.
THICKNESS_M = 0.002

# What fills so much of its hull is convex.
_CONVEX_SHARE = 0.97

Points = Float[np.ndarray, "n 3"]


def is_soft(part: Part) -> bool:
    """Return whether a part gives way when it is touched: a sheet, such as a leaf."""
    return part.material.two_sided


def pieces(parts: Sequence[Part]) -> list[Points]:
    """Return points [m] whose convex hulls together are the parts that do not give way.

    Parameters
    ----------
    parts : Sequence[Part]
        An object's, in its own frame.
    """
    found = []
    for part in parts:
        if is_soft(part):
            continue
        for vertices, triangles in _components(part):
            if np.ptp(vertices, axis=0).max() <= CELL_M or _is_convex(vertices, triangles):
                found.append(_thick(vertices, triangles))
            else:
                found.extend(_cells(*_fine(vertices, triangles)))
    return found


def surface_points(vertices: Points, triangles: Int[np.ndarray, "m 3"], spacing_m: float) -> Points:
    """Return points on a mesh that are no farther from each other than about this [m]."""
    return _fine(vertices, triangles, spacing_m)[0]


def _components(part: Part) -> list[tuple[Points, Int[np.ndarray, "m 3"]]]:
    """Return what of a part hangs together; vertices at the same place are one."""
    vertices, same = np.unique(part.vertices.round(7), axis=0, return_inverse=True)
    triangles = same.reshape(-1)[part.triangles]
    ends = np.concatenate([triangles[:, :2], triangles[:, 1:]])
    graph = coo_array((np.ones(len(ends)), ends.T), shape=(len(vertices),) * 2)
    count, label = connected_components(graph, directed=False)
    found = []
    for index in range(count):
        own = triangles[label[triangles[:, 0]] == index]
        if len(own):
            used, renumbered = np.unique(own, return_inverse=True)
            found.append((vertices[used], renumbered.reshape(own.shape)))
    return found


def _is_convex(vertices: Points, triangles: Int[np.ndarray, "m 3"]) -> bool:
    """Return whether a mesh, closed, fills its hull."""
    a, b, c = (vertices - vertices.mean(axis=0))[triangles].transpose(1, 0, 2)
    volume = abs(np.einsum("ij,ij->i", a, np.cross(b, c)).sum()) / 6.0
    try:
        return volume >= _CONVEX_SHARE * ConvexHull(vertices).volume
    except Exception:  # flat: qhull has no hull of it
        return False


def _fine(
    vertices: Points, triangles: Int[np.ndarray, "m 3"], longest_m: float = CELL_M
) -> tuple[Points, Int[np.ndarray, "m 3"]]:
    """Halve edges until none is longer."""
    while True:
        corners = vertices[triangles]
        lengths = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
        longest = lengths.argmax(axis=1)
        is_long = lengths.max(axis=1) > longest_m
        if not is_long.any():
            return vertices, triangles
        long, first = triangles[is_long], longest[is_long]
        row = np.arange(len(long))
        a, b, c = (long[row, (first + step) % 3] for step in range(3))
        middle = len(vertices) + row
        vertices = np.concatenate([vertices, 0.5 * (vertices[a] + vertices[b])])
        halves = [np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)]
        triangles = np.concatenate([triangles[~is_long], *halves])


def _cells(vertices: Points, triangles: Int[np.ndarray, "m 3"]) -> list[Points]:
    """Cut a mesh of short edges by a grid."""
    centres = vertices[triangles].mean(axis=1)
    _, cell = np.unique(np.floor(centres / CELL_M).astype(int), axis=0, return_inverse=True)
    order = np.argsort(cell.reshape(-1), kind="stable")
    starts = np.flatnonzero(np.diff(cell.reshape(-1)[order])) + 1
    return [_thick(vertices, triangles[own]) for own in np.split(order, starts)]


def _thick(vertices: Points, triangles: Int[np.ndarray, "m 3"]) -> Points:
    """Return a mesh's corners, and the same a little inwards."""
    corners = vertices[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    inwards = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0.0)
    both = np.concatenate([corners, corners - THICKNESS_M * inwards[:, None]])
    return np.unique(both.reshape(-1, 3), axis=0)
