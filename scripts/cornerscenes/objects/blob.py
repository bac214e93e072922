"""Ellipsoids and rounded cones that melt together into soft bodies.

A body is a list of pieces; its field is negative inside and about a distance near the surface.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

# Value of the field far from every piece, where its size does not matter.
FAR = 1.0


@dataclass(frozen=True)
class Cone:
    """A rounded cone: all spheres between two end spheres.

    Attributes
    ----------
    start, end : Float[np.ndarray, " 3"]
        Centres of the end spheres.
    start_radius, end_radius : float
        Their radii.
    blend : float
        Over which distance it melts into what was there before.
    """

    start: Float[np.ndarray, " 3"]
    end: Float[np.ndarray, " 3"]
    start_radius: float
    end_radius: float
    blend: float

    def distance(self, points: Float[np.ndarray, " *shape 3"]) -> Float[np.ndarray, " *shape"]:
        """Measure how far points are outside.

        Parameters
        ----------
        points : Float[np.ndarray, " *shape 3"]
            Positions.

        Returns
        -------
        Float[np.ndarray, " *shape"]
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

    def bounds(self) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, " 3"]]:
        """Find the box that holds it.

        Returns
        -------
        tuple of Float[np.ndarray, " 3"]
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
    centre : Float[np.ndarray, " 3"]
        Its middle.
    half : Float[np.ndarray, " 3"]
        Half axes.
    blend : float
        Over which distance it melts into what was there before.
    turn : Float[np.ndarray, "3 3"]
        Rotation from its own axes to the outside ones.
    """

    centre: Float[np.ndarray, " 3"]
    half: Float[np.ndarray, " 3"]
    blend: float
    turn: Float[np.ndarray, "3 3"] = field(default_factory=lambda: np.eye(3))

    def distance(self, points: Float[np.ndarray, " *shape 3"]) -> Float[np.ndarray, " *shape"]:
        """Measure, to first order near the surface, how far points are outside.

        Parameters
        ----------
        points : Float[np.ndarray, " *shape 3"]
            Positions.

        Returns
        -------
        Float[np.ndarray, " *shape"]
            Distance, negative inside.
        """
        scaled = ((points - self.centre) @ self.turn) / self.half
        level = np.sqrt(np.sum(scaled * scaled, axis=-1))
        slope = np.sqrt(np.sum((scaled / self.half) ** 2, axis=-1))
        # At the very centre the quotient is 0 / 0; its limit is minus the smallest half axis.
        return np.where(slope > 1e-9, level * (level - 1) / (slope + 1e-12), -self.half.min())

    def bounds(self) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, " 3"]]:
        """Find a box that holds it.

        Returns
        -------
        tuple of Float[np.ndarray, " 3"]
            Lowest and highest coordinates.
        """
        reach = np.sqrt(((self.turn * self.half) ** 2).sum(axis=1))
        return self.centre - reach, self.centre + reach


Blob = Cone | Ellipsoid


def melted(
    one: Float[np.ndarray, " *shape"], two: Float[np.ndarray, " *shape"], blend: float
) -> Float[np.ndarray, " *shape"]:
    """Take the smaller of two fields, rounding the corner between them.

    Parameters
    ----------
    one, two : Float[np.ndarray, " *shape"]
        The fields.
    blend : float
        Where they differ by less than this, the result is rounded.

    Returns
    -------
    Float[np.ndarray, " *shape"]
        The melted field.
    """
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
        total[near] = melted(total[near], blob.distance(points[near]), blob.blend)
    return total


def grid_field(
    blobs: Sequence[Blob], low: Float[np.ndarray, " 3"], shape: tuple[int, ...], cell: float
) -> Float[np.ndarray, "x y z"]:
    """Evaluate the body on a grid, each piece only in the box where it matters.

    Parameters
    ----------
    blobs : sequence of Cone or Ellipsoid
        The body.
    low : Float[np.ndarray, " 3"]
        The first node.
    shape : tuple of 3 ints
        Number of nodes along each axis.
    cell : float
        Distance between nodes.

    Returns
    -------
    Float[np.ndarray, "x y z"]
        The field at the nodes, negative inside.
    """
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
        total[inside] = melted(total[inside], blob.distance(nodes), blob.blend)
    return total
