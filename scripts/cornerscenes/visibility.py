"""What stands before what, exactly: every triangle of the scene in float64, no rays, no sampling.

An eye and a straight line span a plane. Each triangle that crosses it does so along a segment, and
the segment hides an interval of the line; what is left of the line when all are taken away is seen.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from cornerscenes.camera import Camera, inverse, transformed
from cornerscenes.scene import FIRST_SURFACE_ID, TARGET_ID, Scene

# What a triangle hides lies behind it by at least this share of its distance: what lies in it, or
# touches it, is not hidden by it.
BEHIND = 1e-9

# Gaps along a line that are shorter than this share of it are rounding between two triangles.
_SHORTEST = 1e-9

# Nothing nearer to the camera than this is in its image [m].
_NEAREST_M = 1e-4

# What ends an interval of a line: its own end, the frame, or the object of this id.
End = Literal["vertex", "frame"] | int


@dataclass(frozen=True)
class Interval:
    """A part of a line that is seen, in its parameter, 0 to 1, and what ends it on either side."""

    start: float
    end: float
    started_by: End
    ended_by: End


@dataclass(frozen=True)
class Triangles:
    """Triangles in the world [m], and the id of the object that each belongs to."""

    corners_m: Float[np.ndarray, "m 3 3"]
    object_id: Int[np.ndarray, " m"]

    @classmethod
    def of(cls, scene: Scene) -> Triangles:
        """Return all of a scene's: target, objects, room."""
        target = scene.target
        solids = [(TARGET_ID, part, target.world_from_target) for part in target.parts]
        solids += [
            (item.object_id, part, item.world_from_object)
            for item in scene.objects
            for part in item.shape.parts
        ]
        corners = [transformed(pose, part.vertices)[part.triangles] for _, part, pose in solids]
        ids = [np.full(len(part.triangles), number) for number, part, _ in solids]
        for index, surface in enumerate(scene.surfaces):
            corners.append(surface.corners_m[[[0, 1, 2], [0, 2, 3]]])
            ids.append(np.full(2, FIRST_SURFACE_ID + index))
        return cls(np.concatenate(corners), np.concatenate(ids))

    def where(self, chosen: Bool[np.ndarray, " m"]) -> Triangles:
        """Return some of them."""
        return Triangles(self.corners_m[chosen], self.object_id[chosen])

    @cached_property
    def _spheres(self) -> tuple[Float[np.ndarray, "m 3"], Float[np.ndarray, " m"]]:
        middles = self.corners_m.mean(axis=1)
        radii = np.linalg.norm(self.corners_m - middles[:, None], axis=2).max(axis=1)
        return middles, radii

    def between(
        self, origin_m: Float[np.ndarray, "3"], points_m: Float[np.ndarray, "n 3"]
    ) -> Triangles:
        """Return those that may stand between an origin and any of some points: no other does."""
        middles, radii = self._spheres
        towards = middles - origin_m
        distance = np.linalg.norm(towards, axis=1)
        rays = points_m - origin_m
        lengths = np.linalg.norm(rays, axis=1)
        axis = rays.mean(axis=0) / np.linalg.norm(rays.mean(axis=0))
        opening = np.arccos(np.clip(rays @ axis / lengths, -1.0, 1.0)).max()
        off_axis = np.arccos(np.clip(towards @ axis / np.maximum(distance, 1e-12), -1.0, 1.0))
        reach = np.arcsin(np.minimum(1.0, radii / np.maximum(distance, 1e-12)))
        near = (off_axis <= opening + reach + 1e-6) | (distance <= radii)
        return self.where(near & (distance - radii < lengths.max()))

    def hide(
        self, origin_m: Float[np.ndarray, "3"], points_m: Float[np.ndarray, "n 3"]
    ) -> Bool[np.ndarray, " n"]:
        """Return of each point whether a triangle stands between the origin and it."""
        found = np.zeros(len(points_m), dtype=bool)
        if not len(points_m):
            return found
        near = self.between(origin_m, points_m)
        for index, point in enumerate(points_m):
            shares, _ = near._met(origin_m, point - origin_m)
            found[index] = bool(((shares > BEHIND) & (shares < 1.0 - BEHIND)).any())
        return found

    def first_met(
        self, origin_m: Float[np.ndarray, "3"], direction: Float[np.ndarray, "3"], beyond: float
    ) -> tuple[Float[np.ndarray, "3"], int] | None:
        """Return the first point that a ray meets and the triangle's index.

        Parameters
        ----------
        origin_m, direction
            The ray; points are `origin_m + share * direction`.
        beyond : float
            The share from which on it counts.
        """
        shares, indices = self._met(origin_m, direction)
        shares = np.where(shares > beyond, shares, np.inf)
        if not np.isfinite(shares).any():
            return None
        best = int(shares.argmin())
        return origin_m + shares[best] * direction, int(indices[best])

    def _met(
        self, origin_m: Float[np.ndarray, "3"], direction: Float[np.ndarray, "3"]
    ) -> tuple[Float[np.ndarray, " k"], Int[np.ndarray, " k"]]:
        """Return the shares of `direction` at which its line meets triangles, and which."""
        first = self.corners_m[:, 0]
        one, other = self.corners_m[:, 1] - first, self.corners_m[:, 2] - first
        across = np.cross(direction, other)
        volume = np.einsum("ij,ij->i", one, across)
        offset = origin_m - first
        turned = np.cross(offset, one)
        with np.errstate(divide="ignore", invalid="ignore"):
            u = np.einsum("ij,ij->i", offset, across) / volume
            v = turned @ direction / volume
            share = np.einsum("ij,ij->i", other, turned) / volume
            inside = np.flatnonzero((u >= 0.0) & (v >= 0.0) & (u + v <= 1.0))
        return share[inside], inside

    def hidden_intervals(
        self,
        eye_m: Float[np.ndarray, "3"],
        start_m: Float[np.ndarray, "3"],
        end_m: Float[np.ndarray, "3"],
    ) -> tuple[Float[np.ndarray, "k 2"], Int[np.ndarray, " k"]]:
        """Return which intervals of a line (0 at its start, 1 at its end) which objects hide."""
        a, b = start_m - eye_m, end_m - eye_m
        normal = np.cross(a, b)
        square = normal @ normal
        if square <= 1e-24 * (a @ a) * (b @ b):  # seen end-on it is a point
            return np.zeros((0, 2)), np.zeros(0, dtype=np.int64)
        heights = (self.corners_m - eye_m) @ normal
        above = heights >= 0.0
        count = above.sum(axis=1)
        crossing = np.flatnonzero((count > 0) & (count < 3))
        corners, heights = self.corners_m[crossing] - eye_m, heights[crossing]
        alone = np.where(
            count[crossing] == 1, above[crossing].argmax(axis=1), above[crossing].argmin(axis=1)
        )
        rows = np.arange(len(crossing))
        # Coordinates in the plane: a point is alpha a + beta b, hidden behind it is what has more
        # of both, and beta / (alpha + beta) is the line's parameter.
        duals = np.stack([np.cross(b, normal), np.cross(normal, a)], axis=1) / square
        ends = []
        for step in (1, 2):
            other = (alone + step) % 3
            share = heights[rows, alone] / (heights[rows, alone] - heights[rows, other])
            point = corners[rows, alone]
            point = point + share[:, None] * (corners[rows, other] - point)
            ends.append(point @ duals)
        first, last = ends

        def limits(point: Float[np.ndarray, "k 2"]) -> Float[np.ndarray, "k 3"]:
            return np.column_stack([point, 1.0 - BEHIND - point.sum(axis=1)])

        low, high = clipped(limits(first), limits(last))
        kept = high > low
        span = (last - first)[kept]
        sides = [first[kept] + share[kept, None] * span for share in (low, high)]
        found = np.stack([side[:, 1] / side.sum(axis=1) for side in sides], axis=1)
        found = np.clip(np.sort(found, axis=1), 0.0, 1.0)
        return found, self.object_id[crossing[kept]]


