"""Where a dataset is kept: a folder, or an address of an object store.

A folder may be one that many machines share. An address is whatever fsspec opens:
`s3://bucket/name`, `gs://bucket/name`.
"""

from __future__ import annotations

import hashlib
import os
import platform
import shutil
import sys
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Protocol
from urllib.parse import urlsplit
from urllib.request import url2pathname

# The file that says that its folder is whole: the last one to appear, the first one to go.
ENTRY = "files.json"

# What is being written is hidden: this, the name, and an end that no name can hold.
TEMPORARY, TEMPORARY_END = ".rendering-", "~"


class StorageError(Exception):
    """A place that cannot be used; the message says why and what to do."""


class Storage(Protocol):
    """Folders of files, each of which appears whole or not at all."""

    def make(self) -> None:
        """Make the place itself, where it is not there yet: what it takes to write."""
        ...

    def folders(self) -> set[str]:
        """Return the names of the folders."""
        ...

    def read(self, paths: Iterable[str]) -> dict[str, bytes]:
        """Return the content of those of these files that are there."""
        ...

    def write(self, path: str, content: bytes) -> None:
        """Write a file, whole or not at all."""
        ...

    def holds(self, path: str, sha256: str, size_bytes: int) -> bool:
        """Return whether a file is there and is this one, as far as that can be told here."""
        ...

    def new_folder(self, name: str) -> AbstractContextManager[Path]:
        """Return a context that gives a local folder to fill.

        Where the context ends without an exception, what is in it replaces the folder `name`.
        """
        ...

    def remove(self, name: str) -> None:
        """Remove a folder."""
        ...

    def remove_unfinished(self, names: Iterable[str] | None) -> None:
        """Remove what an interruption left of these; of everything where it is `None`."""
        ...

    def free_bytes(self) -> int | None:
        """Return how much more there is room for; `None` where nobody knows."""
        ...


def storage_at(address: str) -> Storage:
    """Return the storage at a path or an address.

    Raises
    ------
    StorageError
        When nothing opens the address; the message says what is missing.
    """
    if address.startswith("file://"):
        return Folder(Path(url2pathname(urlsplit(address).path)))
    return Bucket(address) if "://" in address else Folder(Path(address).absolute())


class Folder:
    """A folder of the file system."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __str__(self) -> str:
        """Return the folder, for messages."""
        return str(self.path)

    def make(self) -> None:
        """Make the folder."""
        self.path.mkdir(parents=True, exist_ok=True)

    def folders(self) -> set[str]:
        """Return the names of the folders in it, but for hidden ones."""
        try:
            with os.scandir(self.path) as found:
                return {e.name for e in found if not e.name.startswith(".") and e.is_dir()}
        except FileNotFoundError:
            return set()

    def read(self, paths: Iterable[str]) -> dict[str, bytes]:
        """Return the content of those of these files that are there."""
        content = {}
        for path in paths:
            try:
                content[path] = (self.path / path).read_bytes()
            except (FileNotFoundError, NotADirectoryError):
                continue
        return content

    def write(self, path: str, content: bytes) -> None:
        """Write a file under a temporary name and rename it."""
        write_whole(self.path / path, content)

    def holds(self, path: str, sha256: str, size_bytes: int) -> bool:
        """Return whether a file is there and has this SHA-256."""
        try:
            with (self.path / path).open("rb") as file:
                return (
                    os.fstat(file.fileno()).st_size == size_bytes
                    and hashlib.file_digest(file, "sha256").hexdigest() == sha256
                )
        except (FileNotFoundError, NotADirectoryError, IsADirectoryError):
            return False

    @contextmanager
    def new_folder(self, name: str) -> Iterator[Path]:
        """Give a hidden folder beside the final one, then rename it: all appears at once."""
        if not self.path.is_dir():
            raise StorageError(
                f"{self.path}: no such folder on {platform.node()}; where several machines render, "
                f"it must be one that they share, or an address such as s3://bucket/name"
            )
        temporary = self._hidden(name)
        replaced = temporary.with_name(f"{temporary.name}-replaced")
        try:
            yield temporary
            final = self.path / name
            if final.exists():
                final.rename(replaced)
            temporary.rename(final)
        finally:
            for left_behind in (temporary, replaced):
                shutil.rmtree(left_behind, ignore_errors=True)

    def remove(self, name: str) -> None:
        """Remove a folder: first all of it at once from sight, then its files."""
        hidden = self._hidden(name)
        (self.path / name).rename(hidden / name)
        shutil.rmtree(hidden)

    def remove_unfinished(self, names: Iterable[str] | None) -> None:
        """Remove what an interruption left of these; of everything where it is `None`."""
        wanted = None if names is None else set(names)
        for found in self.path.glob(f"{TEMPORARY}*{TEMPORARY_END}*"):
            name = found.name.removeprefix(TEMPORARY).partition(TEMPORARY_END)[0]
            if wanted is None or name in wanted:
                if found.is_dir():
                    shutil.rmtree(found, ignore_errors=True)
                else:
                    found.unlink(missing_ok=True)

    def free_bytes(self) -> int | None:
        """Return the free space of the file system."""
        there = (folder for folder in (self.path, *self.path.parents) if folder.is_dir())
        return shutil.disk_usage(next(there)).free

    def _hidden(self, name: str) -> Path:
        prefix = f"{TEMPORARY}{name}{TEMPORARY_END}"
        folder = Path(tempfile.mkdtemp(prefix=prefix, dir=self.path))
        folder.chmod(0o755)
        return folder


class Bucket:
    """An address that fsspec opens.

    There, files appear one by one, each of them whole, and nothing can be renamed: a folder counts
    from when its entry is there, which is put last and goes first.
    """

    def __init__(self, address: str) -> None:
        import fsspec

        self._address = address
        try:
            self._files, self._root = fsspec.core.url_to_fs(address, use_listings_cache=False)
        except (ImportError, ValueError) as error:
            raise StorageError(
                f"{address}: cannot open: {error} (what is missing goes into {sys.prefix})"
            ) from error

    def __str__(self) -> str:
        """Return the address, for messages."""
        return self._address

    def _at(self, path: str) -> str:
        return f"{self._root}/{path}"

    def make(self) -> None:
        """Make the address, if its kind of store has such a thing as folders."""
        self._files.makedirs(self._root, exist_ok=True)

    def folders(self) -> set[str]:
        """Return the names of the folders below the address."""
        self._files.invalidate_cache()
        try:
            found = self._files.ls(self._root, detail=True)
        except FileNotFoundError:
            return set()
        folders = (item["name"] for item in found if item["type"] == "directory")
        return {folder.rstrip("/").rpartition("/")[2] for folder in folders}

    def read(self, paths: Iterable[str]) -> dict[str, bytes]:
        """Return the content of those of these files that are there."""
        path_at = {self._at(path): path for path in paths}
        content = {}
        answers = self._files.cat(list(path_at), on_error="return") if path_at else {}
        for at, answer in answers.items():
            if isinstance(answer, bytes):
                content[path_at[at]] = answer
            elif not isinstance(answer, FileNotFoundError):
                raise StorageError(f"{self._address}: cannot read {path_at[at]}: {answer}")
        return content

    def write(self, path: str, content: bytes) -> None:
        """Put a file."""
        self._files.pipe_file(self._at(path), content)

    def holds(self, path: str, sha256: str, size_bytes: int) -> bool:
        """Return whether a file is there and has this size: its bytes are not fetched."""
        try:
            return self._files.size(self._at(path)) == size_bytes
        except FileNotFoundError:
            return False

    @contextmanager
    def new_folder(self, name: str) -> Iterator[Path]:
        """Give a folder of this machine, then put its files, the entry last."""
        with tempfile.TemporaryDirectory(prefix=TEMPORARY) as temporary:
            folder = Path(temporary)
            yield folder
            self.remove(name)
            self._files.makedirs(self._at(name), exist_ok=True)
            for file in sorted(folder.iterdir(), key=lambda file: (file.name == ENTRY, file)):
                self._files.put_file(str(file), self._at(f"{name}/{file.name}"))

    def remove(self, name: str) -> None:
        """Remove a folder, its entry first."""
        for path, recursive in ((self._at(f"{name}/{ENTRY}"), False), (self._at(name), True)):
            if self._files.exists(path):
                self._files.rm(path, recursive=recursive)

    def remove_unfinished(self, names: Iterable[str] | None) -> None:
        """Do nothing: what has no entry is replaced when it is rendered."""

    def free_bytes(self) -> int | None:
        """Return `None`: nobody knows."""
        return None


def write_whole(path: Path, content: bytes) -> None:
    """Write a file to the disk under a temporary name and rename it."""
    prefix = f"{TEMPORARY}{path.name}{TEMPORARY_END}"
    with tempfile.NamedTemporaryFile(dir=path.parent, prefix=prefix, delete=False) as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    os.chmod(file.name, 0o644)
    os.replace(file.name, path)
