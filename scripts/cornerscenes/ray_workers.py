"""Workers on the machines of a Ray cluster."""

from __future__ import annotations

import importlib
import os
import re
import signal
import socket
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from types import TracebackType
from typing import Any, TypeVar

from cornerscenes.workers import Outcome, Stop, WorkersError, answer

Task = TypeVar("Task")
Result = TypeVar("Result")

# How often the wish to stop is looked for [s]; Ray wakes for nothing but its own results.
LOOK_S = 0.2

# How long to wait for the cluster to answer, and for what is cancelled to end [s].
PATIENCE_S = 10.0


class RayWorkers:
    """Worker processes of a Ray cluster, which serve as those of one machine do: see `Workers`.

    Each has one core, or one GPU where the renderer runs on it. The machines are sent this package;
    Python, Ray and the packages that it needs must be there.

    Parameters
    ----------
    address : str
        HOST:PORT of the cluster's head; where it is empty, RAY_ADDRESS, or else the cluster that
        this machine is part of.
    tasks_per_worker : int
        After so many, a process is replaced.
    stop : Stop
        When it is requested, no more tasks are given out and no more results waited for.

    Attributes
    ----------
    count : int
        How many run at a time; 1 at first.
    """

    def __init__(self, address: str, tasks_per_worker: int, stop: Stop) -> None:
        self.count = 1
        self._address = address or os.environ.get("RAY_ADDRESS") or "auto"
        self._tasks_per_worker = tasks_per_worker
        self._stop = stop
        self._busy: dict[Any, Any] = {}

    def __enter__(self) -> RayWorkers:
        """Connect to the cluster.

        Raises
        ------
        WorkersError
            When Ray is not installed or the cluster cannot be had.
        """
        try:
            self._ray: Any = importlib.import_module("ray")
        except ImportError as error:
            raise WorkersError(
                "--ray: Ray is not installed here; run cornerbench setup --ray"
            ) from error
        termination = signal.getsignal(signal.SIGTERM)
        try:
            if re.fullmatch(r"[^/]+:\d+", self._address):  # Ray itself waits for minutes
                host, _, port = self._address.rpartition(":")
                socket.create_connection((host, int(port)), PATIENCE_S).close()
            self._ray.init(
                self._address,
                runtime_env={"py_modules": [str(Path(__file__).parent)]},
                log_to_driver=False,
            )
        except (ImportError, OSError, RuntimeError, ValueError) as error:
            raise WorkersError(
                f"--ray: cannot use a cluster at {self._address!r}: {error}; start one with `ray "
                f"start`, as scenes/FORMAT.md shows, and name it: --ray HOST:PORT"
            ) from error
        signal.signal(signal.SIGTERM, termination)  # which Ray took for itself
        # One that died is not tried again: it may be the scene that it died of.
        self._answer = self._ray.remote(max_calls=self._tasks_per_worker, max_retries=0)(answer)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End every task, at once and whatever it is doing, and leave the cluster."""
        for reference in self._busy:
            self._ray.cancel(reference, force=True)
        if self._busy:
            self._ray.wait(list(self._busy), num_returns=len(self._busy), timeout=PATIENCE_S)
        self._ray.shutdown()

    def arrange(self, tasks: int, variant: str, jobs: int | None, cores: int | None) -> int:
        """Choose how many run at a time, and return the threads of each: see `Workers.arrange`."""
        resource = "CPU"
        if variant.startswith("cuda"):
            resource = "GPU"
            self._answer = self._answer.options(num_gpus=1)
        there = int(self._ray.cluster_resources().get(resource, 1))
        self.count = min(jobs or cores or there, tasks)
        return 1

    def run(
        self,
        work: Callable[[Task], Result],
        tasks: Iterable[Task],
        started: Callable[[Task], None] = lambda task: None,
    ) -> Iterator[Outcome[Task, Result]]:
        """Do tasks; yield what became of each as soon as it is known: see `Workers.run`."""
        waiting = iter(tasks)

        def give(most: int) -> None:
            for _, task in zip(range(most), waiting, strict=False):
                self._busy[self._answer.remote(work, task)] = task
                started(task)

        give(self.count)
        while self._busy:
            ready, _ = self._ray.wait(list(self._busy), timeout=LOOK_S)
            if self._stop.requested:
                return
            for reference in ready:
                outcome = self._outcome(reference)
                give(1)
                yield outcome

    def _outcome(self, reference: Any) -> Outcome[Any, Any]:
        task = self._busy.pop(reference)
        try:
            result, problem = self._ray.get(reference)
        except self._ray.exceptions.RayError as error:
            cause = str(error).strip().partition("\n")[0]
            return Outcome(task, None, f"its worker process was lost: {cause}")
        return Outcome(task, result, problem)
