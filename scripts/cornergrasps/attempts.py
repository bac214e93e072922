"""The grasps of one scene, carried out one after the other; what becomes of them is one file."""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from cornergrasps.engine import mj
from cornergrasps.execute import Watch, execute
from cornergrasps.grasp import Grasp
from cornergrasps.model import Model, build
from cornergrasps.plan import Plan, plan
from cornergrasps.recipes import Gripper, Robot
from cornergrasps.scenery import SceneError, Scenery
from cornerscenes.storage import write_whole
from cornerscenes.streams import stream
from cornerscenes.tasks import generators

FORMAT = 1

# How far the true grasp is moved to see that a wrong one fails [m].
WRONG_M = 0.03

# Not among the sources that an outcome depends on.
ORCHESTRATION = ("run.py", "schemas.py", "strip.py")


@dataclass(frozen=True)
class SceneTask:
    """The grasps of one scene.

    Attributes
    ----------
    name : str
        The scene's.
    dataset, output : Path
        Where it is, and where the outcomes go.
    gripper, robot
        What carries them out.
    grasps : tuple[dict[str, Any], ...]
        As they stand in the file of grasps.
    """

    name: str
    dataset: Path
    output: Path
    gripper: Gripper
    robot: Robot
    grasps: tuple[dict[str, Any], ...]

    @property
    def path(self) -> Path:
        """The file of its outcomes."""
        return self.output / f"{self.name}.json"

    def fingerprint(self) -> str:
        """Return the hash of all that its outcomes depend on."""
        found = hashlib.sha256()
        content = {
            "format": FORMAT,
            "gripper": self.gripper.model_dump(exclude={"summary", "source"}),
            "robot": self.robot.model_dump(exclude={"summary", "source"}),
            "grasps": self.grasps,
            "physics": physics(),
        }
        found.update(json.dumps(content, sort_keys=True).encode())
        for name in ("scene.json", "truth.json"):
            try:
                found.update((self.dataset / self.name / name).read_bytes())
            except OSError as error:
                raise SceneError(f"{self.dataset / self.name / name}: {error.strerror}") from error
        return found.hexdigest()

    def is_done(self) -> bool:
        """Return whether its outcomes are there, of these grasps by this physics."""
        try:
            there = json.loads(self.path.read_text(encoding="utf-8"))
            return there["fingerprint"] == self.fingerprint()
        except (OSError, ValueError, KeyError, TypeError, SceneError):
            return False


@cache
def physics() -> dict[str, str]:
    """Return the versions of what decides an outcome: what makes scenes, MuJoCo, our sources."""
    sources = hashlib.sha256()
    for path in sorted(Path(__file__).parent.glob("*.py")):
        if path.name not in ORCHESTRATION:
            sources.update(path.read_bytes())
    return {
        **generators(),
        "cornergrasps": sources.hexdigest(),
        "mujoco": importlib.metadata.version("mujoco"),
    }


class Stage:
    """A scene's model, on which grasps are carried out."""

    def __init__(self, dataset: Path, name: str, robot: Robot, gripper: Gripper) -> None:
        self.scenery = Scenery.read(dataset / name)
        self.robot, self.gripper = robot, gripper
        self.model: Model = build(self.scenery, robot, gripper)
        self.data = mj.MjData(self.model.model)

    def planned(self, grasp: Grasp, knows_target: bool = False) -> Plan | str:
        """Return how a grasp is carried out, or what hinders it."""
        return plan(
            self.scenery, self.robot, self.gripper, self.model, self.data, grasp, knows_target
        )

    def outcome(
        self, grasp: Grasp, knows_target: bool = False, watch: Watch = lambda phase, data: None
    ) -> dict[str, Any]:
        """Return what becomes of a grasp: whether it was carried out, and how it ended."""
        planned = self.planned(grasp, knows_target)
        if isinstance(planned, str):
            return {"outcome": planned, "executed": False}
        result = execute(self.model, self.data, self.gripper, planned, watch)
        return {
            "outcome": result.outcome,
            "executed": True,
            "pushed_mm": result.pushed_mm,
            "slip_mm": result.slip_mm,
            "slip_deg": result.slip_deg,
            "reason": result.reason,
        }

    def told(self, told: dict[str, Any]) -> Grasp:
        """Return a grasp as it stands in the file of grasps."""
        return Grasp.of(
            told["point_m"],
            told["approach"],
            told["jaw"],
            told["opening_m"],
            self.scenery.world_from_camera,
        )


def true_grasps(truth: dict[str, Any]) -> list[Grasp]:
    """Return the true grasps of the faces in view.

    The least occluded face comes first, and of each face the shorter side.
    """
    corners = truth["corners"]
    found = []
    in_view = [face for face in truth["faces"] if face["visible_fraction"] > 0.0]
    for face in sorted(in_view, key=lambda face: -face["visible_fraction"]):
        first, second, _, last = (np.array(corners[i]["position_m"]) for i in face["corners"])
        sides = sorted([second - first, last - first], key=np.linalg.norm)
        for side in sides:
            extent_m = float(np.linalg.norm(side))
            found.append(
                Grasp(
                    np.array(face["centre_m"]), np.array(face["normal"]), side / extent_m, extent_m
                )
            )
    return found


def controls(stage: Stage, truth: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Return what becomes of the true grasp, and of a wrong one.

    "least_occluded": the true grasp of the least occluded face, jaws across its shorter side.
    "best": the first true grasp that a robot that knows the target reaches.
    "wrong": the same, moved by 3 cm in any direction.
    """
    grasps = true_grasps(truth)
    found = {"least_occluded": stage.outcome(grasps[0], knows_target=True)}
    for grasp in grasps:
        if isinstance(stage.planned(grasp, knows_target=True), str):
            continue
        found["best"] = stage.outcome(grasp, knows_target=True)
        way = stream(stage.scenery.key, "wrong").standard_normal(3)
        moved = grasp.point_m + WRONG_M * way / np.linalg.norm(way)
        found["wrong"] = stage.outcome(replace(grasp, point_m=moved))
        break
    return found


def carry_out(task: SceneTask) -> dict[str, int]:
    """Carry out the grasps of a scene, write its file, return how many of them succeeded.

    Raises
    ------
    SceneError
        When the scene cannot be read or rebuilt.
    """
    fingerprint = task.fingerprint()
    stage = Stage(task.dataset, task.name, task.robot, task.gripper)
    path = task.dataset / task.name / "truth.json"
    try:
        truth = json.loads(path.read_text(encoding="utf-8"))
        of_truth = controls(stage, truth)
    except (OSError, ValueError, KeyError, TypeError, IndexError) as error:
        raise SceneError(f"{path}: {type(error).__name__}: {error}") from error
    outcomes = [stage.outcome(stage.told(grasp)) for grasp in task.grasps]
    content = {
        "format": FORMAT,
        "fingerprint": fingerprint,
        "scene": task.name,
        "controls": of_truth,
        "outcomes": outcomes,
    }
    write_whole(task.path, json.dumps(content, allow_nan=False).encode())
    succeeded = sum(item["outcome"] == "success" for item in outcomes)
    return {"grasps": len(outcomes), "succeeded": succeeded}
