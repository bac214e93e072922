"""Rendering a suite: hands out what is missing, says what becomes of it, loses nothing."""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

from cornerscenes.dataset import Dataset, DatasetError
from cornerscenes.estimate import Expectation
from cornerscenes.storage import StorageError, storage_at
from cornerscenes.tables import RecipeError
from cornerscenes.tasks import Setting, Task, choose_variant, render_one, selected, tasks_of
from cornerscenes.workers import Stop, Workers, cores

# Loading a scene leaks in the renderer: a worker renders this many scenes and is replaced.
SCENES_PER_WORKER = 8

HOW_TO_BE_FAST = (
    "rendering with scalar_rgb, the slow variant: no libLLVM found; "
    "on Debian and Ubuntu: apt-get install libllvm19"
)

# What a run comes to, as exit codes.
ALL_DONE, SOME_FAILED, NOT_STARTED, INTERRUPTED = 0, 1, 2, 130

Tell = Callable[[Mapping[str, object]], None]


def main() -> int:
    """Render a suite; progress goes to standard output as JSON lines.

    The end of standard input is the wish to stop, as are an interrupt and a termination signal.
    """
    parser = argparse.ArgumentParser(prog="cornerscenes.render", description=main.__doc__)
    parser.add_argument("suite", help="name of a suite")
    parser.add_argument("--recipes", type=Path, required=True, help="folder of suites and families")
    parser.add_argument("--output", required=True, help="folder or address of the dataset")
    parser.add_argument("--scenes", metavar="A..B", help="some of the scenes, counted from 0")
    parser.add_argument("--shard", metavar="I/N", help="every N-th scene, from number I")
    parser.add_argument("--jobs", type=int, metavar="N", help="worker processes")
    parser.add_argument("--threads", type=int, metavar="N", help="cores to use; all of them if not")
    parser.add_argument("--variant", help="Mitsuba variant to use instead of the fastest")
    arguments = parser.parse_args()
    stop = Stop()
    tell = _event_channel(stop)
    stop.listen()
    try:
        return Rendering(arguments, tell, stop).run()
    except (RecipeError, DatasetError, StorageError) as error:
        tell({"event": "error", "message": str(error)})
        return NOT_STARTED


class Rendering:
    """One run over a suite.

    Parameters
    ----------
    options : argparse.Namespace
        The command line's.
    tell : Tell
        Is told what happens, one event after the other.
    stop : Stop
        When it is requested, what is finished is kept and the run ends.
    """

    def __init__(self, options: argparse.Namespace, tell: Tell, stop: Stop) -> None:
        self._options = options
        self._tell = tell
        self._stop = stop
        self._suite = tasks_of(options.suite, options.recipes)
        self._chosen = selected(self._suite, options.scenes, options.shard)
        self._storage = storage_at(options.output)
        self._dataset = Dataset(self._storage, options.suite)
        self._cores = options.threads or cores()

    def run(self) -> int:
        """Render the chosen scenes that are missing or outdated; return the exit code."""
        missing = self._missing()
        if len(self._chosen) == len(self._suite):
            self._storage.remove_unfinished(None)
            self._dataset.remove_others([task.name for task in self._suite])
        else:  # the others may be another process's, which is at work
            self._storage.remove_unfinished([task.name for task in self._chosen])
        waiting = {task.name for task in missing}
        self._publish(waiting, afresh=True)
        self._tell({"event": "start", "scenes": len(self._chosen), "missing": len(missing)})
        failed = 0
        try:
            if missing and not self._stop.requested:
                failed = self._render(missing, waiting)
        finally:
            self._storage.remove_unfinished(waiting)
            self._publish(waiting, afresh=True)
        if self._stop.requested:
            there = len(self._chosen) - len(waiting)
            self._tell({"event": "interrupted", "there": there})
            return INTERRUPTED
        return SOME_FAILED if failed else ALL_DONE

    def _missing(self) -> list[Task]:
        """Return the tasks whose scenes are not there as they should be."""

        def is_missing(task: Task) -> bool:
            wanted = task.recipe_sha256, self._options.variant
            return not self._stop.requested and not self._dataset.is_current(task.name, *wanted)

        with ThreadPoolExecutor(self._cores) as pool:  # hashes are computed outside Python's lock
            return [
                task
                for task, missing in zip(
                    self._chosen, pool.map(is_missing, self._chosen), strict=True
                )
                if missing
            ]

    def _render(self, missing: Sequence[Task], waiting: set[str]) -> int:
        """Render tasks, drop from `waiting` those that are done, return how many failed."""
        wanted = self._options.variant
        failed = 0
        jobs = self._options.jobs or self._cores
        with Workers(min(jobs, len(missing)), SCENES_PER_WORKER, self._stop) as workers:
            variants = list(workers.run(choose_variant, [wanted]))
            if not variants:
                return 0
            variant = variants[0].result
            if variant is None:
                raise RecipeError(variants[0].problem)
            if variant.startswith("scalar") and wanted is None:
                self._tell({"event": "slow", "message": HOW_TO_BE_FAST})
            threads = max(1, self._cores // jobs)
            setting = Setting(self._options.output, variant, threads)
            expectation = Expectation(missing, jobs)

            def started(task: Task) -> None:
                expectation.begin(task, time.monotonic())
                self._tell({"event": "rendering", "scene": task.name})

            for outcome in workers.run(partial(render_one, setting=setting), missing, started):
                task, rendered = outcome.task, outcome.result
                seconds = None if rendered is None else rendered.seconds
                expectation.end(task, seconds)
                event: dict[str, object] = {
                    "scene": task.name,
                    "left_s": expectation.left_s(time.monotonic()),
                }
                if rendered is None:
                    failed += 1
                    self._storage.remove_unfinished([task.name])
                    problem = {"key": task.key, "message": outcome.problem}
                    self._tell({"event": "failed", **problem, **event})
                    continue
                waiting.discard(task.name)
                self._publish(waiting)
                self._tell(
                    {
                        "event": "done",
                        "visible_fraction": rendered.visible_fraction,
                        "seconds": round(rendered.seconds, 3),
                        **event,
                    }
                )
        return failed

    def _publish(self, waiting: set[str], afresh: bool = False) -> None:
        recipes = {task.name: task.recipe_sha256 for task in self._suite}
        self._dataset.publish(recipes, waiting, afresh)


def _event_channel(stop: Stop) -> Tell:
    """Return what writes events to standard output, and send all else that is printed to error.

    The renderer's own log goes to standard output; it must not stand between the events. When
    nobody reads them any more, that is the wish to stop.
    """
    channel = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)

    def tell(event: Mapping[str, object]) -> None:
        try:
            channel.write(json.dumps(event) + "\n")
            channel.flush()
        except OSError:
            stop.request()

    return tell


if __name__ == "__main__":
    sys.exit(main())
