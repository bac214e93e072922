"""The checkerboard: the flat target on which most published sub-pixel figures were made.

It lies in its own xy plane, its pattern on z = `THICKNESS_M`, centred. Both counts of squares are
odd, so all four outer squares are black and every vertex of the pattern is a corner: an X inside,
an L on the rim.
"""

from __future__ import annotations

import numpy as np

from cornerscenes.shape import Material, Part, Rgb
from cornerscenes.target import Wireframe

THICKNESS_M = 0.004

BLACK: Rgb = (0.03, 0.03, 0.03)
WHITE: Rgb = (0.80, 0.80, 0.80)


def size_m(columns: int, rows: int, square_m: float) -> tuple[float, float, float]:
    """Return the board's extent [m]: the pattern and a margin of one square."""
    return (columns + 2) * square_m, (rows + 2) * square_m, THICKNESS_M


def is_black(column: int, row: int, columns: int, rows: int) -> bool:
    """Return whether a square is black; the margin is not."""
    return 0 <= column < columns and 0 <= row < rows and (column + row) % 2 == 0


def wireframe(columns: int, rows: int, square_m: float) -> Wireframe:
    """Return the pattern's vertices, row by row, the edges between black and white, the pattern."""
    wide, high = columns + 1, rows + 1
    y, x = np.mgrid[0:high, 0:wide]
    vertices = np.stack(
        [
            (x.ravel() - 0.5 * columns) * square_m,
            (y.ravel() - 0.5 * rows) * square_m,
            np.full(x.size, THICKNESS_M),
        ],
        axis=1,
    )

    def differ(first: tuple[int, int], second: tuple[int, int]) -> bool:
        return is_black(*first, columns, rows) != is_black(*second, columns, rows)

    edges = [
        (row * wide + column, row * wide + column + 1)
        for row in range(high)
        for column in range(columns)
        if differ((column, row - 1), (column, row))
    ]
    edges += [
        (row * wide + column, (row + 1) * wide + column)
        for row in range(rows)
        for column in range(wide)
        if differ((column - 1, row), (column, row))
    ]
    return Wireframe(
        vertices_m=vertices,
        edges=tuple(edges),
        edge_faces=((0, 0),) * len(edges),
        faces=((0, columns, high * wide - 1, rows * wide),),
        face_names=("pattern",),
        normals=np.array([[0.0, 0.0, 1.0]]),
    )


def parts(columns: int, rows: int, square_m: float, roughness: float | None) -> tuple[Part, ...]:
    """Return the board's meshes: black squares, white squares with margin, sides and back."""
    found = []
    for name, colour, black in (("black", BLACK, True), ("white", WHITE, False)):
        squares = [
            (column, row)
            for row in range(-1, rows + 1)
            for column in range(-1, columns + 1)
            if is_black(column, row, columns, rows) == black
        ]
        quads = np.array([[[0, 0], [1, 0], [1, 1], [0, 1]]]) + np.array(squares)[:, None, :]
        flat = (quads - [0.5 * columns, 0.5 * rows]) * square_m
        points = np.concatenate([flat, np.full((*flat.shape[:2], 1), THICKNESS_M)], axis=2)
        points = points.reshape(-1, 3)
        starts = 4 * np.arange(len(squares))[:, None, None]
        triangles = (starts + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
        material = Material(colour, roughness)
        found.append(Part(name, points, triangles, material, smooth=False, face=0))
    return (*found, _body(size_m(columns, rows, square_m)))


def _body(size: tuple[float, float, float]) -> Part:
    """Return sides and back."""
    bits = np.array([[index >> axis & 1 for axis in range(3)] for index in range(8)])
    points = (bits - [0.5, 0.5, 0.0]) * size
    sides = ((0, 4, 6, 2), (1, 3, 7, 5), (0, 1, 5, 4), (2, 6, 7, 3), (0, 2, 3, 1))
    triangles = [[q[i], q[j], q[k]] for q in sides for i, j, k in ((0, 1, 2), (0, 2, 3))]
    return Part("body", points, np.array(triangles), Material(WHITE), smooth=False)
