"""Scenes, grippers, robots and grasps that the tests of physics make up."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from cornergrasps.engine import mj
from cornergrasps.execute import Result, execute
from cornergrasps.grasp import Grasp
from cornergrasps.model import build
from cornergrasps.plan import plan
from cornergrasps.recipes import Arm, Gripper, Robot
from cornergrasps.scenery import Scenery, Thing
from cornerscenes import room
from cornerscenes.camera import looking_at, standing
from cornerscenes.shape import Material
from cornerscenes.tables import read
from tests.scenes import slab

SCENES = Path(__file__).parents[2] / "scenes"
SIZE = np.array([0.14, 0.10, 0.12])
UP = np.array([0.0, 0.0, 1.0])


def gripper(**changes: float) -> Gripper:
    table = read(Gripper, SCENES / "grippers" / "parallel-160.toml")
    return table.model_copy(update=changes)


def robot(name: str = "flying") -> Robot:
    return read(Robot, SCENES / "robots" / f"{name}.toml")


def scenery(*things: Thing, centre: tuple[float, float] = (0.0, 0.0)) -> Scenery:
    """Return a cuboid on the floor, the walls half a metre behind it."""
    return Scenery(
        name="made up",
        key="tests/made up",
        size_m=SIZE,
        world_from_target=standing(*centre, 0.0),
        things=things,
        surfaces_m=room.corners(0.5, 0.5, 3.0, 1.4),
        world_from_camera=looking_at(np.array([-0.5, -0.4, 0.7]), np.zeros(3)),
    )


def from_above(opening_m: float | None = 0.10) -> Grasp:
    """Return the true grasp of the top, jaws across its shorter side, y."""
    return Grasp(np.array([0.0, 0.0, SIZE[2]]), UP, np.array([0.0, 1.0, 0.0]), opening_m)


def from_the_front() -> Grasp:
    """Return the true grasp of a side, level, jaws along y."""
    point_m = np.array([-0.5 * SIZE[0], 0.0, 0.5 * SIZE[2]])
    return Grasp(point_m, np.array([-1.0, 0, 0]), np.array([0.0, 1.0, 0.0]), SIZE[1])


def carried_out(
    grasp: Grasp, *things: Thing, by: Robot | None = None, of: Gripper | None = None
) -> str | Result:
    made, carrier, used = scenery(*things), by or robot(), of or gripper()
    model = build(made, carrier, used)
    data = mj.MjData(model.model)
    planned = plan(made, carrier, used, model, data, grasp)
    return planned if isinstance(planned, str) else execute(model, data, used, planned)


def outcome(*arguments: object, **options: object) -> str:
    found = carried_out(*arguments, **options)  # type: ignore[arg-type]
    return found if isinstance(found, str) else found.outcome


def board(x_m: float, y_m: float, yaw_rad: float = 0.0, soft: bool = False) -> Thing:
    """Return an upright board of 2 x 10 cm, 16 cm high."""
    (part,) = slab().shape.parts
    sheet = replace(part, material=Material((0.1, 0.5, 0.1), two_sided=True))
    return Thing(f"board {x_m} {y_m}", (sheet if soft else part,), standing(x_m, y_m, yaw_rad))


def moved(way: np.ndarray, by_m: float) -> Grasp:
    grasp = from_above()
    return replace(grasp, point_m=grasp.point_m + by_m * way)


def arm_of(used: Robot) -> Arm:
    assert used.arm is not None
    return used.arm
