"""A grasp carried out: approach, close, lift, hold; and what became of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from jaxtyping import Float

from cornergrasps.engine import Data, mj
from cornergrasps.grasp import LIFT_M, STEP_M
from cornergrasps.model import STEP_S, Model, Obstacle
from cornergrasps.plan import Plan, place
from cornergrasps.recipes import Gripper

Outcome = Literal[
    "success",
    "unreachable",
    "ground",
    "wall",
    "clutter",
    "target",
    "no_contact",
    "slipped",
    "dropped",
    "failed",
]

# How fast the gripper moves [m/s], and how long it closes and holds [s].
SPEED_M_S = 0.1
CLOSE_S = 0.6
SETTLE_S = 0.2
HOLD_S = 0.8

# A target that is moved so far [m], [deg], or pressed so hard [N], before the jaws close was bumped
# into.
BUMPED_M = 0.005
BUMPED_DEG = 3.0
BUMPED_N = 20.0

# What robot or target press harder against in the room than this, they touch [N].
TOUCHED_N = 1.0

# One that moved so far between the jaws while it was lifted and held has slipped [m], [deg].
SLIPPED_M = 0.005
SLIPPED_DEG = 5.0

# One that has risen by less than this share of the way up was not lifted, whoever touches it.
_LIFTED_SHARE = 0.5

# Contacts are looked at every so many steps.
_EVERY = 5

Watch = Callable[[str, Data], None]


@dataclass(frozen=True)
class Result:
    """What became of a grasp.

    Attributes
    ----------
    outcome : Outcome
        Success, or why not.
    pushed_mm : float or None
        How far the target was moved before the jaws closed.
    slip_mm, slip_deg : float or None
        How far it moved and turned between the jaws from when they had closed to the end.
    reason : str or None
        Why it failed, where the simulation itself did.
    """

    outcome: Outcome
    pushed_mm: float | None = None
    slip_mm: float | None = None
    slip_deg: float | None = None
    reason: str | None = None


def execute(
    model: Model,
    data: Data,
    gripper: Gripper,
    plan: Plan,
    watch: Watch = lambda phase, data: None,
) -> Result:
    """Carry out a plan.

    Parameters
    ----------
    model : Model
        The scene.
    data : Data
        Is set anew: nothing of what it holds matters.
    gripper : Gripper
        The gripper of the model.
    plan : Plan
        What the robot does.
    watch : Watch
        Is told after each step which phase it belongs to.
    """
    try:
        result = _Execution(model, data, gripper, plan, watch).run()
    except mj.FatalError as error:
        return Result("failed", reason=f"MuJoCo: {error}")
    # A simulation that diverges starts anew by itself: what came after it says nothing.
    warned = np.flatnonzero(data.warning.number)
    if warned.size:
        names = ", ".join(mj.mjtWarning(int(kind)).name for kind in warned)
        return Result("failed", reason=f"MuJoCo warned of {names}: nothing can be said")
    return result


class _BumpError(Exception):
    def __init__(self, outcome: Obstacle) -> None:
        self.outcome: Obstacle = outcome


class _Execution:
    def __init__(
        self, model: Model, data: Data, gripper: Gripper, plan: Plan, watch: Watch
    ) -> None:
        self.model, self.data, self.plan, self.watch = model, data, plan, watch
        self.closed = 0.5 * gripper.least_opening_m
        mj.mj_resetData(model.model, data)
        place(model, data, plan, plan.there[0])
        self._tell(plan.there[0], 0.5 * plan.opened_m)
        mj.mj_forward(model.model, data)
        self.start = self._target()
        self.force = np.zeros(6)
        self.brushed: Obstacle | None = None

    def run(self) -> Result:
        """Return what becomes of it."""
        opened = 0.5 * self.plan.opened_m
        try:
            self._move("approach", self.plan.there, opened, self._check_untouched)
            self._wait("approach", SETTLE_S, self._check_untouched)
        except _BumpError as bumped:
            return Result(bumped.outcome, self._pushed()[0] * 1e3)
        pushed_mm = self._pushed()[0] * 1e3
        self._tell(self.plan.there[-1], self.closed)
        self._wait("close", CLOSE_S)
        if not self._holds():
            return Result("no_contact", pushed_mm)
        self.data.eq_active[self.model.model.equality("held").id] = 0
        held, height_m = self._target_in_hand(), self._target()[2, 3]
        try:
            self._move("lift", self.plan.up, self.closed, self._check_lift)
            self._wait("hold", HOLD_S, self._check_lift)
        except _BumpError as bumped:
            return Result(bumped.outcome, pushed_mm)
        slip_m, slip_deg = _moved(held, self._target_in_hand())
        is_lifted = self._target()[2, 3] - height_m >= _LIFTED_SHARE * LIFT_M
        is_held = is_lifted and self._holds()
        outcome: Outcome = "success"
        if self.brushed is not None and (not is_held or _is_slip(slip_m, slip_deg)):
            outcome = self.brushed
        elif not is_held:
            outcome = "dropped"
        elif _is_slip(slip_m, slip_deg):
            outcome = "slipped"
        return Result(outcome, pushed_mm, slip_m * 1e3, slip_deg)

    def _move(
        self,
        phase: str,
        way: Float[np.ndarray, "n k"],
        half_opening_m: float,
        check: Callable[[], None],
    ) -> None:
        steps = round(STEP_M / SPEED_M_S / STEP_S)
        for start, end in pairwise(way):
            for step in range(steps):
                self._tell(start + (step + 1) / steps * (end - start), half_opening_m)
                self._step(phase)
                if step % _EVERY == 0:
                    check()

    def _wait(self, phase: str, time_s: float, check: Callable[[], None] = lambda: None) -> None:
        for step in range(round(time_s / STEP_S)):
            self._step(phase)
            if step % _EVERY == 0:
                check()

    def _step(self, phase: str) -> None:
        mj.mj_step(self.model.model, self.data)
        self.watch(phase, self.data)

    def _tell(self, joints: Float[np.ndarray, " k"], half_opening_m: float) -> None:
        self.data.ctrl[: self.model.joints] = joints
        self.data.ctrl[self.model.joints] = half_opening_m

    def _check_room(self) -> None:
        """Stop where the robot touches something other than what it grasps."""
        for index, geometries in enumerate(self.data.contact.geom):
            touched = self.model.touched(geometries)
            if touched is not None and self._normal_force(index) > TOUCHED_N:
                raise _BumpError(touched)

    def _check_lift(self) -> None:
        """Remember what the target in the jaws is dragged against."""
        self._check_room()
        for index, geometries in enumerate(self.data.contact.geom):
            touched = self.model.target_touches(geometries)
            if touched in ("wall", "clutter") and self._normal_force(index) > TOUCHED_N:
                self.brushed = touched

    def _check_untouched(self) -> None:
        """Stop where the robot has bumped into anything."""
        self._check_room()
        pushed_m, turned_deg = self._pushed()
        if pushed_m > BUMPED_M or turned_deg > BUMPED_DEG:
            raise _BumpError("target")
        force_n = sum(
            self._normal_force(index)
            for index, geometries in enumerate(self.data.contact.geom)
            if self.model.target in geometries
            and not self.model.hand.isdisjoint(int(geometry) for geometry in geometries)
        )
        if force_n > BUMPED_N:
            raise _BumpError("target")

    def _normal_force(self, contact: int) -> float:
        mj.mj_contactForce(self.model.model, self.data, contact, self.force)
        return float(self.force[0])

    def _holds(self) -> bool:
        """Return whether both fingers touch the target."""
        touching = {
            int(other)
            for pair in self.data.contact.geom
            if self.model.target in pair
            for other in pair
        }
        return all(touching & finger for finger in self.model.fingers)

    def _target(self) -> Float[np.ndarray, "4 4"]:
        return _pose_of(self.data, self.model.model.body("target").id)

    def _target_in_hand(self) -> Float[np.ndarray, "4 4"]:
        hand = _pose_of(self.data, self.model.model.body("hand").id)
        return np.linalg.inv(hand) @ self._target()

    def _pushed(self) -> tuple[float, float]:
        return _moved(self.start, self._target())


def _is_slip(slip_m: float, slip_deg: float) -> bool:
    return slip_m > SLIPPED_M or slip_deg > SLIPPED_DEG


def _pose_of(data: Data, body: int) -> Float[np.ndarray, "4 4"]:
    pose = np.eye(4)
    pose[:3, :3] = data.xmat[body].reshape(3, 3)
    pose[:3, 3] = data.xpos[body]
    return pose


def _moved(
    before: Float[np.ndarray, "4 4"], after: Float[np.ndarray, "4 4"]
) -> tuple[float, float]:
    """Return how far apart two poses are [m], [deg]."""
    turn = before[:3, :3].T @ after[:3, :3]
    cosine = np.clip(0.5 * (np.trace(turn) - 1.0), -1.0, 1.0)
    distance = float(np.linalg.norm(after[:3, 3] - before[:3, 3]))
    return distance, float(np.degrees(np.arccos(cosine)))
