"""Folders of files that appear whole or not at all, on disk and in an object store."""

from pathlib import Path
from uuid import uuid4

import pytest

from cornerscenes.storage import ENTRY, Bucket, Folder, Storage, StorageError, storage_at


@pytest.fixture(params=["folder", "bucket"])
def storage(request: pytest.FixtureRequest, tmp_path: Path) -> Storage:
    address = f"memory://{uuid4()}/data" if request.param == "bucket" else str(tmp_path / "data")
    found = storage_at(address)
    found.make()
    return found


def fill(storage: Storage, name: str, files: dict[str, str]) -> None:
    with storage.new_folder(name) as folder:
        for file, content in files.items():
            (folder / file).write_text(content)


def test_an_address_is_opened_by_its_kind(tmp_path: Path):
    assert isinstance(storage_at(str(tmp_path)), Folder)
    assert isinstance(storage_at(tmp_path.as_uri()), Folder)
    assert isinstance(storage_at("memory://a"), Bucket)
    with pytest.raises(StorageError, match=r"nowhere://a: cannot open: .*nowhere"):
        storage_at("nowhere://a")


def test_a_folder_holds_what_was_put_in_and_nothing_of_the_one_before(storage: Storage):
    assert storage.folders() == set()
    fill(storage, "one", {"a": "first", "old": "gone", ENTRY: "{}"})
    fill(storage, "one", {"a": "second", ENTRY: "[]"})
    assert storage.folders() == {"one"}
    found = storage.read(["one/a", "one/old", f"one/{ENTRY}", "two/a"])
    assert found == {"one/a": b"second", f"one/{ENTRY}": b"[]"}
    storage.remove("one")
    assert storage.folders() == set()


def test_a_folder_that_this_machine_does_not_share_is_not_made_there(tmp_path: Path):
    with pytest.raises(StorageError, match=r"no such folder on .*must be one that they share"):
        fill(storage_at(str(tmp_path / "elsewhere")), "one", {ENTRY: "{}"})
    assert list(tmp_path.iterdir()) == []


def test_a_folder_whose_writing_breaks_off_leaves_the_one_before(storage: Storage):
    fill(storage, "one", {"a": "first", ENTRY: "{}"})
    with pytest.raises(KeyboardInterrupt), storage.new_folder("one") as folder:
        (folder / "a").write_text("second")
        raise KeyboardInterrupt
    assert storage.read(["one/a"]) == {"one/a": b"first"}
    assert storage.folders() == {"one"}


def test_a_bucket_s_folder_has_no_entry_before_all_else_is_there(monkeypatch: pytest.MonkeyPatch):
    storage = storage_at(f"memory://{uuid4()}")
    assert isinstance(storage, Bucket)
    fill(storage, "one", {ENTRY: "{}", "a": "first", "z": "first"})
    put = storage._files.put_file

    def broken_off(source: str, target: str) -> None:
        if target.endswith("/z"):
            raise ConnectionError
        put(source, target)

    monkeypatch.setattr(storage._files, "put_file", broken_off)
    with pytest.raises(ConnectionError):
        fill(storage, "one", {ENTRY: "{}", "a": "second", "z": "second"})
    assert storage.read(["one/a", f"one/{ENTRY}"]) == {"one/a": b"second"}


def test_what_was_left_unfinished_goes_and_that_of_others_stays(tmp_path: Path):
    storage = Folder(tmp_path)
    for name in ("one", "one-more", "two"):
        storage._hidden(name)
    storage.remove_unfinished(["one"])
    left = sorted(path.name.partition("~")[0] for path in tmp_path.iterdir())
    assert left == [".rendering-one-more", ".rendering-two"]
    storage.remove_unfinished(None)
    assert list(tmp_path.iterdir()) == []


def test_a_file_is_held_with_its_size_and_on_disk_with_its_content(storage: Storage):
    storage.write("a", b"abc")
    abc = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    assert storage.holds("a", abc, 3)
    assert not storage.holds("a", abc, 4)
    assert not storage.holds("b", abc, 3)
    storage.write("a", b"abd")
    assert storage.holds("a", abc, 3) == isinstance(storage, Bucket)
