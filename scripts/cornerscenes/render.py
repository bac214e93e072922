"""Rendering a suite: reads its recipes, renders what is missing, says what it did."""

from __future__ import annotations

import argparse
import hashlib
import importlib.metadata
import json
import os
import sys
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from multiprocessing import get_context
from pathlib import Path

from cornerscenes.dataset import FORMAT, Dataset, DatasetError
from cornerscenes.library import Library
from cornerscenes.recipes import Family, SceneRecipe, Suite
from cornerscenes.tables import RecipeError, read

# Loading a scene leaks in the renderer: a worker renders this many scenes and is replaced.
SCENES_PER_WORKER = 8

# What computes the content of a scene.
PACKAGES = ("drjit", "mitsuba", "numpy", "scipy")

# What of this package does not: a change of these renders nothing again.
NOT_GENERATORS = ("render.py", "schemas.py")

Tell = Callable[[Mapping[str, object]], None]


@dataclass(frozen=True)
class Job:
    """One scene to render, as it is handed to a worker."""

    suite_name: str
    suite: Suite
    scene: SceneRecipe
    family: Family
    library: Library
    recipe_sha256: str
    variant: str


HOW_TO_BE_FAST = (
    "rendering with scalar_rgb, the slow variant: no libLLVM found; "
    "on Debian and Ubuntu: apt-get install libllvm19"
)


def main() -> int:
    """Render a suite; progress goes to standard output as JSON lines."""
    parser = argparse.ArgumentParser(prog="cornerscenes.render", description=main.__doc__)
    parser.add_argument("suite", help="name of a suite")
    parser.add_argument("--recipes", type=Path, required=True, help="folder of suites and families")
    parser.add_argument("--output", type=Path, required=True, help="folder of the dataset")
    parser.add_argument("--variant", help="Mitsuba variant to use instead of the fastest")
    arguments = parser.parse_args()
    tell = _event_channel()
    try:
        return render(arguments.suite, arguments.recipes, arguments.output, arguments.variant, tell)
    except (RecipeError, DatasetError) as error:
        tell({"event": "error", "message": str(error)})
        return 2


def render(
    suite_name: str, recipes: Path, output: Path, wanted_variant: str | None, tell: Tell
) -> int:
    """Render the scenes of a suite that are missing or whose recipe changed.

    Parameters
    ----------
    suite_name : str
        The suite.
    recipes : Path
        Folder of suites and families.
    output : Path
        Folder of the dataset.
    wanted_variant : str or None
        Mitsuba variant; the fastest of this machine where it is `None`.
    tell : Tell
        Is told what happens, one event after the other.

    Returns
    -------
    int
        0 when every scene is there, 1 when one failed.
    """
    suite = read(Suite, recipes / "suites" / f"{suite_name}.toml")
    scenes = suite.all_scenes(suite_name)
    names = {scene.family for scene in scenes}
    library = Library.of(recipes)
    families = {name: read(Family, recipes / "families" / f"{name}.toml") for name in sorted(names)}
    dataset = Dataset(output, suite_name)
    dataset.keep_only([scene.name for scene in scenes])
    wanted = {
        scene.name: recipe_hash(suite_name, scene, suite, families[scene.family], library)
        for scene in scenes
    }
    missing = [s for s in scenes if not dataset.is_current(s.name, wanted[s.name], wanted_variant)]
    tell({"event": "start", "scenes": len(scenes), "missing": len(missing)})
    if not missing:
        return 0
    dataset.forget([scene.name for scene in missing])
    failed = 0
    with ProcessPoolExecutor(
        max_workers=1, mp_context=get_context("spawn"), max_tasks_per_child=SCENES_PER_WORKER
    ) as pool:
        variant = pool.submit(_choose_variant, wanted_variant).result()
        if variant.startswith("scalar") and wanted_variant is None:
            tell({"event": "slow", "message": HOW_TO_BE_FAST})
        for scene in missing:
            tell({"event": "rendering", "scene": scene.name})
            family = families[scene.family]
            job = Job(suite_name, suite, scene, family, library, wanted[scene.name], variant)
            try:
                done = pool.submit(_render_one, job, Dataset(output, suite_name)).result()
                tell({"event": "done", "scene": scene.name, **done})
            except RecipeError as error:
                failed += 1
                tell({"event": "failed", "scene": scene.name, "message": str(error)})
            except Exception as error:  # whatever it is, the other scenes are still to be rendered
                failed += 1
                message = f"{type(error).__name__}: {error}"
                tell({"event": "failed", "scene": scene.name, "message": message})
    Dataset(output, suite_name).keep_only([scene.name for scene in scenes])
    return 1 if failed else 0


def recipe_hash(
    suite_name: str, scene: SceneRecipe, suite: Suite, family: Family, library: Library
) -> str:
    """Return the hash of all that decides a scene's content: its recipe and its generators."""
    content = {
        "format": FORMAT,
        "suite": suite_name,
        "scene": asdict(scene),
        "film": suite.film.model_dump(),
        "family": family.model_dump(exclude={"summary"}),
        "library": library.used_by(family).described(),
        "generators": generators(),
    }
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def generators() -> dict[str, str]:
    """Return the versions of what makes a scene: packages, and this package's sources.

    Not among the sources are `NOT_GENERATORS`: this module, which hands scenes to workers, for one.
    """
    sources = hashlib.sha256()
    for path in sorted(Path(__file__).parent.rglob("*.py")):
        if path.name not in NOT_GENERATORS:
            sources.update(path.read_bytes())
    return {
        "cornerscenes": sources.hexdigest(),
        **{name: importlib.metadata.version(name) for name in PACKAGES},
    }


# The next two run in the worker, and import the renderer there: where nothing is missing, it is
# never loaded.


def _choose_variant(wanted: str | None) -> str:
    from cornerscenes import mitsuba_backend

    return mitsuba_backend.choose_variant(wanted)


def _render_one(job: Job, dataset: Dataset) -> dict[str, float]:
    from cornerscenes import mitsuba_backend, scene_files
    from cornerscenes.layout import lay_out

    started = time.monotonic()
    mitsuba_backend.choose_variant(job.variant)
    scene = lay_out(job.suite_name, job.scene, job.family, job.library)
    key = f"{job.suite_name}/{job.scene.name}"
    renderer = {
        "name": "mitsuba",
        "version": importlib.metadata.version("mitsuba"),
        "variant": job.variant,
    }
    fraction = dataset.add(
        job.scene.name,
        job.recipe_sha256,
        renderer,
        lambda folder: scene_files.write(folder, scene, job.suite.film, job.scene, key),
    )
    return {
        "visible_fraction": fraction,
        "seconds": round(time.monotonic() - started, 3),
    }


def _event_channel() -> Tell:
    """Return what writes events to standard output, and send all else that is printed to error.

    The renderer's own log goes to standard output; it must not stand between the events.
    """
    channel = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)

    def tell(event: Mapping[str, object]) -> None:
        channel.write(json.dumps(event) + "\n")
        channel.flush()

    return tell


if __name__ == "__main__":
    sys.exit(main())
