"""A mesher for soft bodies.

The surface is the zero level of a distance-like field that is negative inside. It is meshed by
surface nets (one vertex for each grid cell the surface crosses), then relaxed: vertices move to
the middle of their neighbours and are pulled back onto the surface.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from .blob import Blob, evaluate, grid_field
from .mesh import Mesh, compact


def slope(
    blobs: Sequence[Blob], points: Float[np.ndarray, "n 3"], step: float
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
    """Evaluate and differentiate the field.

    Parameters
    ----------
    blobs : sequence of Cone or Ellipsoid
        The body.
    points : Float[np.ndarray, "n 3"]
        Where.
    step : float
        Span of the differences.

    Returns
    -------
    tuple of Float[np.ndarray, " n"] and Float[np.ndarray, "n 3"]
        Value, and gradient (on the surface it points outwards).
    """
    # Four corners of a tetrahedron give value and gradient, exact to second order.
    corners = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    places = (points + 0.5 * step * corners[:, None]).reshape(-1, 3)
    values = evaluate(blobs, places).reshape(4, -1)
    return values.mean(axis=0), values.T @ corners / (2 * step)


def onto_surface(
    blobs: Sequence[Blob], points: Float[np.ndarray, "n 3"], step: float, rounds: int = 2
) -> Float[np.ndarray, "n 3"]:
    """Pull points onto the surface along the gradient.

    Parameters
    ----------
    blobs : sequence of Cone or Ellipsoid
        The body.
    points : Float[np.ndarray, "n 3"]
        Positions near the surface.
    step : float
        The longest move of one round.
    rounds : int
        Number of Newton steps.

    Returns
    -------
    Float[np.ndarray, "n 3"]
        Positions on the surface.
    """
    for _ in range(rounds):
        value, gradient = slope(blobs, points, 0.2 * step)
        size = np.sum(gradient * gradient, axis=1, keepdims=True)
        move = value[:, None] * gradient / np.maximum(size, 0.05)
        points = points - np.clip(move, -step, step)
    return points


def meshed(blobs: Sequence[Blob], cell: float, relaxations: int = 2) -> Mesh:
    """Mesh a melted body.

    Parameters
    ----------
    blobs : sequence of Cone or Ellipsoid
        Its pieces.
    cell : float
        Edge of the grid cells, about the edge length of the triangles.
    relaxations : int
        How often vertices are evened out and pulled back onto the surface.

    Returns
    -------
    Mesh
        The closed surface, facing outwards, with shared vertices.
    """
    low = np.min([blob.bounds()[0] for blob in blobs], axis=0) - 3 * cell
    high = np.max([blob.bounds()[1] for blob in blobs], axis=0) + 3 * cell
    shape = tuple(int(n) for n in np.ceil((high - low) / cell) + 1)
    values = grid_field(blobs, low, shape, cell)
    inside = values < 0

    cells = tuple(n - 1 for n in shape)
    total, hits = np.zeros((*cells, 3)), np.zeros(cells)
    quads = []
    number = np.arange(np.prod(cells)).reshape(cells)
    for axis in range(3):
        # Edges along this axis whose ends lie on different sides cross the surface.
        one, two = np.moveaxis(values, axis, 0)[:-1], np.moveaxis(values, axis, 0)[1:]
        sides = np.moveaxis(inside, axis, 0)
        i, j, k = np.nonzero(sides[:-1] != sides[1:])
        part = one[i, j, k] / (one[i, j, k] - two[i, j, k])
        # The other two axes keep their cyclic order, so that faces turn the right way.
        second, third = (axis + 1) % 3, (axis + 2) % 3
        place = np.empty((len(i), 3), int)
        rest = [a for a in range(3) if a != axis]
        place[:, axis], place[:, rest[0]], place[:, rest[1]] = i, j, k
        crossing = place.astype(float)
        crossing[:, axis] += part
        corners = []
        for shift_second, shift_third in ((-1, -1), (0, -1), (0, 0), (-1, 0)):
            around = place.copy()
            around[:, second] += shift_second
            around[:, third] += shift_third
            x, y, z = around.T
            np.add.at(total, (x, y, z), crossing)
            np.add.at(hits, (x, y, z), 1.0)
            corners.append(number[x, y, z])
        quad = np.stack(corners, axis=1)
        backwards = ~sides[:-1][i, j, k]
        quad[backwards] = quad[backwards][:, ::-1]
        quads.append(quad)
    vertices = (low + cell * total / np.maximum(hits, 1.0)[..., None]).reshape(-1, 3)
    quad = np.concatenate(quads)
    used, renumbered = np.unique(quad, return_inverse=True)
    vertices, quad = vertices[used], renumbered.reshape(-1, 4)
    vertices = _relaxed(blobs, vertices, quad, cell, relaxations)
    # Cut each quad along its shorter diagonal.
    a, b, c, d = (vertices[quad[:, k]] for k in range(4))
    shorter = np.sum((a - c) ** 2, axis=1) < np.sum((b - d) ** 2, axis=1)
    first = np.where(shorter[:, None], quad[:, [0, 1, 2]], quad[:, [0, 1, 3]])
    other = np.where(shorter[:, None], quad[:, [0, 2, 3]], quad[:, [1, 2, 3]])
    return compact(Mesh(vertices, np.concatenate([first, other])))


def _relaxed(
    blobs: Sequence[Blob],
    vertices: Float[np.ndarray, "n 3"],
    quad: Int[np.ndarray, "q 4"],
    cell: float,
    rounds: int,
) -> Float[np.ndarray, "n 3"]:
    """Even out the vertices of a quad mesh on the surface."""
    one, two = quad.ravel(), np.roll(quad, -1, axis=1).ravel()
    degree = np.bincount(one, minlength=len(vertices)) + np.bincount(two, minlength=len(vertices))
    for _ in range(rounds):
        middle = np.empty_like(vertices)
        for k in range(3):
            middle[:, k] = np.bincount(
                one, vertices[two, k], minlength=len(vertices)
            ) + np.bincount(two, vertices[one, k], minlength=len(vertices))
        vertices = 0.4 * vertices + 0.6 * middle / degree[:, None]
        vertices = onto_surface(blobs, vertices, 0.5 * cell, rounds=1)
    return vertices
