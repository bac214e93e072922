"""Whole rendering runs as processes, for the tests and studies that stop them."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

SCRIPTS = Path(__file__).parents[1]
RECIPES = SCRIPTS.parent / "tests" / "recipes"


def start(suite: str, output: Path | str, *options: str) -> subprocess.Popen[str]:
    """Start to render a suite of the tests, in a process group of its own.

    Its standard output says what happens; it stops when its standard input is closed.
    """
    command = [sys.executable, "-m", "cornerscenes.render", suite, "--recipes", str(RECIPES)]
    return subprocess.Popen(
        [*command, "--output", str(output), *options],
        cwd=SCRIPTS,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        start_new_session=True,
    )


def events(run: subprocess.Popen[str]) -> Iterator[dict[str, Any]]:
    """Yield what a run says, as it comes."""
    assert run.stdout is not None
    return (json.loads(line) for line in run.stdout)


def render(suite: str, output: Path | str, *options: str) -> None:
    """Render a suite of the tests to its end."""
    with start(suite, output, *options) as run:
        said = list(events(run))  # until its end; its input stays open as long
    if run.returncode != 0:
        raise RuntimeError(f"rendering {suite} ended with {run.returncode}: {said}")


def contents(folder: Path) -> dict[str, str]:
    """Return the SHA-256 of every file of a dataset, hidden and unfinished ones included."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }
