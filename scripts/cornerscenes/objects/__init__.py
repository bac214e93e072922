"""Objects made by code: potted plants, dogs and household things, each from a generator.

Every builder is a pure function of its generator and its height: equal seeds give equal arrays.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..shape import Part
from .blade_plant import dracaena, snake_plant
from .dog import sitting_dog, standing_dog
from .plant import broad_leaved_plant, bush
from .red import red_ball, red_cuboid, red_cylinder
from .things import ball, books, cushion
from .vessels import basket, mug, watering_can
from .wooden import crate, stool

Builder = Callable[[np.random.Generator, float], tuple[Part, ...]]

BUILDERS: dict[str, Builder] = {
    "broad_leaved_plant": broad_leaved_plant,
    "snake_plant": snake_plant,
    "bush": bush,
    "dracaena": dracaena,
    "sitting_dog": sitting_dog,
    "standing_dog": standing_dog,
    "ball": ball,
    "watering_can": watering_can,
    "books": books,
    "mug": mug,
    "basket": basket,
    "crate": crate,
    "stool": stool,
    "cushion": cushion,
    "red_ball": red_ball,
    "red_cylinder": red_cylinder,
    "red_cuboid": red_cuboid,
}
