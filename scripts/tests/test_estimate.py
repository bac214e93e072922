"""What rendering would take, from probes."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from cornerscenes import estimate as estimates
from cornerscenes import scene_files
from cornerscenes.estimate import FEW, PROBES_PER_FAMILY, Cost, _paths, estimate, probes
from cornerscenes.mitsuba_backend import choose_variant
from cornerscenes.recipes import FilmRecipe
from cornerscenes.tasks import Setting, Task, scene_of, tasks_of

TINY = tasks_of("tiny", Path(__file__).parents[2] / "tests" / "recipes")


def of_family(name: str, count: int) -> list[Task]:
    scene = replace(TINY[0].scene, family=name)
    return [replace(TINY[0], scene=replace(scene, name=f"{name}-{k}")) for k in range(count)]


def test_the_paths_that_a_probe_foresees_are_those_that_the_whole_film_takes(tmp_path: Path):
    task, setting = TINY[1], Setting("", choose_variant(), 1)

    def rendered(film: FilmRecipe, name: str) -> tuple[int, dict, dict]:
        folder = tmp_path / name
        folder.mkdir()
        scene, world = scene_of(task, setting)
        scene_files.write(folder, scene, world, film, task.scene, task.key)
        files = (folder / file for file in ("scene.json", "truth.json"))
        described, true = (json.loads(file.read_text()) for file in files)
        return sum(paths for paths, _ in world.traced), described, true

    few = task.film.model_copy(update=FEW)
    probed_paths, *found = rendered(few, "probe")
    paths, described, _ = rendered(task.film, "whole")
    assert _paths(few, *found) == probed_paths
    # How many samples the corners need is known from the probe's noise, and that but roughly.
    assert _paths(task.film, *found) == pytest.approx(paths, rel=0.2)
    samples = [corner["samples"] for corner in described["film"]["corners"]]
    assert max(samples) > task.film.fovea_samples


def test_one_scene_of_each_family_is_probed_first_and_others_while_there_is_time(
    monkeypatch: pytest.MonkeyPatch,
):
    tasks = of_family("a", 30) + of_family("b", 2) + of_family("c", 3)
    names = [task.name for task in probes(tasks)]
    assert names == ["a-0", "b-0", "c-0", "a-10", "b-1", "c-1", "a-20", "c-2"]
    assert PROBES_PER_FAMILY == 3
    monkeypatch.setattr(estimates, "PROBING_S", 0.0)
    assert [task.name for task in probes(tasks)] == ["a-0", "b-0", "c-0"]


def test_sums_weigh_families_by_their_scenes_and_unknown_ones_are_like_the_others():
    tasks = of_family("a", 10) + of_family("b", 100) + of_family("c", 1)
    probed = {"a": [Cost(1.0, 100.0), Cost(3.0, 300.0)], "b": [Cost(5.0, 50.0)]}
    families, seconds, size = estimate(tasks, probed)
    assert [(f.family, f.scenes, f.probed, f.seconds) for f in families] == [
        ("a", 10, 2, 2.0),
        ("b", 100, 1, 5.0),
        ("c", 1, 0, 3.0),
    ]
    assert seconds.expected == pytest.approx(10 * 2.0 + 100 * 5.0 + 3.0)
    assert size.expected == pytest.approx(10 * 200.0 + 100 * 50.0 + 150.0)


def test_the_more_probes_and_the_more_alike_the_narrower_the_bounds():
    tasks = of_family("a", 10)

    def width(*seconds: float) -> float:
        _, found, _ = estimate(tasks, {"a": [Cost(value, 1.0) for value in seconds]})
        assert found.low < found.expected < found.high
        return found.high / found.low

    assert width(9.0, 10.0, 11.0) < width(5.0, 10.0, 15.0) < width(5.0, 15.0)
    assert width(10.0, 10.0) < width(10.0)
