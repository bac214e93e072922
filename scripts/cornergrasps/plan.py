"""Where a robot has to stand for a grasp and how its joints move, so that it touches nothing."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from cornergrasps import arm as arms
from cornergrasps.engine import Data, mj
from cornergrasps.grasp import LIFT_M, Grasp
from cornergrasps.model import Model, quaternion, reach_m
from cornergrasps.recipes import Arm, Gripper, Robot
from cornergrasps.scenery import Scenery

Cause = Literal["too_wide", "unreachable", "ground", "wall", "clutter", "target"]

# How finely places to stand are searched: distances of the first axis [m], bearings.
_DISTANCES_M = np.arange(-0.20, 0.62, 0.03)
_BEARINGS = 12

# The platform keeps so far from everything [m].
_MARGIN_M = 0.01

# Of a path every so many places are looked at, the last one always.
_EVERY = 4


@dataclass(frozen=True)
class Plan:
    """A grasp that reaches its place.

    Attributes
    ----------
    root_m : Float[np.ndarray, "3"]
        Where the robot's root is.
    root_turn : Float[np.ndarray, "4"]
        Its attitude, a quaternion.
    there, up : Float[np.ndarray, "n k"]
        The joints on the way there and on the way up.
    opened_m : float
        How far the jaws are apart on the way there.
    """

    root_m: Float[np.ndarray, "3"]
    root_turn: Float[np.ndarray, "4"]
    there: Float[np.ndarray, "n k"]
    up: Float[np.ndarray, "m k"]
    opened_m: float


def plan(
    scenery: Scenery,
    robot: Robot,
    gripper: Gripper,
    model: Model,
    data: Data,
    grasp: Grasp,
    knows_target: bool = False,
) -> Plan | Cause:
    """Return how a grasp is carried out, or what hinders it.

    The room and what stands around are known, the target by the grasp alone: the hand may touch it.

    Parameters
    ----------
    scenery, robot, gripper, grasp
        What is to be done where and by what.
    model : Model
        The model of the first three.
    data : Data
        Is set anew.
    knows_target : bool
        Whether the grasp is the true one: then the target must not touch anything on its way up.
    """
    if grasp.opening_m is not None and grasp.opening_m > gripper.most_opening_m:
        return "too_wide"
    hindrances: Counter[Cause] = Counter()
    tried = (
        [_flight(grasp, gripper)]
        if robot.arm is None or robot.platform_m is None
        else stances(scenery, robot.arm, robot.platform_m, gripper, grasp)
    )
    for candidate in tried:
        hindrance = _hindrance(model, data, candidate, knows_target)
        if hindrance is None:
            return candidate
        hindrances[hindrance] += 1
    return hindrances.most_common(1)[0][0] if hindrances else "unreachable"


def place(model: Model, data: Data, plan: Plan, joints: Float[np.ndarray, " k"]) -> None:
    """Put the robot at the joints of a plan, its jaws opened."""
    data.mocap_pos[0] = plan.root_m
    data.mocap_quat[0] = plan.root_turn
    first = model.model.joint("left").qposadr[0] - model.joints
    data.qpos[first : first + model.joints] = joints
    data.qpos[first + model.joints :] = 0.5 * plan.opened_m


def _flight(grasp: Grasp, gripper: Gripper) -> Plan:
    """Return the plan of a gripper without an arm: three straight joints about the grasp."""
    there, up = (way - grasp.point_m for way in (grasp.way_there_m(gripper), grasp.way_up_m()))
    frame = grasp.frame
    opened = grasp.opened_m(gripper)
    return Plan(grasp.point_m, quaternion(frame), there @ frame, up @ frame, opened)


def stances(
    scenery: Scenery,
    arm: Arm,
    platform_m: tuple[float, float, float],
    gripper: Gripper,
    grasp: Grasp,
) -> Iterator[Plan]:
    """Yield the plans in which an arm reaches all of the path, the platform where it is free."""
    there, up = grasp.way_there_m(gripper), grasp.way_up_m()
    way = np.concatenate([there, up])
    low, high = np.radians(arm.limits_deg[0])
    free = _Floor(scenery, platform_m)
    for bearing, tilt in arms.planes(-grasp.approach, _BEARINGS):
        turn = arms.roll(arm, bearing, tilt, grasp.jaw)
        if turn is None:
            continue
        forwards = np.array([np.cos(bearing), np.sin(bearing)])
        along = np.array([np.sin(tilt), np.cos(tilt)])
        ahead = (way[:, :2] - grasp.point_m[:2]) @ forwards
        flange = np.stack([ahead, way[:, 2]], axis=1) - reach_m(gripper) * along
        flange = flange + np.stack([_DISTANCES_M, 0.0 * _DISTANCES_M], axis=1)[:, None]
        for elbow in (1, -1):
            pitches, reached = arms.solutions(arm, flange, tilt, elbow)
            for index in np.flatnonzero(reached.all(axis=1)):
                root = grasp.point_m[:2] - _DISTANCES_M[index] * forwards
                heading = free.heading(root, bearing, arm.base_m[0], (low, high))
                if heading is None:
                    continue
                ends = np.array([[bearing - heading, turn]] * len(way))
                ends[:, 0] = (ends[:, 0] + np.pi) % (2.0 * np.pi) - np.pi
                joints = np.column_stack([ends[:, 0], pitches[index], ends[:, 1]])
                yield Plan(
                    np.array([*root, 0.0]),
                    np.array([np.cos(0.5 * heading), 0.0, 0.0, np.sin(0.5 * heading)]),
                    joints[: len(there)],
                    joints[len(there) :],
                    grasp.opened_m(gripper),
                )


class _Floor:
    """Where a platform may stand."""

    def __init__(self, scenery: Scenery, platform_m: tuple[float, float, float]) -> None:
        points = scenery.obstacle_points_m
        self._obstacles = points[points[:, 2] < platform_m[2] + _MARGIN_M][:, :2]
        self._half = 0.5 * np.array(platform_m[:2])
        self._walls = [
            (corners[0], np.cross(corners[1] - corners[0], corners[3] - corners[0]))
            for name, corners in scenery.surfaces_m.items()
            if name != "floor"
        ]

    def heading(
        self,
        axis_m: Float[np.ndarray, "2"],
        bearing: float,
        before_m: float,
        limits: tuple[float, float],
    ) -> float | None:
        """Return how the platform must look [rad] for the arm's axis to be there.

        Straight on comes first. `None` where it would always stand on something or in a wall.
        """
        for turn in np.radians([0, 30, -30, 60, -60, 90, -90, 120, -120, 150, -150, 168]):
            heading = bearing - turn
            if not limits[0] <= turn <= limits[1]:
                continue
            axes = np.array(
                [[np.cos(heading), np.sin(heading)], [-np.sin(heading), np.cos(heading)]]
            )
            middle = axis_m - before_m * axes[0]
            inside = np.abs((self._obstacles - middle) @ axes.T) < self._half + _MARGIN_M
            if inside.all(axis=1).any():
                continue
            corners = (
                middle + np.array([[a, b] for a in (1, -1) for b in (1, -1)]) * self._half @ axes
            )
            if all(
                ((corners - point[:2]) @ normal[:2] > _MARGIN_M * np.linalg.norm(normal)).all()
                for point, normal in self._walls
            ):
                return float(heading)
        return None


def _hindrance(model: Model, data: Data, candidate: Plan, knows_target: bool) -> Cause | None:
    """Return what a robot would touch on its way, the target by the hand apart."""
    way = np.concatenate([candidate.there, candidate.up])
    there = len(candidate.there)
    looked_at = {*range(0, len(way), _EVERY), there - 1, len(way) - 1}
    mj.mj_resetData(model.model, data)
    target = model.model.joint("target").qposadr[0]
    standing_m = float(data.qpos[target + 2])
    for index in sorted(looked_at, reverse=True):
        place(model, data, candidate, way[index])
        lifted_m = max(0, index - there) / max(1, len(way) - there - 1) * LIFT_M
        data.qpos[target + 2] = standing_m + lifted_m
        mj.mj_kinematics(model.model, data)
        mj.mj_collision(model.model, data)
        for geometries in data.contact.geom:
            touched = model.touched(geometries)
            if touched is None and lifted_m > 0.0:
                against = model.target_touches(geometries)
                touched = against if knows_target or against == "unreachable" else None
            if touched is not None:
                return touched
    return None
