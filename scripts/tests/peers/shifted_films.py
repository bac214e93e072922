"""Films of one scene whose grids are shifted, each rendered afresh several times over.

`python shifted_films.py OUT.f32 PASSES -- X,Y X,Y ...` writes float32 numbers: of every shift [px]
and pass the red, green and blue radiance of the 4 x 4 cells of a window of 40 x 40 pixels about a
corner of a cuboid, row by row.
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

from cornerscenes import mitsuba_backend
from cornerscenes.film import Window
from cornerscenes.mitsuba_backend import World
from tests import scenes

SIDE_PX = 40
SCALE = 4
SAMPLES = 64


def main() -> None:
    """Render and write."""
    output, passes, _, *shifts = sys.argv[1:]
    mitsuba_backend.choose_variant()
    scene = scenes.scene(scenes.slab())
    view = World.of(scene, 3).seen_by(scene.camera, scene.world_from_camera)
    corner = scene.image_of(scene.target.vertices_m()[6:7])[0]
    left, top = (np.floor(corner) - SIDE_PX // 2).astype(int)
    window = Window(int(left), int(top), int(left) + SIDE_PX, int(top) + SIDE_PX)
    films = []
    for number, shift in enumerate(shifts):
        tiles = window.pixels() + np.array([float(value) for value in shift.split(",")])
        images = view.passes(tiles, 1, SCALE, SAMPLES, int(passes), f"shifted/{number}")
        films.append(np.stack([np.moveaxis(window.image_of(i), 2, 0) for i in images]))
    np.stack(films).astype("<f4").tofile(output)


main()
