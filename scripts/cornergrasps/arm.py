"""Inverse kinematics of an arm of five joints: yaw, three pitches in one upright plane, roll."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from cornergrasps.recipes import Arm

# An approach that leaves the arm's plane by less than this is turned into it [deg]: a fifth joint
# fewer than six cannot tilt sideways.
SIDEWAYS_DEG = 1.0


def planes(approach: Float[np.ndarray, "3"], count: int) -> list[tuple[float, float]]:
    """Return the upright planes in which an arm can come along a direction.

    Parameters
    ----------
    approach : Float[np.ndarray, "3"]
        Unit direction in which the gripper moves, in the world.
    count : int
        How many to try of a direction that is upright itself: then any plane is one.

    Returns
    -------
    list[tuple[float, float]]
        Of each the bearing [rad] that is forwards, and how the approach is tilted in it: the angle
        from straight up towards forwards [rad].
    """
    level = float(np.hypot(*approach[:2]))
    own = float(np.arctan2(approach[1], approach[0]))
    tried = [own, own + np.pi] if level > 1e-9 else []
    tried += [2.0 * np.pi * index / count for index in range(count)]
    found = []
    for bearing in tried:
        forwards = np.array([np.cos(bearing), np.sin(bearing)])
        sideways = abs(forwards[0] * approach[1] - forwards[1] * approach[0])
        if sideways <= np.sin(np.radians(SIDEWAYS_DEG)):
            found.append((bearing, float(np.arctan2(forwards @ approach[:2], approach[2]))))
    return found


def solutions(
    arm: Arm, flange: Float[np.ndarray, "... 2"], tilt_rad: float, elbow: int
) -> tuple[Float[np.ndarray, "... 3"], Bool[np.ndarray, "..."]]:
    """Return the three pitches that bring the flange to places in the arm's plane.

    Parameters
    ----------
    arm : Arm
        The arm.
    flange : Float[np.ndarray, "... 2"]
        Places of the flange [m]: before the first axis, and above the floor.
    tilt_rad : float
        Direction of the flange's axis, from straight up towards forwards.
    elbow : int
        1 or -1: on which side of the line from shoulder to wrist the elbow is.

    Returns
    -------
    Float[np.ndarray, "... 3"]
        Second, third and fourth joint [rad]; meaningless where they are none.
    Bool[np.ndarray, "..."]
        Whether the place is within reach and the joints are within their limits.
    """
    height = arm.base_m[1] + arm.shoulder_m[1]
    along = np.array([np.sin(tilt_rad), np.cos(tilt_rad)])
    wrist = flange - arm.wrist_m * along - [arm.shoulder_m[0], height]
    upper, fore = arm.upper_arm_m, arm.forearm_m
    square = (wrist**2).sum(axis=-1)
    cosine = (square - upper**2 - fore**2) / (2.0 * upper * fore)
    third = elbow * np.arccos(np.clip(cosine, -1.0, 1.0))
    second = np.arctan2(wrist[..., 0], wrist[..., 1]) - np.arctan2(
        fore * np.sin(third), upper + fore * np.cos(third)
    )
    second = _turned(second)
    fourth = _turned(tilt_rad - second - third)
    joints = np.stack([second, third, fourth], axis=-1)
    low, high = np.radians(np.array(arm.limits_deg[1:4])).T
    within = ((joints >= low) & (joints <= high)).all(axis=-1)
    return joints, within & (np.abs(cosine) <= 1.0)


def roll(
    arm: Arm, bearing_rad: float, tilt_rad: float, jaw: Float[np.ndarray, "3"]
) -> float | None:
    """Return the fifth joint [rad] that turns the jaws along a direction, the nearer way round.

    Jaws that are swapped are the same: the joint is found modulo half a turn, `None` where neither
    is within its limits. At 0 the jaws move sideways, along `up x forwards`.
    """
    forwards = np.array([np.cos(bearing_rad), np.sin(bearing_rad), 0.0])
    sideways = np.array([-forwards[1], forwards[0], 0.0])
    along = np.sin(tilt_rad) * forwards + np.cos(tilt_rad) * np.array([0.0, 0.0, 1.0])
    angle = float(np.arctan2(np.cross(along, sideways) @ jaw, sideways @ jaw))
    low, high = np.radians(arm.limits_deg[4])
    nearer = (angle + 0.5 * np.pi) % np.pi - 0.5 * np.pi
    tried = sorted((nearer, nearer - np.pi, nearer + np.pi), key=abs)
    return next((float(value) for value in tried if low <= value <= high), None)


def _turned(angle: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """Return an angle in [-pi, pi)."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi
