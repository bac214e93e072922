"""Rendering on a Ray cluster: of two machines, both of which are this one."""

import importlib
import json
import math
import os
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

# Before Ray is imported: it is to listen on the loopback only, and to tell nobody of its use.
os.environ |= {"RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0", "RAY_USAGE_STATS_ENABLED": "0"}
ray = pytest.importorskip("ray")

from cornerscenes.ray_workers import RayWorkers  # noqa: E402
from cornerscenes.workers import Stop, WorkersError  # noqa: E402
from studies.runs import contents, events, render, start  # noqa: E402


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    machines = importlib.import_module("ray.cluster_utils")
    node = {"num_cpus": 1, "node_ip_address": "127.0.0.1", "object_store_memory": 80_000_000}
    head = {**node, "include_dashboard": False}
    cluster = machines.Cluster(initialize_head=True, head_node_args=head)
    cluster.add_node(**node)
    yield cluster.address
    cluster.shutdown()


def test_as_many_scenes_are_rendered_at_a_time_as_the_machines_have_cores(
    address: str, tmp_path: Path
):
    def met(name: str) -> str:
        """Wait for the other one; there is one core on each machine."""
        (tmp_path / name).touch()
        deadline_s = time.monotonic() + 120.0
        while len(list(tmp_path.iterdir())) < 2 and time.monotonic() < deadline_s:
            time.sleep(0.05)
        assert len(list(tmp_path.iterdir())) == 2
        return ray.get_runtime_context().get_node_id()

    with RayWorkers(address, 100, Stop()) as workers:
        assert workers.arrange(6, "llvm_ad_rgb", None, None) == 1
        assert workers.count == 2
        outcomes = list(workers.run(met, ["one", "two"]))
    assert [outcome.problem for outcome in outcomes] == [None, None]
    assert len({outcome.result for outcome in outcomes}) == 2


def test_a_task_that_fails_or_kills_its_worker_costs_no_other_task(address: str):
    def root_or_dead(number: float) -> float:
        if number == 1.0:
            os._exit(7)
        return math.sqrt(number)

    with RayWorkers(address, 100, Stop()) as workers:
        workers.count = 2
        outcomes = {o.task: o for o in workers.run(root_or_dead, [4.0, 1.0, -1.0, 9.0])}
    roots = {task: outcome.result for task, outcome in outcomes.items()}
    assert roots == {4.0: 2.0, 1.0: None, -1.0: None, 9.0: 3.0}
    assert outcomes[-1.0].problem == "ValueError: math domain error"
    assert str(outcomes[1.0].problem).startswith("its worker process was lost: ")


def test_a_worker_is_replaced_after_its_share_of_tasks(address: str):
    with RayWorkers(address, 2, Stop()) as workers:
        outcomes = list(workers.run(lambda number: os.getpid(), range(5)))
    assert max(Counter(outcome.result for outcome in outcomes).values()) == 2


def test_an_interrupted_run_keeps_what_is_finished_and_comes_out_the_same_to_the_byte(
    address: str, tiny: Path, tmp_path: Path
):
    output = tmp_path / "ray"
    with start("tiny", output, "--ray", address) as run:
        said = events(run)
        first = next(event for event in said if event["event"] == "done")
        assert run.stdin is not None
        run.stdin.close()
        (last,) = [event for event in said if event["event"] == "interrupted"]
    assert run.returncode == 130
    assert 1 <= last["there"] < 4
    assert list(output.glob(".*")) == []
    assert first["scene"] in json.loads((output / "dataset.json").read_text())["scenes"]
    render("tiny", output, "--ray", address)
    assert contents(output) == contents(tiny)


def test_an_address_takes_a_dataset_as_a_folder_does(address: str, tiny: Path, tmp_path: Path):
    render("tiny", f"local://{tmp_path}/ray", "--ray", address, "--scenes", "four")
    assert contents(tmp_path / "ray" / "four") == contents(tiny / "four")


def test_a_cluster_that_is_not_there_is_an_error_that_says_what_to_do():
    with (
        pytest.raises(WorkersError, match=r"cluster at '127\.0\.0\.1:1': .*refused.* `ray start`"),
        RayWorkers("127.0.0.1:1", 1, Stop()),
    ):
        pass
