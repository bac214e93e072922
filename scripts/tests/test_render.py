"""A run over a suite believes what it sees, not what it is told."""

import argparse
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest

from cornerscenes.render import SOME_FAILED, Rendering
from cornerscenes.tasks import Rendered, Task
from cornerscenes.workers import Outcome, Stop, Workers

RECIPES = Path(__file__).parents[2] / "tests" / "recipes"
NOT_GIVEN = ("scenes", "shard", "jobs", "threads", "ray", "variant")


def rendered_elsewhere(
    workers: Workers, work: object, tasks: Sequence[Task | None], *_: object
) -> Iterator[Outcome]:
    for task in tasks:
        yield Outcome(task, "llvm_ad_rgb" if task is None else Rendered(1.0, 1.0, 1))


def test_a_scene_that_was_rendered_but_is_not_seen_here_is_a_failure_with_its_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(Workers, "run", rendered_elsewhere)
    monkeypatch.setattr("cornerscenes.render.Expectation.end", lambda *_: None)
    told: list[Mapping[str, Any]] = []
    options = argparse.Namespace(
        suite="tiny",
        recipes=RECIPES,
        output=str(tmp_path),
        estimate=False,
        **dict.fromkeys(NOT_GIVEN),
    )
    assert Rendering(options, told.append, Stop()).run() == SOME_FAILED
    failures = [event for event in told if event["event"] == "failed"]
    assert [event["scene"] for event in failures] == ["one", "two", "two-again", "four"]
    assert all("machines that render one dataset must share" in f["message"] for f in failures)
