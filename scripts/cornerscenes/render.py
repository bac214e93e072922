"""Rendering a suite: hands out what is missing, says what becomes of it, loses nothing."""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections import defaultdict
from collections.abc import Collection, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from functools import partial
from pathlib import Path

from cornerscenes.dataset import Dataset, DatasetError
from cornerscenes.estimate import Cost, Expectation, estimate, probe, probes
from cornerscenes.ray_workers import RayWorkers
from cornerscenes.storage import StorageError, storage_at
from cornerscenes.tables import RecipeError
from cornerscenes.tasks import Setting, Task, choose_variant, render_one, selected, tasks_of
from cornerscenes.workers import (
    ALL_DONE,
    INTERRUPTED,
    NOT_STARTED,
    SOME_FAILED,
    Stop,
    Tell,
    Workers,
    WorkersError,
    available_cores,
    event_channel,
)

# Loading a scene leaks in the renderer: a worker renders this many scenes and is replaced.
SCENES_PER_WORKER = 8

HOW_TO_BE_FAST = (
    "rendering with scalar_rgb, the slow variant: no libLLVM found; "
    "on Debian and Ubuntu: apt-get install libllvm19"
)

NOT_HERE = (
    "it was rendered, but is not to be seen in {}: machines that render one dataset must share its "
    "folder; if they do, it only takes long to appear: run the same command again"
)


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
    parser.add_argument("--ray", metavar="ADDRESS", help="workers of this Ray cluster; '': find it")
    parser.add_argument("--threads", type=int, metavar="N", help="cores to use; all of them if not")
    parser.add_argument("--estimate", action="store_true", help="say time and size, and end")
    parser.add_argument("--variant", help="Mitsuba variant to use instead of the fastest")
    arguments = parser.parse_args()
    stop = Stop()
    tell = event_channel(stop)
    stop.listen()
    try:
        return Rendering(arguments, tell, stop).run()
    except (RecipeError, DatasetError, StorageError, WorkersError) as error:
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

    def run(self) -> int:
        """Render the chosen scenes that are missing or outdated; return the exit code."""
        missing = self._missing()
        if self._options.estimate:
            return self._estimate(missing)
        self._storage.make()
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
            return self._interrupted(len(waiting))
        return SOME_FAILED if failed else ALL_DONE

    def _missing(self) -> list[Task]:
        """Return the tasks whose scenes are not there as they should be."""

        def is_missing(task: Task) -> bool:
            wanted = task.recipe_sha256, self._options.variant
            return not self._stop.requested and not self._dataset.is_current(task.name, *wanted)

        # Hashes are computed outside Python's lock.
        with ThreadPoolExecutor(self._options.threads or available_cores()) as pool:
            are_missing = pool.map(is_missing, self._chosen)
            return [task for task, it_is in zip(self._chosen, are_missing, strict=True) if it_is]

    def _render(self, missing: Sequence[Task], waiting: set[str]) -> int:
        """Render tasks, drop from `waiting` those that are done, return how many failed."""
        failed = 0
        with self._workers() as workers:
            setting = self._begin(workers, len(missing))
            if setting is None:
                return 0
            expectation = Expectation(missing, workers.count)

            def started(task: Task) -> None:
                expectation.begin(task, time.monotonic())
                self._tell_rendering(task)

            for outcome in workers.run(partial(render_one, setting=setting), missing, started):
                task, rendered, problem = outcome.task, outcome.result, outcome.problem
                expectation.end(task, None if rendered is None else rendered.seconds)
                left_s = expectation.left_s(time.monotonic())
                if rendered is None:
                    self._storage.remove_unfinished([task.name])
                elif task.name not in self._publish(waiting - {task.name}):
                    rendered, problem = None, NOT_HERE.format(self._storage)
                if rendered is None:
                    failed += 1
                    self._tell_failed(task, problem, left_s)
                    continue
                waiting.discard(task.name)
                self._tell(
                    {
                        "event": "done",
                        "scene": task.name,
                        "visible_fraction": rendered.visible_fraction,
                        "seconds": round(rendered.seconds, 3),
                        "left_s": left_s,
                    }
                )
        return failed

    def _estimate(self, missing: Sequence[Task]) -> int:
        """Say what rendering would take; return the exit code."""
        self._tell({"event": "start", "scenes": len(self._chosen), "missing": len(missing)})
        if not missing:
            self._tell({"event": "estimate", "missing": 0})
            return ALL_DONE
        probed: defaultdict[str, list[Cost]] = defaultdict(list)
        failed = 0
        with self._workers() as workers:
            setting = self._begin(workers, len(missing))
            if setting is not None:
                work = partial(probe, setting=setting)
                for outcome in workers.run(work, probes(missing), self._tell_rendering):
                    if outcome.result is None:
                        failed += 1
                        self._tell_failed(outcome.task, outcome.problem, None)
                        continue
                    probed[outcome.task.scene.family].append(outcome.result)
                    self._tell({"event": "probed", "scene": outcome.task.name})
        if setting is None or self._stop.requested:
            return self._interrupted(len(missing))
        if not probed:
            return SOME_FAILED
        families, seconds, size_bytes = estimate(missing, probed)
        # A worker renders whole scenes: ten by four of them take three rounds.
        rounds = math.ceil(len(missing) / workers.count)
        self._tell(
            {
                "event": "estimate",
                "missing": len(missing),
                "variant": setting.variant,
                "workers": workers.count,
                "threads_per_worker": setting.threads,
                "seconds": asdict(seconds.times(rounds / len(missing))),
                "bytes": asdict(size_bytes),
                "free_bytes": self._storage.free_bytes(),
                "families": [asdict(family) for family in families],
            }
        )
        return SOME_FAILED if failed else ALL_DONE

    def _workers(self) -> Workers | RayWorkers:
        if self._options.ray is None:
            return Workers(SCENES_PER_WORKER, self._stop)
        return RayWorkers(self._options.ray, SCENES_PER_WORKER, self._stop)

    def _begin(self, workers: Workers | RayWorkers, tasks: int) -> Setting | None:
        """Choose variant, workers and threads for so many tasks; `None` where it was stopped."""
        outcomes = list(workers.run(choose_variant, [self._options.variant]))
        if not outcomes:
            return None
        variant, problem = outcomes[0].result, outcomes[0].problem
        if variant is None:
            raise RecipeError(f"the renderer does not start: {problem}")
        if variant.startswith("scalar") and self._options.variant is None:
            self._tell({"event": "slow", "message": HOW_TO_BE_FAST})
        threads = workers.arrange(tasks, variant, self._options.jobs, self._options.threads)
        return Setting(str(self._storage), variant, threads)

    def _publish(self, waiting: set[str], afresh: bool = False) -> Collection[str]:
        recipes = {task.name: task.recipe_sha256 for task in self._suite}
        return self._dataset.publish(recipes, waiting, afresh)

    def _interrupted(self, missing: int) -> int:
        self._tell({"event": "interrupted", "there": len(self._chosen) - missing})
        return INTERRUPTED

    def _tell_rendering(self, task: Task) -> None:
        self._tell({"event": "rendering", "scene": task.name})

    def _tell_failed(self, task: Task, problem: str | None, left_s: float | None) -> None:
        what = {"scene": task.name, "key": task.key, "message": problem}
        self._tell({"event": "failed", **what, "left_s": left_s})


if __name__ == "__main__":
    sys.exit(main())
