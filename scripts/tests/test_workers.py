"""Worker processes: one that dies costs one task, and none outlives its purpose."""

import os
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import pytest

from cornerscenes.ray_workers import RayWorkers
from cornerscenes.tables import RecipeError
from cornerscenes.workers import Stop, Workers, WorkersError


def doubled_or_dead(number: int) -> int:
    if number == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    if number == 2:
        os._exit(7)
    if number == 3:
        raise ZeroDivisionError("by nothing")
    if number == 4:
        raise RecipeError("the recipe's own words")
    return 2 * number


def process_id(number: int) -> int:
    return os.getpid()


def sleep(seconds: float) -> None:
    time.sleep(seconds)


def is_alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    stat = Path(f"/proc/{process}/stat")
    return not (stat.is_file() and ") Z " in stat.read_text())


@pytest.mark.parametrize("count", [1, 3])
def test_a_task_that_fails_or_kills_its_worker_costs_no_other_task(count: int):
    with Workers(100, Stop()) as workers:
        workers.count = count
        outcomes = list(workers.run(doubled_or_dead, range(8)))
    results = {outcome.task: outcome.result for outcome in outcomes}
    problems = {outcome.task: outcome.problem for outcome in outcomes if outcome.problem}
    assert results == {0: 0, 1: None, 2: None, 3: None, 4: None, 5: 10, 6: 12, 7: 14}
    assert problems == {
        1: "its worker process was ended by SIGKILL (too little memory?)",
        2: "its worker process ended with exit code 7",
        3: "ZeroDivisionError: by nothing",
        4: "the recipe's own words",
    }


def test_a_worker_is_replaced_after_its_share_of_tasks():
    with Workers(2, Stop()) as workers:
        counts = Counter(outcome.result for outcome in workers.run(process_id, range(5)))
    assert sorted(counts.values()) == [1, 2, 2]


def test_workers_go_on_from_one_run_to_the_next():
    with Workers(10, Stop()) as workers:
        first, second = (next(workers.run(process_id, [0])).result for _ in range(2))
    assert first == second


def test_without_ray_the_next_step_is_said(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    with (
        pytest.raises(WorkersError, match="not installed here; run cornerbench setup --ray"),
        RayWorkers("", 1, Stop()),
    ):
        pass


def test_a_stop_ends_the_run_and_its_workers_at_once():
    stop = Stop()
    with Workers(10, stop) as workers:
        workers.count = 2
        list(workers.run(sleep, [0.0, 0.0]))
        processes = {worker.process.pid for worker in workers._idle}
        started: list[float] = []

        def interrupted(seconds: float) -> None:
            started.append(seconds)
            if len(started) == 2:
                os.kill(os.getpid(), signal.SIGTERM)

        before = signal.signal(signal.SIGTERM, stop.request)
        try:
            assert list(workers.run(sleep, [1000.0, 1000.0, 1000.0], interrupted)) == []
        finally:
            signal.signal(signal.SIGTERM, before)
    assert len(processes) == 2
    assert not any(is_alive(process) for process in processes if process)


def test_workers_do_not_outlive_a_parent_that_was_killed():
    code = (
        "from cornerscenes.workers import *; from tests.test_workers import sleep\n"
        "with Workers(10, Stop()) as workers:\n"
        "    list(workers.run(sleep, [0.0]))\n"
        "    started = lambda task: print(workers._idle or [w for w, _ in workers._busy.values()]"
        "[0].process.pid, flush=True)\n"
        "    list(workers.run(sleep, [1000.0], started))\n"
    )
    parent = subprocess.Popen(
        [sys.executable, "-c", code],
        stdout=subprocess.PIPE,
        text=True,
        cwd=Path(__file__).parents[1],
    )
    assert parent.stdout is not None
    worker = int(parent.stdout.readline())
    assert is_alive(worker)
    parent.kill()
    parent.communicate()
    deadline = time.monotonic() + 30.0
    while is_alive(worker) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not is_alive(worker)
