"""Which scenes a run is to render, and what decides their content."""

from dataclasses import replace
from pathlib import Path

import pytest

from cornerscenes import tasks
from cornerscenes.estimate import Expectation
from cornerscenes.tables import RecipeError
from cornerscenes.tasks import ORCHESTRATION, Setting, scene_of, selected, tasks_of

RECIPES = Path(__file__).parents[2] / "tests" / "recipes"
TINY = tasks_of("tiny", RECIPES)


def names(scenes: str | None, shard: str | None) -> list[str]:
    return [task.name for task in selected(TINY, scenes, shard)]


def test_scenes_are_chosen_by_number_and_by_name():
    assert names(None, None) == ["one", "two", "two-again", "four"]
    assert names("1..3", None) == ["two", "two-again"]
    assert names("..1", None) == ["one"]
    assert names("3..", None) == ["four"]
    assert names("two", None) == ["two"]


def test_every_scene_is_in_exactly_one_shard_and_shards_may_be_empty():
    shards = [names(None, f"{index}/6") for index in range(6)]
    assert shards == [["one"], ["two"], ["two-again"], ["four"], [], []]
    assert names("1..4", "1/2") == ["two", "four"]  # counted in the suite, not in the choice


@pytest.mark.parametrize("scenes", ["2..2", "3..5", "4..", "three", "-1..2", "1"])
def test_scenes_that_are_not_there_are_named_with_those_that_are(scenes: str):
    with pytest.raises(RecipeError, match=r"--scenes is .*within 0\.\.4, .*one to four"):
        names(scenes, None)


@pytest.mark.parametrize("shard", ["2/2", "0/0", "1", "-1/2", "a/b"])
def test_a_shard_that_cannot_be_is_refused(shard: str):
    with pytest.raises(RecipeError, match=r"--shard is .*must be I/N with I from 0 to N - 1"):
        names(None, shard)


def test_a_recipe_s_hash_covers_the_sources_that_decide_a_scene_s_content(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    package = Path(tasks.__file__).parent
    for path in package.glob("*.py"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    assert set(ORCHESTRATION) <= {path.name for path in tmp_path.iterdir()}
    monkeypatch.setattr(tasks, "__file__", str(tmp_path / "tasks.py"))

    def hash_after_change_of(name: str) -> str:
        (tmp_path / name).write_text("changed")
        tasks.generators.cache_clear()
        return tasks.generators()["cornerscenes"]

    before = tasks.generators.__wrapped__()["cornerscenes"]
    for name in ORCHESTRATION:
        assert hash_after_change_of(name) == before, name
    assert hash_after_change_of("truth.py") != before
    tasks.generators.cache_clear()


def test_a_worker_with_other_sources_than_the_run_began_with_renders_nothing():
    with pytest.raises(RecipeError, match="not those that this run began with"):
        scene_of(replace(TINY[0], recipe_sha256="of yesterday"), Setting("", "scalar_rgb", 1))


def test_the_time_left_counts_waiting_and_running_scenes_over_all_workers():
    expectation = Expectation(TINY, workers=2)
    one, two, again, four = TINY
    expectation.begin(one, 0.0)
    expectation.begin(two, 0.0)
    assert expectation.left_s(5.0) is None
    expectation.end(one, 10.0)
    expectation.begin(again, 10.0)
    assert expectation.left_s(10.0) == pytest.approx((10.0 + 0.0 + 10.0) / 2)
    expectation.end(two, 20.0)
    expectation.begin(four, 20.0)
    assert expectation.left_s(20.0) == pytest.approx(15.0)  # the last one, alone
    expectation.end(again, None)
    expectation.end(four, 15.0)
    assert expectation.left_s(40.0) == 0.0
