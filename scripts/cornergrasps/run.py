"""Carrying out the grasps of a run: hands out scenes, says what becomes of them, loses nothing."""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path

from cornergrasps.attempts import SceneTask, carry_out
from cornergrasps.recipes import Gripper, Robot
from cornerscenes.storage import Folder
from cornerscenes.tables import RecipeError, read
from cornerscenes.workers import (
    ALL_DONE,
    INTERRUPTED,
    NOT_STARTED,
    SOME_FAILED,
    Stop,
    Tell,
    Workers,
    available_cores,
    event_channel,
)

# After so many scenes a worker is replaced.
SCENES_PER_WORKER = 64


def main() -> int:
    """Carry out grasps; progress goes to standard output as JSON lines.

    The file of grasps has one JSON object a line: a scene and its grasps, each with point_m,
    approach, jaw and opening_m. Their outcomes, in the same order, go to SCENE.json.
    """
    parser = argparse.ArgumentParser(prog="cornergrasps.run", description=main.__doc__)
    parser.add_argument("dataset", type=Path, help="folder of the dataset")
    parser.add_argument("grasps", type=Path, help="file of grasps")
    parser.add_argument("output", type=Path, help="folder of the outcomes")
    parser.add_argument("--recipes", type=Path, required=True, help="folder of grippers and robots")
    parser.add_argument("--gripper", required=True, help="name of a gripper")
    parser.add_argument("--robot", required=True, help="name of a robot")
    parser.add_argument("--jobs", type=int, metavar="N", help="worker processes")
    arguments = parser.parse_args()
    stop = Stop()
    tell = event_channel(stop)
    stop.listen()
    try:
        return run(arguments, tell, stop)
    except (RecipeError, OSError, ValueError) as error:
        tell({"event": "error", "message": str(error)})
        return NOT_STARTED


def run(options: argparse.Namespace, tell: Tell, stop: Stop) -> int:
    """Carry out what is missing; return the exit code."""
    tasks = _tasks(options)
    options.output.mkdir(parents=True, exist_ok=True)
    Folder(options.output).remove_unfinished(None)
    missing = [task for task in tasks if not task.is_done()]
    tell({"event": "start", "scenes": len(tasks), "missing": len(missing)})
    failed = done = 0
    started_s = time.monotonic()
    with Workers(SCENES_PER_WORKER, stop) as workers:
        workers.count = max(1, min(options.jobs or available_cores(), len(missing)))
        for outcome in workers.run(
            carry_out, missing, lambda task: tell({"event": "grasping", "scene": task.name})
        ):
            done += 1
            per_scene_s = (time.monotonic() - started_s) / done
            about = {"scene": outcome.task.name, "left_s": per_scene_s * (len(missing) - done)}
            if outcome.result is None:
                failed += 1
                tell({"event": "failed", "message": outcome.problem, **about})
            else:
                tell({"event": "done", **outcome.result, **about})
    if stop.requested:
        tell({"event": "interrupted", "there": len(tasks) - len(missing) + done - failed})
        return INTERRUPTED
    return SOME_FAILED if failed else ALL_DONE


def _tasks(options: argparse.Namespace) -> list[SceneTask]:
    gripper = read(Gripper, options.recipes / "grippers" / f"{options.gripper}.toml")
    robot = read(Robot, options.recipes / "robots" / f"{options.robot}.toml")
    with options.grasps.open(encoding="utf-8") as lines:
        told = [json.loads(line) for line in lines]
    return [
        SceneTask(of["scene"], options.dataset, options.output, gripper, robot, tuple(of["grasps"]))
        for of in told
    ]


if __name__ == "__main__":
    sys.exit(main())
