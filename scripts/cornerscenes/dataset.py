"""A rendered dataset: whole scenes or none, hashed, resumable.

Each scene's folder holds its own entry, `files.json`: what the scene was rendered from and by, and
the SHA-256 of its files. It is there when all of them are. The index, `dataset.json`, names every
whole scene; it is put together from the entries, so that any number of processes, on any number of
machines, can render into one dataset. What the index does not name does not count.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from cornerscenes.storage import ENTRY, Storage, write_whole

FORMAT = 3
INDEX = "dataset.json"

# How often an index is put together again when others write theirs at the same time.
TRIES = 10

T = TypeVar("T")
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9_-][A-Za-z0-9._-]*$")]


class DatasetError(Exception):
    """A folder that cannot take this dataset; the message says why and what to do."""


class _Model(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Renderer(_Model):
    """What rendered a scene."""

    name: str
    version: str
    variant: str


class File(_Model):
    """One file of a scene."""

    sha256: str
    bytes: int


class Entry(_Model):
    """A whole scene: hash of what it was rendered from, what rendered it, its other files."""

    recipe_sha256: str
    renderer: Renderer
    files: dict[Name, File]


class Index(_Model):
    """The scenes of a dataset, in the suite's order."""

    format: int
    suite: str
    scenes: dict[Name, Entry]


class Dataset:
    """One rendered suite.

    Parameters
    ----------
    storage : Storage
        Where it is kept.
    suite : str
        The suite.

    Raises
    ------
    DatasetError
        When a dataset of another suite or format is there, or its index is broken.
    """

    def __init__(self, storage: Storage, suite: str) -> None:
        self.storage = storage
        self._suite = suite
        self._entries: dict[str, Entry] = {}
        self._read_index()

    def is_current(self, scene: str, recipe: str, variant: str | None) -> bool:
        """Return whether a scene was rendered from this recipe and its files are those rendered.

        Parameters
        ----------
        scene : str
            Its name.
        recipe : str
            Hash of what it is to be rendered from.
        variant : str or None
            The renderer's variant that it must have been rendered with, if it matters.
        """
        entry = self._read_entries([scene]).get(scene)
        return (
            entry is not None
            and entry.recipe_sha256 == recipe
            and variant in (None, entry.renderer.variant)
            and all(
                self.storage.holds(f"{scene}/{name}", file.sha256, file.bytes)
                for name, file in entry.files.items()
            )
        )

    def add(
        self, scene: str, recipe: str, renderer: Renderer, write: Callable[[Path], T]
    ) -> tuple[T, int]:
        """Write a scene: all of its files, and the entry that says so.

        Parameters
        ----------
        scene : str
            Its name, which is its folder's name.
        recipe : str
            Hash of what it was rendered from.
        renderer : Renderer
            What rendered it.
        write : Callable[[Path], T]
            Writes the files into the folder it is given.

        Returns
        -------
        tuple[T, int]
            What `write` returned, and the size of the files [bytes].
        """
        with self.storage.new_folder(scene) as folder:
            result = write(folder)
            files = {
                file.name: File(sha256=sha256(file), bytes=file.stat().st_size)
                for file in sorted(folder.iterdir())
            }
            entry = Entry(recipe_sha256=recipe, renderer=renderer, files=files)
            write_json(folder / ENTRY, entry.model_dump())
        return result, sum(file.bytes for file in files.values())

    def publish(
        self, recipes: Mapping[str, str], unfit: Collection[str] = (), afresh: bool = False
    ) -> Collection[str]:
        """Write the index and return what it names: the whole scenes rendered from these recipes.

        Other processes may do so at the same moment. Who has written looks again, so that the last
        to write has seen every scene that was whole by then.

        Parameters
        ----------
        recipes : Mapping[str, str]
            The suite's scenes in their order, each with the hash of its recipe.
        unfit : Collection[str]
            Scenes to leave out: known to be damaged, or to be rendered again.
        afresh : bool
            Whether to read every entry again, and not only those of scenes that are new.
        """
        scenes: dict[str, Entry] = {}
        for _ in range(TRIES):
            known = {} if afresh else self._entries
            there = self.storage.folders() - set(unfit)
            new = self._read_entries(sorted(there - known.keys()))
            self._entries = {n: known[n] for n in there & known.keys()} | new
            scenes = {
                name: self._entries[name]
                for name, recipe in recipes.items()
                if name in self._entries and self._entries[name].recipe_sha256 == recipe
            }
            found = self._read_index()
            if list(found.items()) == list(scenes.items()):
                break
            index = Index(format=FORMAT, suite=self._suite, scenes=scenes)
            self.storage.write(INDEX, as_json(index.model_dump()))
        return scenes.keys()

    def remove_others(self, scenes: Collection[str]) -> None:
        """Remove the scenes that the suite no longer names."""
        there = self.storage.folders() - set(scenes)
        named = self._read_index().keys() | self._read_entries(sorted(there)).keys()
        for name in sorted(there & named):
            self.storage.remove(name)

    def _read_entries(self, scenes: list[str]) -> dict[str, Entry]:
        """Return the entries of those scenes that are whole."""
        content = self.storage.read([f"{scene}/{ENTRY}" for scene in scenes])
        entries = {}
        for scene in scenes:
            try:
                entries[scene] = Entry.model_validate_json(content[f"{scene}/{ENTRY}"])
            except (KeyError, ValidationError):
                continue
        return entries

    def _read_index(self) -> dict[str, Entry]:
        """Return the scenes that the index names."""
        content = self.storage.read([INDEX]).get(INDEX)
        if content is None:
            return {}
        try:
            index = Index.model_validate_json(content)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            place = ".".join(str(step) for step in first["loc"])
            raise DatasetError(
                f"{self.storage}/{INDEX}: not a dataset's index ({place}: {first['msg']}); choose "
                f"another folder"
            ) from error
        if index.suite != self._suite or index.format > FORMAT:
            raise DatasetError(
                f"{self.storage}: holds suite {index.suite!r} in format {index.format}, not "
                f"{self._suite!r} in format {FORMAT}; choose another folder"
            )
        # Of an older format no scene is whole: all are rendered again.
        return index.scenes if index.format == FORMAT else {}


def sha256(path: Path) -> str:
    """Return the SHA-256 of a file, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def as_json(content: dict[str, Any]) -> bytes:
    """Return JSON; NaN and infinity are errors."""
    return (json.dumps(content, indent=1, allow_nan=False) + "\n").encode()


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Write JSON under a temporary name and rename it; NaN and infinity are errors."""
    write_whole(path, as_json(content))