def clipped(
    at_start: Float[np.ndarray, "k c"], at_end: Float[np.ndarray, "k c"]
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Return from where to where, 0 to 1, values that change linearly are all positive.

    Parameters
    ----------
    at_start, at_end : Float[np.ndarray, "k c"]
        The c values of each of k cases. Where there is no such part the first result is not less
        than the second.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        zero = at_start / (at_start - at_end)
    enters, leaves = (at_start < 0.0) & (at_end >= 0.0), (at_start >= 0.0) & (at_end < 0.0)
    low = np.where(enters, zero, 0.0).max(axis=1)
    high = np.where(leaves, zero, 1.0).min(axis=1)
    return low, np.where(((at_start < 0.0) & (at_end < 0.0)).any(axis=1), -1.0, high)


def seen_intervals(
    camera: Camera,
    world_from_camera: Float[np.ndarray, "4 4"],
    start_m: Float[np.ndarray, "3"],
    end_m: Float[np.ndarray, "3"],
    triangles: Triangles,
) -> list[Interval]:
    """Return the parts of a line that are in the frame and that nothing hides, in order.

    Parameters
    ----------
    camera, world_from_camera
        The camera.
    start_m, end_m : Float[np.ndarray, "3"]
        The line's ends in the world.
    triangles : Triangles
        What may hide it. What merely touches it does not.
    """
    limits = [
        _frame(camera, point)
        for point in transformed(inverse(world_from_camera), np.stack([start_m, end_m]))
    ]
    (low,), (high,) = clipped(limits[0][None], limits[1][None])
    if low >= high:
        return []
    line = np.stack([start_m + low * (end_m - start_m), start_m + high * (end_m - start_m)])
    eye = world_from_camera[:3, 3]
    hidden, ids = triangles.between(eye, line).hidden_intervals(eye, start_m, end_m)
    found: list[Interval] = []
    place = float(low)
    by: End = "vertex" if low == 0.0 else "frame"
    for index in np.argsort(hidden[:, 0], kind="stable"):
        start, end = (float(value) for value in hidden[index])
        if start >= high:
            break
        if start > place + _SHORTEST:
            found.append(Interval(place, start, by, int(ids[index])))
        if end > place:
            place, by = end, int(ids[index])
    if high > place + _SHORTEST:
        found.append(Interval(place, float(high), by, "vertex" if high == 1.0 else "frame"))
    return found


def _frame(camera: Camera, point_m: Float[np.ndarray, "3"]) -> Float[np.ndarray, "5"]:
    """Return what is positive in the frame, linear in a point of the camera frame [m]."""
    x, y, z = camera.fx_px * point_m[0], camera.fy_px * point_m[1], point_m[2]
    return np.array(
        [
            x + (camera.cx_px + 0.5) * z,
            (camera.width - 0.5 - camera.cx_px) * z - x,
            y + (camera.cy_px + 0.5) * z,
            (camera.height - 0.5 - camera.cy_px) * z - y,
            z - _NEAREST_M,
        ]
    )


class Outlines:
    """The image of objects, asked how far from a point of the scene one begins before it."""

    def __init__(
        self,
        camera: Camera,
        world_from_camera: Float[np.ndarray, "4 4"],
        objects: Triangles,
        farthest_m: float,
    ) -> None:
        """Project what the objects are made of.

        Parameters
        ----------
        camera, world_from_camera
            The camera.
        objects : Triangles
            The objects.
        farthest_m : float
            No point that is asked for has a larger depth.
        """
        self._camera, self._camera_from_world = camera, inverse(world_from_camera)
        corners = transformed(self._camera_from_world, objects.corners_m.reshape(-1, 3))
        depths = corners[:, 2].reshape(-1, 3)
        nearer = (depths > _NEAREST_M).all(axis=1) & (depths < farthest_m).any(axis=1)
        self._world, self._depths = objects.corners_m[nearer], depths[nearer]
        points = camera.project(corners.reshape(-1, 3, 3)[nearer].reshape(-1, 3))
        self._points = points.reshape(-1, 3, 2)
        self._low, self._high = self._points.min(axis=1), self._points.max(axis=1)

    def nearest_px(
        self,
        point_m: Float[np.ndarray, "3"],
        is_seen: Callable[[Float[np.ndarray, "3"]], bool],
        within_px: float,
    ) -> float | None:
        """Return how far from a visible point, in the image, an object begins nearer than it.

        `None` where there is none within a distance.

        Parameters
        ----------
        point_m : Float[np.ndarray, "3"]
            The point in the world.
        is_seen : Callable
            Says of a point of an object in the world whether the target leaves it free.
        within_px : float
            The distance up to which is looked.
        """
        at = transformed(self._camera_from_world, point_m[None])
        image = self._camera.project(at)[0]
        close = (self._low <= image + within_px) & (self._high >= image - within_px)
        chosen = np.flatnonzero(close.all(axis=1))
        if not len(chosen):
            return None
        points, depths, world = self._points[chosen] - image, self._depths[chosen], self._world
        along = np.roll(points, -1, axis=1) - points
        square = np.maximum((along**2).sum(axis=2), 1e-30)
        share = np.clip(-(points * along).sum(axis=2) / square, 0.0, 1.0)  # (triangle, side)
        distance = np.linalg.norm(points + share[..., None] * along, axis=2)
        # Along a line in the image 1 / z changes linearly.
        here, there = 1.0 / depths, 1.0 / np.roll(depths, -1, axis=1)
        inverse_depth = (1.0 - share) * here + share * there
        in_space = share * there / inverse_depth
        nearer = np.flatnonzero((distance <= within_px) & (inverse_depth > 1.0 / at[0, 2]))
        for index in nearer[np.argsort(distance.ravel()[nearer], kind="stable")]:
            triangle, side = divmod(int(index), 3)
            first, second = world[chosen[triangle]][[side, (side + 1) % 3]]
            if is_seen(first + in_space[triangle, side] * (second - first)):
                return float(distance[triangle, side])
        return None
