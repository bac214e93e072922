"""Soft bodies: ellipsoids and rounded cones melted together, and a mesher for what results.

The surface is the zero level of a distance-like field that is negative inside. It is meshed by
surface nets (one vertex for each grid cell the surface crosses), then relaxed: vertices move to
the middle of their neighbours and are pulled back onto the surface.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int

from .mesh import Mesh, compact

# Value of the field far from every piece, where its size does not matter.
FAR = 1.0


@dataclass(frozen=True)
class Cone:
    """A rounded cone: all spheres between two end spheres.

    Attributes
    ----------
    start, end : Float[np.ndarray, "3"]
        Centres of the end spheres.
    start_radius, end_radius : float
        Their radii.
    blend : float
        Over which distance it melts into what was there before.
    """

    start: Float[np.ndarray, "3"]
    end: Float[np.ndarray, "3"]
    start_radius: float
    end_radius: float
    blend: float

    def distance(self, points: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "..."]:
        """Measure how far points are outside.

        Parameters
        ----------
        points : Float[np.ndarray, "... 3"]
            Positions.

        Returns
        -------
        Float[np.ndarray, "..."]
            Distance, negative inside.
        """
        axis = self.end - self.start
        length = float(np.linalg.norm(axis))
        axis = axis / length
        offset = points - self.start
        along = offset @ axis
        square = np.maximum(np.sum(offset * offset, axis=-1) - along * along, 0.0)
        aside = np.sqrt(square)
        # The nearest sphere centre lies ahead of the foot by the slope of the cone.
        sine = np.clip((self.start_radius - self.end_radius) / length, -0.99, 0.99)
        ahead = along + aside * sine / np.sqrt(1 - sine * sine)
        part = np.clip(ahead / length, 0.0, 1.0)
        radius = self.start_radius + part * (self.end_radius - self.start_radius)
        return np.hypot(along - part * length, aside) - radius

    def bounds(self) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
        """Find the box that holds it.

        Returns
        -------
        tuple of Float[np.ndarray, "3"]
            Lowest and highest coordinates.
        """
        low = np.minimum(self.start - self.start_radius, self.end - self.end_radius)
        high = np.maximum(self.start + self.start_radius, self.end + self.end_radius)
        return low, high


@dataclass(frozen=True)
class Ellipsoid:
    """An ellipsoid, possibly turned.

    Attributes
    ----------
    centre : Float[np.ndarray, "3"]
        Its middle.
    half : Float[np.ndarray, "3"]
        Half axes.
    blend : float
        Over which distance it melts into what was there before.
    turn : Float[np.ndarray, "3 3"]
        Rotation from its own axes to the outside ones.
    """

    centre: Float[np.ndarray, "3"]
    half: Float[np.ndarray, "3"]
    blend: float
    turn: Float[np.ndarray, "3 3"] = field(default_factory=lambda: np.eye(3))

    def distance(self, points: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "..."]:
        """Measure, to first order near the surface, how far points are outside.

        Parameters
        ----------
        points : Float[np.ndarray, "... 3"]
            Positions.

        Returns
        -------
        Float[np.ndarray, "..."]
            Distance, negative inside.
        """
        scaled = ((points - self.centre) @ self.turn) / self.half
        level = np.sqrt(np.sum(scaled * scaled, axis=-1))
        slope = np.sqrt(np.sum((scaled / self.half) ** 2, axis=-1))
        # At the very centre the quotient is 0 / 0; its limit is minus the smallest half axis.
        return np.where(slope > 1e-9, level * (level - 1) / (slope + 1e-12), -self.half.min())

    def bounds(self) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
        """Find a box that holds it.

        Returns
        -------
        tuple of Float[np.ndarray, "3"]
            Lowest and highest coordinates.
        """
        reach = np.sqrt(((self.turn * self.half) ** 2).sum(axis=1))
        return self.centre - reach, self.centre + reach


Blob = Cone | Ellipsoid


def _melt(
    one: Float[np.ndarray, "..."], two: Float[np.ndarray, "..."], blend: float
) -> Float[np.ndarray, "..."]:
    """Take the smaller of two fields, rounding the corner where they are within `blend`."""
    overlap = np.maximum(blend - np.abs(one - two), 0.0)
    return np.minimum(one, two) - overlap * overlap / (4 * blend)


def evaluate(blobs: Sequence[Blob], points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    """Evaluate the melted body at points.

    Parameters
    ----------
    blobs : sequence of Cone or Ellipsoid
        Its pieces, in the order in which they melt together.
    points : Float[np.ndarray, "n 3"]
        Positions.

    Returns
    -------
    Float[np.ndarray, " n"]
        The field, negative inside, about a distance near the surface.
    """
    total = np.full(points.shape[:-1], FAR)
    columns = np.ascontiguousarray(points.T)
    for blob in blobs:
        low, high = blob.bounds()
        # Beyond this reach the piece can neither be the nearest nor melt with the surface.
        reach = 2.0 * blob.blend + 0.03
        inside = (columns > (low - reach)[:, None]) & (columns < (high + reach)[:, None])
        near = np.flatnonzero(inside[0] & inside[1] & inside[2])
        total[near] = _melt(total[near], blob.distance(points[near]), blob.blend)
    return total


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


def _grid_field(
    blobs: Sequence[Blob], low: Float[np.ndarray, "3"], shape: tuple[int, ...], cell: float
) -> Float[np.ndarray, "x y z"]:
    """Evaluate the body on a grid, each piece only in the box where it matters."""
    total = np.full(shape, FAR)
    axes = [low[k] + cell * np.arange(shape[k]) for k in range(3)]
    for blob in blobs:
        start, end = blob.bounds()
        reach = 2.0 * blob.blend + 0.03
        inside = tuple(
            slice(*np.searchsorted(axes[k], (start[k] - reach, end[k] + reach))) for k in range(3)
        )
        nodes = np.stack(
            np.meshgrid(*[axes[k][inside[k]] for k in range(3)], indexing="ij"), axis=-1
        )
        total[inside] = _melt(total[inside], blob.distance(nodes), blob.blend)
    return total


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
    values = _grid_field(blobs, low, shape, cell)
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
