"""How much time the foveated film saves: `python -m studies.foveation`.

Each scene's film is rendered twice, by the same renderer in the same run: foveated, as the suite
says, and uniform, with the box's samples all over the frame. The time of a film goes with its
samples and their number with one over the variance of the render. So the uniform film, at the
foveated one's noise at the corners, would take

    its time * mean of its corners' squared noise floors / the same mean of the foveated film.

Time is that of the processor [core s], so that other programs do not count.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from statistics import fmean, median

import numpy as np

from cornerscenes import mitsuba_backend
from cornerscenes.film import FilmRenderer, binned, floor_px, passes_of
from cornerscenes.layout import lay_out
from cornerscenes.library import Library
from cornerscenes.mitsuba_backend import World
from cornerscenes.recipes import Family, FilmRecipe, Suite
from cornerscenes.scene import Scene
from cornerscenes.tables import read
from cornerscenes.truth import seen_corners, truth

RECIPES = Path(__file__).parents[2] / "scenes"

# What the foveated film must save at least, as a factor: median over the suite.
WANTED = 6.0


def main() -> int:
    """Render every scene of a suite both ways; return 0 if enough time is saved."""
    parser = argparse.ArgumentParser(prog="studies.foveation", description=__doc__)
    parser.add_argument("--suite", default="quick", help="a suite")
    arguments = parser.parse_args()
    mitsuba_backend.choose_variant()
    suite = read(Suite, RECIPES / "suites" / f"{arguments.suite}.toml")
    library = Library.of(RECIPES)
    uniform_recipe = suite.film.model_copy(
        update={"margin_px": 512, "corner_samples": suite.film.fovea_samples}
    )
    factors = []
    print("scene                 foveated: core s, floor px   uniform: core s, floor px   saves")
    for scene_recipe in suite.all_scenes(arguments.suite):
        family = read(Family, RECIPES / "families" / f"{scene_recipe.family}.toml")
        scene = lay_out(arguments.suite, scene_recipe, family, library)
        key = f"{arguments.suite}/{scene_recipe.name}"
        foveated_s, foveated_px = _time_and_floor(scene, suite.film, key)
        uniform_s, uniform_px = _time_and_floor(scene, uniform_recipe, key)
        factor = uniform_s / foveated_s * (uniform_px / foveated_px) ** 2
        factors.append(factor)
        print(
            f"{scene_recipe.name:20}  {foveated_s:16.1f} {foveated_px:10.4f}"
            f"   {uniform_s:15.1f} {uniform_px:10.4f}   {factor:5.1f}",
            flush=True,
        )
    print(f"median {median(factors):.1f}, {min(factors):.1f} to {max(factors):.1f}")
    return 0 if median(factors) >= WANTED else 1


def _time_and_floor(scene: Scene, recipe: FilmRecipe, key: str) -> tuple[float, float]:
    """Return the time of a film [core s] and the root mean square floor of its corners [px]."""
    world = World.of(scene, recipe.max_depth)
    corners = seen_corners(truth(scene, world))
    # One pixel first: this compiles the renderer's code, which is kept.
    view = world.seen_by(scene.camera, scene.world_from_camera, scene.lens)
    paths, _ = passes_of(recipe.fovea_samples * recipe.oversampling**2)
    next(view.passes(np.zeros((1, 2), dtype=int), 1, recipe.oversampling, paths, 1, key))
    began_s = time.process_time()
    film = FilmRenderer(scene, world, recipe, key).film(corners)
    took_s = time.process_time() - began_s
    pixels = binned(film.radiance, recipe.oversampling)
    floors = [floor_px(corner, pixels, film.variance) for corner in corners]
    return took_s, fmean(floor**2 for floor in floors if floor is not None) ** 0.5


if __name__ == "__main__":
    sys.exit(main())
