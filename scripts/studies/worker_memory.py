"""Memory of the process that renders, over hundreds of very small scenes.

Loading a scene leaks in the renderer, so a worker is replaced after some scenes. Prints the
resident memory after every fiftieth scene, the largest one so far, and how it grows:
`python -m studies.worker_memory`. `--scenes-per-worker 300` shows it without replacement.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from shutil import copytree

import numpy as np

from cornerscenes.render import SCENES_PER_WORKER
from cornerscenes.storage import storage_at
from cornerscenes.tasks import Setting, Task, render_one, tasks_of
from cornerscenes.workers import Stop, Workers
from studies.runs import RECIPES

STEP = 50


@dataclass(frozen=True)
class Memory:
    """Resident memory [bytes] of a process after it has rendered a scene, and which process."""

    resident_bytes: int
    process: int


def main() -> int:
    """Render, one scene after the other, and print the memory."""
    parser = argparse.ArgumentParser(prog="studies.worker_memory", description=__doc__)
    parser.add_argument("--scenes", type=int, default=300)
    parser.add_argument("--scenes-per-worker", type=int, default=SCENES_PER_WORKER)
    parser.add_argument("--variant", default="llvm_ad_rgb")
    arguments = parser.parse_args()
    found: list[Memory] = []
    with tempfile.TemporaryDirectory() as folder:
        tasks = tiny_scenes(arguments.scenes, Path(folder) / "recipes")
        setting = Setting(f"{folder}/dataset", arguments.variant, threads=1)
        storage_at(setting.address).make()
        with Workers(arguments.scenes_per_worker, Stop()) as workers:
            for outcome in workers.run(partial(memory_after, setting=setting), tasks):
                if outcome.result is None:
                    raise RuntimeError(f"{outcome.task.name}: {outcome.problem}")
                found.append(outcome.result)
                if len(found) % STEP == 0:
                    print(described(found), flush=True)
    megabytes = np.array([memory.resident_bytes for memory in found]) / 1e6
    (slope, _), covariance = np.polyfit(np.arange(len(found)), megabytes, 1, cov=True)
    print(
        f"growth: {slope:.4f} +- {np.sqrt(covariance[0, 0]):.4f} MB a scene, over {len(found)} "
        f"scenes in {len({memory.process for memory in found})} processes"
    )
    return 0


def tiny_scenes(count: int, recipes: Path) -> list[Task]:
    """Return so many scenes of family `tiny`; their recipes are written into a new folder."""
    copytree(RECIPES, recipes)
    film, _, _ = (RECIPES / "suites" / "tiny.toml").read_text().partition("[[scenes]]")
    group = f'[[groups]]\nfamily = "tiny"\nscenes = {count}\n'
    (recipes / "suites" / "many.toml").write_text(film + group)
    return tasks_of("many", recipes)


def memory_after(task: Task, setting: Setting) -> Memory:
    """Render a scene and return the memory of this process."""
    render_one(task, setting)
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return Memory(pages * os.sysconf("SC_PAGE_SIZE"), os.getpid())


def described(found: list[Memory]) -> str:
    """Return a line on the memory after the last scene."""
    largest = max(memory.resident_bytes for memory in found)
    last = found[-1].resident_bytes
    return f"scene {len(found)}: {last / 1e6:.0f} MB; largest so far: {largest / 1e6:.0f} MB"


if __name__ == "__main__":
    sys.exit(main())
