"""A dataset's folder: whole scenes or none."""

import json
from pathlib import Path
from uuid import uuid4

import numpy as np
import OpenEXR
import pytest

from cornerscenes import exr
from cornerscenes.dataset import FORMAT, INDEX, Dataset, DatasetError, Renderer, sha256
from cornerscenes.storage import ENTRY, Storage, storage_at

RENDERER = Renderer(name="none", version="0", variant="none")


@pytest.fixture(params=["folder", "bucket"])
def storage(request: pytest.FixtureRequest, tmp_path: Path) -> Storage:
    return storage_at(f"memory://{uuid4()}" if request.param == "bucket" else str(tmp_path))


def write_one(folder: Path) -> None:
    (folder / "a.json").write_text("{}")


def add(storage: Storage, *scenes: str, recipe: str = "recipe") -> None:
    for scene in scenes:
        Dataset(storage, "s").add(scene, recipe, RENDERER, write_one)


def published(storage: Storage, *scenes: str, **options: object) -> list[str]:
    """Publish an index for these scenes of one recipe and return the names in it."""
    Dataset(storage, "s").publish(dict.fromkeys(scenes, "recipe"), **options)  # type: ignore[arg-type]
    return list(json.loads(storage.read([INDEX])[INDEX])["scenes"])


def test_a_scene_is_current_only_with_its_recipe_and_all_files(tmp_path: Path):
    add(storage_at(str(tmp_path)), "one")
    dataset = Dataset(storage_at(str(tmp_path)), "s")
    assert dataset.is_current("one", "recipe", None)
    assert not dataset.is_current("one", "another", None)
    assert not dataset.is_current("two", "recipe", None)
    assert dataset.is_current("one", "recipe", "none")
    assert not dataset.is_current("one", "recipe", "llvm_ad_rgb")
    (tmp_path / "one" / "a.json").write_text("[]")  # as long as it was
    assert not dataset.is_current("one", "recipe", None)


def test_a_scene_s_own_entry_holds_every_other_file_s_hash_and_is_in_the_index(tmp_path: Path):
    storage = storage_at(str(tmp_path))
    add(storage, "one")
    published(storage, "one")
    entry = json.loads((tmp_path / "one" / ENTRY).read_text())
    assert entry["recipe_sha256"] == "recipe"
    assert entry["files"] == {"a.json": {"sha256": sha256(tmp_path / "one/a.json"), "bytes": 2}}
    assert json.loads((tmp_path / INDEX).read_text())["scenes"] == {"one": entry}


def test_an_interrupted_scene_leaves_no_scene(storage: Storage):
    def interrupted(folder: Path) -> None:
        write_one(folder)
        raise KeyboardInterrupt

    add(storage, "one")
    with pytest.raises(KeyboardInterrupt):
        Dataset(storage, "s").add("two", "recipe", RENDERER, interrupted)
    assert storage.folders() == {"one"}
    assert published(storage, "one", "two") == ["one"]


def test_the_index_names_whole_scenes_of_the_recipe_in_the_suite_s_order(storage: Storage):
    add(storage, "b", "a", "d")
    add(storage, "c", recipe="older")
    with storage.new_folder("e") as folder:
        (folder / ENTRY).write_text("{")
    assert published(storage, "d", "c", "b", "e", "a") == ["d", "b", "a"]
    assert published(storage, "d", "c", "b", "a", unfit={"b"}) == ["d", "a"]


def test_the_index_is_repaired_from_the_entries(storage: Storage):
    add(storage, "one", "two")
    published(storage, "one")
    assert published(storage, "one", "two") == ["one", "two"]
    storage.remove("one")
    assert published(storage, "one", "two") == ["two"]


def test_a_scene_that_was_rendered_again_is_in_the_index_with_its_new_entry(storage: Storage):
    add(storage, "one", recipe="older")
    dataset = Dataset(storage, "s")
    dataset.publish({"one": "recipe"}, {"one"}, afresh=True)
    add(storage, "one")
    dataset.publish({"one": "recipe"})
    assert list(json.loads(storage.read([INDEX])[INDEX])["scenes"]) == ["one"]


def test_two_processes_that_publish_at_once_lose_no_scene(
    storage: Storage, monkeypatch: pytest.MonkeyPatch
):
    add(storage, "one")
    write = storage.write

    def overtaken(path: str, content: bytes) -> None:
        monkeypatch.setattr(storage, "write", write)
        add(storage, "two")
        assert published(storage, "one", "two") == ["one", "two"]
        write(path, content)  # older than what has just been written

    monkeypatch.setattr(storage, "write", overtaken)
    assert published(storage, "one", "two") == ["one", "two"]


def test_scenes_that_the_suite_no_longer_names_go_and_other_folders_stay(storage: Storage):
    add(storage, "a", "b")
    published(storage, "a", "b")
    with storage.new_folder("mine") as folder:
        (folder / "notes").write_text("mine")
    Dataset(storage, "s").remove_others(["a", "c"])
    assert storage.folders() == {"a", "mine"}


def test_another_suite_s_dataset_is_neither_taken_nor_overwritten(storage: Storage):
    add(storage, "one")
    published(storage, "one")
    with pytest.raises(DatasetError, match=r"holds suite 's'.*not 't'"):
        Dataset(storage, "t")
    assert Dataset(storage, "s").is_current("one", "recipe", None)


def test_an_older_format_s_dataset_is_replaced_and_a_newer_one_s_is_left(tmp_path: Path):
    storage = storage_at(str(tmp_path))
    add(storage, "one", "two")
    published(storage, "one", "two")
    path = tmp_path / INDEX
    text = path.read_text()
    path.write_text(text.replace(f'"format": {FORMAT}', f'"format": {FORMAT - 1}'))
    assert published(storage, "one") == ["one"]
    assert path.read_text().count(f'"format": {FORMAT}') == 1
    path.write_text(text.replace(f'"format": {FORMAT}', f'"format": {FORMAT + 1}'))
    with pytest.raises(DatasetError, match="choose another folder"):
        Dataset(storage, "s")


@pytest.mark.parametrize("text", ["{", "[]", '{"format": 1}'])
def test_a_broken_index_is_named(tmp_path: Path, text: str):
    (tmp_path / INDEX).write_text(text)
    with pytest.raises(DatasetError, match=r"dataset\.json: not a dataset's index"):
        Dataset(storage_at(str(tmp_path)), "s")


def test_names_that_leave_the_folder_are_refused(tmp_path: Path):
    storage = storage_at(str(tmp_path))
    add(storage, "one")
    published(storage, "one")
    path = tmp_path / INDEX
    path.write_text(path.read_text().replace('"one"', '"../one"'))
    with pytest.raises(DatasetError, match=r"\.\./one"):
        Dataset(storage, "s")


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
