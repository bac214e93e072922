"""How long rendering takes: what is left while it goes on."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from statistics import fmean

from cornerscenes.tasks import Task


class Expectation:
    """The time that is left, learnt from the scenes that are done.

    A scene is expected to take as long as those of its family did, or of any family where none of
    its own is done yet.

    Parameters
    ----------
    tasks : Sequence[Task]
        All that is to be done.
    workers : int
        How many are done at a time.
    """

    def __init__(self, tasks: Sequence[Task], workers: int) -> None:
        self._waiting = {task.name: task.scene.family for task in tasks}
        self._running: dict[str, tuple[str, float]] = {}
        self._seconds: defaultdict[str, list[float]] = defaultdict(list)
        self._workers = workers

    def begin(self, task: Task, now_s: float) -> None:
        """Note that a task was begun at a time [s]."""
        self._running[task.name] = self._waiting.pop(task.name), now_s

    def end(self, task: Task, seconds: float | None) -> None:
        """Note that a task ended, and what time it took [s] if it succeeded."""
        del self._running[task.name]
        if seconds is not None:
            self._seconds[task.scene.family].append(seconds)

    def left_s(self, now_s: float) -> float | None:
        """Return the time until everything is done [s]; `None` before anything is."""
        if not self._seconds:
            return None
        family_s = {family: fmean(seconds) for family, seconds in self._seconds.items()}
        any_s = fmean(seconds for family in self._seconds.values() for seconds in family)
        running = [
            max(0.0, family_s.get(family, any_s) - (now_s - begun_s))
            for family, begun_s in self._running.values()
        ]
        waiting = sum(family_s.get(family, any_s) for family in self._waiting.values())
        return max([(sum(running) + waiting) / self._workers, *running])
