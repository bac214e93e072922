"""Rendering a suite: reads its recipes, renders what is missing, says what it did."""

from __future__ import annotations

import argparse
import hashlib
import importlib.metadata
import json
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from cornerscenes.dataset import FORMAT, Dataset
from cornerscenes.recipes import Family, RecipeError, SceneRecipe, Suite, read

# Loading a scene leaks in the renderer: a worker renders this many scenes and is replaced.
SCENES_PER_WORKER = 8

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
    try:
        return render(arguments.suite, arguments.recipes, arguments.output, arguments.variant)
    except RecipeError as error:
        _tell(event="error", message=str(error))
        return 2


def render(suite_name: str, recipes: Path, output: Path, variant: str | None) -> int:
    """Render the scenes of a suite that are missing or whose recipe changed.

    Returns
    -------
    int
        0 when every scene is there, 1 when one failed.
    """
    suite = read(Suite, recipes / "suites" / f"{suite_name}.toml")
    names = {scene.family for scene in suite.scenes}
    families = {name: read(Family, recipes / "families" / f"{name}.toml") for name in sorted(names)}
    dataset = Dataset(output, suite_name)
    dataset.keep_only([scene.name for scene in suite.scenes])
    wanted = {
        scene.name: recipe_hash(suite_name, scene, suite, families[scene.family])
        for scene in suite.scenes
    }
    missing = [s for s in suite.scenes if not dataset.is_current(s.name, wanted[s.name])]
    _tell(event="start", scenes=len(suite.scenes), missing=len(missing))
    failed = 0
    with ProcessPoolExecutor(
        max_workers=1, mp_context=get_context("spawn"), max_tasks_per_child=SCENES_PER_WORKER
    ) as pool:
        for scene in missing:
            family = families[scene.family]
            job = pool.submit(
                _render_one, dataset, suite_name, scene, suite, family, wanted[scene.name], variant
            )
            try:
                job.result()
            except RecipeError as error:
                failed += 1
                _tell(event="failed", scene=scene.name, message=str(error))
            dataset = Dataset(output, suite_name)
    dataset.keep_only([scene.name for scene in suite.scenes])
    return 1 if failed else 0


def recipe_hash(suite_name: str, scene: SceneRecipe, suite: Suite, family: Family) -> str:
    """Return the hash of all that decides a scene's content: its recipe and its generators."""
    content = {
        "format": FORMAT,
        "suite": suite_name,
        "scene": scene.model_dump(),
        "film": suite.film.model_dump(),
        "family": family.model_dump(exclude={"summary"}),
        "generators": generators(),
    }
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def generators() -> dict[str, str]:
    """Return the versions of what makes a scene: renderer, NumPy, this package's sources."""
    sources = hashlib.sha256()
    for path in sorted(Path(__file__).parent.rglob("*.py")):
        sources.update(path.read_bytes())
    return {
        "cornerscenes": sources.hexdigest(),
        "mitsuba": importlib.metadata.version("mitsuba"),
        "numpy": importlib.metadata.version("numpy"),
    }


def _render_one(
    dataset: Dataset,
    suite_name: str,
    recipe: SceneRecipe,
    suite: Suite,
    family: Family,
    wanted: str,
    variant: str | None,
) -> None:
    # Imported here, in the worker: when nothing is missing, the renderer is never loaded.
    from cornerscenes import mitsuba_backend, scene_files
    from cornerscenes.layout import lay_out

    started = time.monotonic()
    chosen = mitsuba_backend.choose_variant(variant)
    if chosen.startswith("scalar"):
        _tell(event="slow", message=HOW_TO_BE_FAST)
    _tell(event="rendering", scene=recipe.name, variant=chosen)
    scene = lay_out(suite_name, recipe, family)
    key = f"{suite_name}/{recipe.name}"
    renderer = {
        "name": "mitsuba",
        "version": importlib.metadata.version("mitsuba"),
        "variant": chosen,
    }
    dataset.add(
        recipe.name,
        wanted,
        renderer,
        lambda folder: scene_files.write(folder, scene, suite.film, recipe, key),
    )
    _tell(
        event="done",
        scene=recipe.name,
        visible_fraction=scene.visible_fraction,
        seconds=round(time.monotonic() - started, 3),
    )


def _tell(**event: Any) -> None:
    print(json.dumps(event), flush=True)


if __name__ == "__main__":
    sys.exit(main())
