"""Grippers and robots: what their TOML files hold."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from cornerscenes.tables import NotNegative, Positive, Range, Summary, Table

Lengths3 = Annotated[tuple[Positive, Positive, Positive], Field(strict=False)]
Lengths2 = Annotated[tuple[Positive, Positive], Field(strict=False)]
Source = Annotated[str, Field(description="where the figures are from")]


class Gripper(Table):
    """Two parallel jaws that move alike.

    Its frame: x along the jaws, z the way it comes, the origin on the face that it grasps.
    """

    summary: Summary
    source: Source
    most_opening_m: Annotated[Positive, Field(description="between the pads, opened all the way")]
    least_opening_m: Annotated[NotNegative, Field(description="between the pads, closed")] = 0.0
    clearance_m: Annotated[
        NotNegative,
        Field(description="how much wider it opens on each side than the grasp says"),
    ]
    depth_m: Annotated[Positive, Field(description="how far the fingers reach beyond the face")]
    finger_m: Annotated[
        Lengths3, Field(description="of a finger: thickness along the jaws, width, length")
    ]
    pad_m: Annotated[Lengths2, Field(description="of the pad at its end: width, length")]
    palm_m: Annotated[
        Lengths3, Field(description="of what carries the fingers: along the jaws, across, high")
    ]
    force_n: Annotated[Positive, Field(description="with which each finger presses")]
    friction: Annotated[Positive, Field(description="Coulomb's coefficient, pad on target")]
    mass_kg: Annotated[Positive, Field(description="of all of it")]

    @model_validator(mode="after")
    def _fits(self) -> Gripper:
        if self.depth_m >= self.finger_m[2]:
            raise ValueError(
                f"depth_m is {self.depth_m}, must be less than the fingers' length, "
                f"{self.finger_m[2]}: the palm would be in the target"
            )
        if self.least_opening_m >= self.most_opening_m:
            raise ValueError(
                f"least_opening_m is {self.least_opening_m}, must be less than most_opening_m, "
                f"{self.most_opening_m}"
            )
        return self


class Arm(Table):
    """Five joints: about the vertical, three about a level axis, and about the flange's own.

    All are at 0 where the arm stands straight up; positive is forwards.
    """

    base_m: Annotated[
        Lengths2, Field(description="the first axis before the platform's middle; its height")
    ]
    shoulder_m: Annotated[
        Lengths2, Field(description="second axis before the first, and above its origin")
    ]
    upper_arm_m: Annotated[Positive, Field(description="second to third axis")]
    forearm_m: Annotated[Positive, Field(description="third to fourth axis")]
    wrist_m: Annotated[Positive, Field(description="fourth axis to the flange")]
    radius_m: Annotated[Positive, Field(description="of a capsule about each link")]
    limits_deg: Annotated[
        tuple[Range, Range, Range, Range, Range],
        Field(strict=False, description="of each joint"),
    ]
    torque_nm: Annotated[
        tuple[Positive, Positive, Positive, Positive, Positive],
        Field(strict=False, description="that each joint can exert"),
    ]
    mass_kg: Annotated[
        tuple[Positive, Positive, Positive, Positive, Positive],
        Field(strict=False, description="of the link that each joint moves"),
    ]


class Robot(Table):
    """What carries the gripper: an arm on a platform that drives anywhere, or nothing at all."""

    summary: Summary
    source: Source
    platform_m: Annotated[
        Lengths3 | None, Field(description="length, width and height of the platform")
    ] = None
    arm: Annotated[
        Arm | None, Field(description="without one the gripper flies: it reaches everything")
    ] = None

    @model_validator(mode="after")
    def _whole(self) -> Robot:
        if (self.platform_m is None) != (self.arm is None):
            raise ValueError("must have both arm and platform_m, or neither")
        return self
