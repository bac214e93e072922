"""Whether a dataset is the same after rendering was killed again and again, at random moments.

Every run is killed as a whole (`kill -9` to its process group) and started again. Says after each
kill which scenes are whole, and at the end whether the dataset is byte for byte that of a run that
nobody killed: `python -m studies.kills --kills 20 --jobs 2`.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from studies.runs import contents, events, render, start


def main() -> int:
    """Kill, resume, compare; return 0 if nothing was lost or altered."""
    parser = argparse.ArgumentParser(prog="studies.kills", description=__doc__)
    parser.add_argument("--suite", default="tiny", help="a suite of the tests")
    parser.add_argument("--jobs", default="2", help="worker processes")
    parser.add_argument("--kills", type=int, default=20, help="how often to kill")
    parser.add_argument("--seed", type=int, default=0, help="of the moments")
    arguments = parser.parse_args()
    options = ["--jobs", arguments.jobs]
    with tempfile.TemporaryDirectory() as folder:
        reference = Path(folder) / "reference"
        started = time.monotonic()
        render(arguments.suite, reference, *options)
        longest = time.monotonic() - started
        generator = random.Random(arguments.seed)
        moments = [longest * generator.random() for _ in range(arguments.kills)]
        killed = Path(folder) / "killed"
        same = is_same_after_kills(arguments.suite, reference, killed, moments, options)
    print("the same bytes" if same else "DIFFERENT")
    return 0 if same else 1


def is_same_after_kills(
    suite: str,
    reference: Path,
    output: Path,
    moments: Sequence[float],
    options: Sequence[str] = (),
) -> bool:
    """Return whether a dataset is like another, though its runs were killed.

    Parameters
    ----------
    suite : str
        What is rendered.
    reference : Path
        The dataset as it should be.
    output : Path
        Where to render; begun anew when all scenes are there before the last kill.
    moments : Sequence[float]
        How long after its first scene was begun with each run is killed [s].
    options : Sequence[str]
        Of the renderer.
    """
    for number, moment in enumerate(moments, 1):
        if output.exists() and contents(output) == contents(reference):
            shutil.rmtree(output)
        while not _killed(start(suite, output, *options), moment):
            moment /= 2.0  # it was ready before
            if contents(output) != contents(reference):
                return False
            shutil.rmtree(output)
        whole = sorted(path.parent.name for path in output.glob("[!.]*/files.json"))
        print(
            f"kill {number} after {moment:.2f} s; whole: {', '.join(whole) or 'none'}", flush=True
        )
    render(suite, output, *options)
    return contents(output) == contents(reference)


def _killed(run: subprocess.Popen[str], moment: float) -> bool:
    """Kill a run and its workers after a time [s]; return whether it was still at work."""
    any(event["event"] == "rendering" for event in events(run))
    try:
        run.wait(timeout=moment)
        return False
    except subprocess.TimeoutExpired:
        os.killpg(run.pid, signal.SIGKILL)
        return True
    finally:
        run.communicate()


if __name__ == "__main__":
    sys.exit(main())
