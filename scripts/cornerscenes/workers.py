"""Worker processes: each does a bounded number of tasks and is replaced; one that dies costs one.

The renderer's memory grows with every scene that it loads, and it may crash or be killed. Pools of
the standard library break as a whole when one of their processes dies.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection, wait
from types import TracebackType
from typing import Any, Generic, TypeVar

from cornerscenes.storage import StorageError
from cornerscenes.tables import RecipeError

Task = TypeVar("Task")
Result = TypeVar("Result")

# What a run comes to, as exit codes.
ALL_DONE, SOME_FAILED, NOT_STARTED, INTERRUPTED = 0, 1, 2, 130

Tell = Callable[[Mapping[str, object]], None]


class WorkersError(Exception):
    """Workers that cannot be had; the message says why and what to do."""


@dataclass(frozen=True)
class Outcome(Generic[Task, Result]):
    """What became of a task: its result, or the sentence that says why there is none."""

    task: Task
    result: Result | None
    problem: str | None = None


class Stop:
    """The wish to stop: an interrupt, a termination signal, or the end of standard input."""

    def __init__(self) -> None:
        self.requested = False
        self.connection, self._bell = get_context("spawn").Pipe(duplex=False)

    def request(self, *_: object) -> None:
        """Ask to stop; may be called from a signal's handler and from any thread."""
        self.requested = True
        self._bell.send_bytes(b"stop")

    def listen(self) -> None:
        """Take signals and the end of standard input as that wish from now on."""
        signal.signal(signal.SIGINT, self.request)
        signal.signal(signal.SIGTERM, self.request)
        threading.Thread(target=self._read_to_end, daemon=True).start()

    def _read_to_end(self) -> None:
        try:
            while os.read(0, 4096):
                pass
        except OSError:  # there is no standard input: what would end it is gone
            pass
        self.request()


class _Worker:
    """A process, this end of the connection to it, and how many tasks it was given."""

    def __init__(self) -> None:
        context = get_context("spawn")
        self.connection, other_end = context.Pipe()
        self.process = context.Process(target=_serve, args=(other_end,), daemon=True)
        self.process.start()
        other_end.close()
        self.tasks = 0

    def end(self) -> str:
        """End the process; return how it ended."""
        self.connection.close()
        self.process.join(timeout=10.0)
        self.process.kill()
        self.process.join()
        return _ending(self.process.exitcode)


class Workers:
    """A number of worker processes, which end with the context.

    Parameters
    ----------
    tasks_per_worker : int
        After so many, a process is replaced.
    stop : Stop
        When it is requested, no more tasks are given out and no more results waited for.

    Attributes
    ----------
    count : int
        How many run at a time; 1 at first.
    """

    def __init__(self, tasks_per_worker: int, stop: Stop) -> None:
        self.count = 1
        self._tasks_per_worker = tasks_per_worker
        self._stop = stop
        self._idle: list[_Worker] = []
        self._busy: dict[Connection, tuple[_Worker, Any]] = {}

    def __enter__(self) -> Workers:
        """Begin; processes are started when there is something to do."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End every process, at once and whatever it is doing."""
        workers = [worker for worker, _ in self._busy.values()] + self._idle
        for worker in workers:
            worker.process.kill()
        for worker in workers:
            worker.end()

    def arrange(self, tasks: int, variant: str, jobs: int | None, cores: int | None) -> int:
        """Choose how many run at a time, and return the threads of each.

        Parameters
        ----------
        tasks : int
            How many there are to do.
        variant : str
            The renderer's variant.
        jobs, cores : int or None
            How many workers there shall be, and how many cores to use, where that is given.
        """
        cores = cores or available_cores()
        # One thread each is fastest: what is done once a scene runs on one anyway. On a GPU, all
        # workers would share its memory.
        self.count = min(jobs or (1 if variant.startswith("cuda") else cores), tasks)
        return max(1, cores // self.count)

    def run(
        self,
        work: Callable[[Task], Result],
        tasks: Iterable[Task],
        started: Callable[[Task], None] = lambda task: None,
    ) -> Iterator[Outcome[Task, Result]]:
        """Do tasks; yield what became of each as soon as it is known, in no particular order.

        Parameters
        ----------
        work : Callable[[Task], Result]
            A function of a module, which a process can import.
        tasks : Iterable[Task]
            What it is called with.
        started : Callable[[Task], None]
            Is told when a process begins with a task.
        """
        waiting = iter(tasks)
        for _, task in zip(range(self.count), waiting, strict=False):
            self._give(work, task, started)
        while self._busy:
            ready = wait([self._stop.connection, *self._busy])
            if self._stop.requested:
                return
            for connection in ready:
                worker, task = self._busy.pop(connection)  # type: ignore[arg-type]
                outcome = self._receive(worker, task)
                for following in waiting:
                    self._give(work, following, started)
                    break
                yield outcome

    def _give(
        self, work: Callable[[Task], Result], task: Task, started: Callable[[Task], None]
    ) -> None:
        worker = self._idle.pop() if self._idle else _Worker()
        worker.tasks += 1
        self._busy[worker.connection] = worker, task
        started(task)
        try:
            worker.connection.send((work, task))
        except OSError:  # it has died; so says its connection, too, when it is read
            pass

    def _receive(self, worker: _Worker, task: Any) -> Outcome[Any, Any]:
        try:
            result, problem = worker.connection.recv()
        except (EOFError, OSError):
            return Outcome(task, None, f"its worker process {worker.end()}")
        if worker.tasks < self._tasks_per_worker:
            self._idle.append(worker)
        else:
            worker.end()
        return Outcome(task, result, problem)


def explained(error: Exception) -> str:
    """Return an exception as a sentence; those that are one already stay as they are."""
    is_sentence = isinstance(error, (RecipeError, StorageError))
    return str(error) if is_sentence else f"{type(error).__name__}: {error}"


def answer(work: Callable[[Task], Result], task: Task) -> tuple[Result | None, str | None]:
    """Do a task, in a worker; return its result, or the sentence that says why there is none."""
    try:
        return work(task), None
    except Exception as error:  # whatever it is, the other tasks are still to be done
        traceback.print_exc()
        return None, explained(error)


def _serve(connection: Connection) -> None:
    """Do tasks until there are no more; the process's main function."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # whoever started this decides when it ends
    threading.Thread(target=_end_with_parent, daemon=True).start()
    while True:
        try:
            work, task = connection.recv()
        except EOFError:
            return
        connection.send(answer(work, task))


def _end_with_parent() -> None:
    """End this process when the one that started it is gone, in whichever way."""
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _ending(exit_code: int | None) -> str:
    if exit_code is not None and exit_code < 0:
        name = signal.Signals(-exit_code).name if -exit_code in set(signal.Signals) else exit_code
        hint = " (too little memory?)" if -exit_code == getattr(signal, "SIGKILL", 0) else ""
        return f"was ended by {name}{hint}"
    return f"ended with exit code {exit_code}"


def available_cores() -> int:
    """Return how many cores this process may use."""
    if sys.platform == "linux":
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def event_channel(stop: Stop) -> Tell:
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
