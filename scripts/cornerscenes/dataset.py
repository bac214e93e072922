"""A rendered dataset on disk: whole scenes or none, hashed, resumable.

A scene's folder is written under a temporary name and renamed; then the manifest, `dataset.json`,
is replaced by one that holds the scene's recipe and the SHA-256 of its files. What the manifest
does not name does not count.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

FORMAT = 2
MANIFEST = "dataset.json"
TEMPORARY = ".rendering-"
LEGAL_NAME = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9._-]*")

T = TypeVar("T")


class DatasetError(Exception):
    """A folder that cannot take this dataset; the message says why and what to do."""


class Dataset:
    """The folder of one rendered suite."""

    def __init__(self, folder: Path, suite: str) -> None:
        """Open the folder, or take it as a new one.

        Raises
        ------
        DatasetError
            When a dataset of another suite or format is there, or its manifest is broken.
        """
        self.folder = folder
        self._manifest: dict[str, Any] = {"format": FORMAT, "suite": suite, "scenes": {}}
        path = folder / MANIFEST
        if not path.exists():
            return
        try:
            found = json.loads(path.read_text(encoding="utf-8"))
            kind = found["format"], found["suite"]
            names = [
                name for entry in found["scenes"].items() for name in (entry[0], *entry[1]["files"])
            ]
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            raise DatasetError(
                f"{path}: not a manifest ({error}); choose another folder"
            ) from error
        if kind != (FORMAT, suite):
            raise DatasetError(
                f"{folder}: holds suite {kind[1]!r} in format {kind[0]}, not {suite!r} in format "
                f"{FORMAT}; choose another folder"
            )
        for name in names:
            if not LEGAL_NAME.fullmatch(name):
                raise DatasetError(f"{path}: {name!r} is no name of a scene or file")
        self._manifest = found

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
        entry = self._manifest["scenes"].get(scene)
        return (
            entry is not None
            and entry["recipe_sha256"] == recipe
            and variant in (None, entry["renderer"]["variant"])
            and all(
                (self.folder / scene / name).is_file()
                and sha256(self.folder / scene / name) == file["sha256"]
                for name, file in entry["files"].items()
            )
        )

    def add(
        self, scene: str, recipe: str, renderer: dict[str, str], write: Callable[[Path], T]
    ) -> T:
        """Write a scene: all of its files, then its line in the manifest.

        Parameters
        ----------
        scene : str
            Its name, which is its folder's name.
        recipe : str
            Hash of what it was rendered from.
        renderer : dict[str, str]
            Name, version and variant of the renderer.
        write : Callable[[Path], T]
            Writes the files into the folder it is given.

        Returns
        -------
        T
            What `write` returned.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        for left_behind in self.folder.glob(f"{TEMPORARY}{scene}-*"):
            shutil.rmtree(left_behind)
        temporary = Path(tempfile.mkdtemp(prefix=f"{TEMPORARY}{scene}-", dir=self.folder))
        temporary.chmod(0o755)
        result = write(temporary)
        files = {
            file.name: {"sha256": sha256(file), "bytes": file.stat().st_size}
            for file in sorted(temporary.iterdir())
        }
        final = self.folder / scene
        if final.exists():
            self._manifest["scenes"].pop(scene, None)
            self._write_manifest()
            shutil.rmtree(final)
        temporary.rename(final)
        self._manifest["scenes"][scene] = {
            "recipe_sha256": recipe,
            "renderer": renderer,
            "files": files,
        }
        self._write_manifest()
        return result

    def forget(self, scenes: list[str]) -> None:
        """Drop scenes from the manifest, so that what is outdated cannot be taken for current."""
        entries = self._manifest["scenes"]
        if entries.keys() & set(scenes):
            self._manifest["scenes"] = {n: entry for n, entry in entries.items() if n not in scenes}
            self._write_manifest()

    def keep_only(self, scenes: list[str]) -> None:
        """Drop the scenes that the suite no longer names, and put the others in its order."""
        entries = self._manifest["scenes"]
        kept = {name: entries[name] for name in scenes if name in entries}
        if list(kept) != list(entries):
            for name in entries.keys() - kept.keys():
                shutil.rmtree(self.folder / name, ignore_errors=True)
            self._manifest["scenes"] = kept
            self._write_manifest()

    def _write_manifest(self) -> None:
        write_json(self.folder / MANIFEST, self._manifest)


def sha256(path: Path) -> str:
    """Return the SHA-256 of a file, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Write JSON under a temporary name and rename it; NaN and infinity are errors."""
    text = json.dumps(content, indent=1, allow_nan=False) + "\n"
    with tempfile.NamedTemporaryFile(
        "w", dir=path.parent, prefix=f".{path.name}-", delete=False, encoding="utf-8"
    ) as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    os.chmod(file.name, 0o644)
    os.replace(file.name, path)
