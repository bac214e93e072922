"""The target: a cuboid's vertices, faces and edges, numbered once for renderer and truth.

Vertex i has the sign of bit 0 of i along x, of bit 1 along y, of bit 2 along z; the cuboid stands
on z = 0 of its own frame, its axis the z axis.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from cornerscenes.shape import Material, Part

FACE_NAMES = ("x-", "x+", "y-", "y+", "z-", "z+")

# Vertices of each face, counter-clockwise seen from outside.
FACES = ((0, 4, 6, 2), (1, 3, 7, 5), (0, 1, 5, 4), (2, 6, 7, 3), (0, 2, 3, 1), (4, 5, 7, 6))

NORMALS = np.array(
    [[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]], dtype=np.float64
)

# Pairs of vertices that differ in one coordinate.
EDGES = tuple((a, a | 1 << axis) for axis in range(3) for a in range(8) if not a & 1 << axis)


def faces_of_edge(edge: tuple[int, int]) -> tuple[int, int]:
    """Return the two faces that meet in an edge."""
    first, second = (face for face, corners in enumerate(FACES) if set(edge) <= set(corners))
    return first, second


def faces_of_vertex(vertex: int) -> tuple[int, int, int]:
    """Return the three faces that meet in a vertex."""
    first, second, third = (face for face, corners in enumerate(FACES) if vertex in corners)
    return first, second, third


def vertices(size_m: tuple[float, float, float]) -> Float[np.ndarray, "8 3"]:
    """Return the eight vertices [m] in the cuboid's frame."""
    bits = np.array([[index >> axis & 1 for axis in range(3)] for index in range(8)])
    return (bits - [0.5, 0.5, 0.0]) * size_m


def part(size_m: tuple[float, float, float], material: Material) -> Part:
    """Return the cuboid as a mesh: triangles 2f and 2f + 1 are face f."""
    triangles = [
        [corners[a], corners[b], corners[c]]
        for corners in FACES
        for a, b, c in ((0, 1, 2), (0, 2, 3))
    ]
    return Part("cuboid", vertices(size_m), np.array(triangles), material, smooth=False)


def face_points(
    size_m: tuple[float, float, float], face: int, count: int
) -> Float[np.ndarray, "n 3"]:
    """Return the centres [m] of a count x count grid of cells on a face, in the cuboid's frame."""
    corners = vertices(size_m)[list(FACES[face])]
    steps = (np.arange(count) + 0.5) / count
    along, across = np.meshgrid(steps, steps)
    return (
        corners[0]
        + along.ravel()[:, None] * (corners[1] - corners[0])
        + across.ravel()[:, None] * (corners[3] - corners[0])
    )
