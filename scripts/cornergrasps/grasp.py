"""A grasp that is to be carried out, and how a gripper moves for it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from cornergrasps.recipes import Gripper

# How far before the face the fingertips are when the approach begins, and how far it is lifted [m].
BEFORE_M = 0.05
LIFT_M = 0.10

# Distance between the places of a path [m].
STEP_M = 0.005

# Jaws that are nearer to the approach than this are along it [sine].
_LEAST_SINE = 0.02


@dataclass(frozen=True)
class Grasp:
    """A grasp in the world.

    Attributes
    ----------
    point_m : Float[np.ndarray, "3"]
        The point of the face that comes between the jaws.
    approach : Float[np.ndarray, "3"]
        Unit normal out of the face: the gripper comes against it.
    jaw : Float[np.ndarray, "3"]
        Unit direction along which the jaws move, across the approach.
    opening_m : float or None
        How far apart they are when they touch; `None` where nobody knows.
    """

    point_m: Float[np.ndarray, "3"]
    approach: Float[np.ndarray, "3"]
    jaw: Float[np.ndarray, "3"]
    opening_m: float | None

    @classmethod
    def of(
        cls,
        point_m: list[float],
        approach: list[float] | None,
        jaw: list[float] | None,
        opening_m: float | None,
        world_from_camera: Float[np.ndarray, "4 4"],
    ) -> Grasp:
        """Return a grasp as an estimator told it.

        One that tells a point alone is tried from above, with the jaws along the rows of the image
        and opened all the way. Jaws along the approach are across nothing: then they are turned
        along the rows, too, or along the columns where the approach is along the rows.
        """
        outwards = np.array([0.0, 0.0, 1.0] if approach is None else approach)
        outwards = outwards / np.linalg.norm(outwards)
        told = [] if jaw is None else [np.array(jaw)]
        across = _across(outwards, [*told, *world_from_camera[:3, :2].T])
        return cls(np.array(point_m), outwards, across, opening_m)

    @property
    def frame(self) -> Float[np.ndarray, "3 3"]:
        """The gripper's axes as columns: along the jaws, across them, the way it comes."""
        return np.column_stack([self.jaw, np.cross(-self.approach, self.jaw), -self.approach])

    def opened_m(self, gripper: Gripper) -> float:
        """Return how far a gripper opens for it, at most all the way."""
        if self.opening_m is None:
            return gripper.most_opening_m
        return min(self.opening_m + 2.0 * gripper.clearance_m, gripper.most_opening_m)

    def way_there_m(self, gripper: Gripper) -> Float[np.ndarray, "n 3"]:
        """Return the places of the gripper's origin from where it begins to the face."""
        start = self.point_m + (gripper.depth_m + BEFORE_M) * self.approach
        return _line(start, self.point_m)

    def way_up_m(self) -> Float[np.ndarray, "n 3"]:
        """Return the places of the gripper's origin from the face to where it holds."""
        return _line(self.point_m, self.point_m + LIFT_M * np.eye(3)[2])


def _across(
    axis: Float[np.ndarray, "3"], directions: list[Float[np.ndarray, "3"]]
) -> Float[np.ndarray, "3"]:
    """Return the first of these directions that is not along an axis, made square to it."""
    square = [direction - (direction @ axis) * axis for direction in directions]
    least = [_LEAST_SINE * np.linalg.norm(direction) for direction in directions]
    enough = (np.linalg.norm(way) > limit for way, limit in zip(square, least, strict=True))
    found = square[next((index for index, is_enough in enumerate(enough) if is_enough), -1)]
    return found / np.linalg.norm(found)


def _line(start: Float[np.ndarray, "3"], end: Float[np.ndarray, "3"]) -> Float[np.ndarray, "n 3"]:
    count = max(2, int(np.ceil(np.linalg.norm(end - start) / STEP_M)) + 1)
    return np.linspace(start, end, count)
