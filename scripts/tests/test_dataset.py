"""A dataset's folder: whole scenes or none."""

import json
from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from cornerscenes import exr
from cornerscenes.dataset import MANIFEST, Dataset, DatasetError, sha256

RENDERER = {"name": "none", "version": "0", "variant": "none"}


def write_one(folder: Path) -> None:
    (folder / "a.json").write_text("{}")


def test_a_scene_is_current_only_with_its_recipe_and_all_files(tmp_path: Path):
    dataset = Dataset(tmp_path, "s")
    dataset.add("one", "recipe", RENDERER, write_one)
    again = Dataset(tmp_path, "s")
    assert again.is_current("one", "recipe", None)
    assert not again.is_current("one", "another", None)
    assert not again.is_current("two", "recipe", None)
    assert again.is_current("one", "recipe", "none")
    assert not again.is_current("one", "recipe", "llvm_ad_rgb")
    (tmp_path / "one" / "a.json").write_text("[]")  # as long as it was
    assert not again.is_current("one", "recipe", None)


def test_the_manifest_holds_every_file_s_hash(tmp_path: Path):
    Dataset(tmp_path, "s").add("one", "recipe", RENDERER, write_one)
    manifest = json.loads((tmp_path / MANIFEST).read_text())
    entry = manifest["scenes"]["one"]["files"]["a.json"]
    assert entry == {"sha256": sha256(tmp_path / "one" / "a.json"), "bytes": 2}


def test_an_interrupted_scene_leaves_no_scene_and_is_cleaned_up(tmp_path: Path):
    def interrupted(folder: Path) -> None:
        write_one(folder)
        raise KeyboardInterrupt

    dataset = Dataset(tmp_path, "s")
    dataset.add("one", "recipe", RENDERER, write_one)
    with pytest.raises(KeyboardInterrupt):
        dataset.add("two", "recipe", RENDERER, interrupted)
    assert not (tmp_path / "two").exists()
    assert Dataset(tmp_path, "s").is_current("one", "recipe", None)
    Dataset(tmp_path, "s").add("two", "recipe", RENDERER, write_one)
    assert sorted(path.name for path in tmp_path.iterdir()) == [MANIFEST, "one", "two"]


def test_scenes_that_the_suite_no_longer_names_go(tmp_path: Path):
    dataset = Dataset(tmp_path, "s")
    for name in ("b", "a", "c"):
        dataset.add(name, "recipe", RENDERER, write_one)
    dataset.keep_only(["c", "a"])
    assert list(json.loads((tmp_path / MANIFEST).read_text())["scenes"]) == ["c", "a"]
    assert not (tmp_path / "b").exists()


def test_another_suite_s_dataset_is_neither_taken_nor_overwritten(tmp_path: Path):
    Dataset(tmp_path, "s").add("one", "recipe", RENDERER, write_one)
    with pytest.raises(DatasetError, match=r"holds suite 's'.*not 't'"):
        Dataset(tmp_path, "t")
    assert Dataset(tmp_path, "s").is_current("one", "recipe", None)


@pytest.mark.parametrize("text", ["{", "[]", '{"format": 1}'])
def test_a_broken_manifest_is_named(tmp_path: Path, text: str):
    (tmp_path / MANIFEST).write_text(text)
    with pytest.raises(DatasetError, match=r"dataset\.json: not a manifest"):
        Dataset(tmp_path, "s")


def test_names_that_leave_the_folder_are_refused(tmp_path: Path):
    Dataset(tmp_path, "s").add("one", "recipe", RENDERER, write_one)
    path = tmp_path / MANIFEST
    path.write_text(path.read_text().replace('"one"', '"../one"'))
    with pytest.raises(DatasetError, match=r"\.\./one"):
        Dataset(tmp_path, "s")


def test_a_forgotten_scene_is_not_in_the_manifest(tmp_path: Path):
    dataset = Dataset(tmp_path, "s")
    dataset.add("one", "recipe", RENDERER, write_one)
    dataset.add("two", "recipe", RENDERER, write_one)
    dataset.forget(["one"])
    assert list(json.loads((tmp_path / MANIFEST).read_text())["scenes"]) == ["two"]


def test_planes_read_back_to_the_last_bit(tmp_path: Path):
    generator = np.random.default_rng(0)
    fine = generator.random((8, 12), dtype=np.float32)
    coarse = generator.random((4, 6), dtype=np.float32)
    path = tmp_path / "a.exr"
    exr.write(path, (exr.Layer("f", {"R": fine}), exr.Layer("c", {"R": coarse})), {})
    with OpenEXR.File(str(path), separate_channels=True) as file:
        assert (file.parts[0].channels["R"].pixels == fine).all()
        assert (file.parts[1].channels["R"].pixels == coarse).all()


def test_a_plane_that_would_lose_digits_or_is_not_finite_is_refused(tmp_path: Path):
    path = tmp_path / "a.exr"
    with pytest.raises(TypeError, match=r"x.R is float64"):
        exr.write(path, (exr.Layer("x", {"R": np.zeros((2, 2))}),), {})
    plane = np.full((2, 2), np.nan, dtype=np.float32)
    with pytest.raises(ValueError, match="not finite"):
        exr.write(path, (exr.Layer("x", {"R": plane}),), {})
