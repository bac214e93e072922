"""Red things that are not the target: a ball, a cylinder and a second cuboid."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..shape import Material, Part
from .mesh import Mesh, creased, finished, part
from .sweep import lathe


def red_ball(generator: np.random.Generator, height_m: float) -> tuple[Part, ...]:
    """Make a plain red ball of a diameter of `height_m`; the generator chooses its tone."""
    latitude = np.linspace(-np.pi / 2, np.pi / 2, 65)
    line = np.stack([np.cos(latitude), np.sin(latitude)], axis=1)
    line[[0, -1], 0] = 0.0
    return finished([part("ball", lathe(line, 128), _paint(generator))], height_m)


def red_cylinder(generator: np.random.Generator, height_m: float) -> tuple[Part, ...]:
    """Make an upright red cylinder; the generator chooses tone and slenderness."""
    radius = generator.uniform(0.25, 0.45)
    line = [[0.0, 0.0], [radius, 0.0], [radius, 1.0], [0.0, 1.0]]
    return finished([part("cylinder", creased(lathe(line, 128)), _paint(generator))], height_m)


def red_cuboid(generator: np.random.Generator, height_m: float) -> tuple[Part, ...]:
    """Make a second red cuboid; the generator chooses tone and proportions."""
    bits = np.array([[index >> axis & 1 for axis in range(3)] for index in range(8)])
    size = np.array([*generator.uniform(0.5, 1.1, 2), 1.0])
    quads = ((0, 4, 6, 2), (1, 3, 7, 5), (0, 1, 5, 4), (2, 6, 7, 3), (0, 2, 3, 1), (4, 5, 7, 6))
    triangles = [[q[i], q[j], q[k]] for q in quads for i, j, k in ((0, 1, 2), (0, 2, 3))]
    mesh = Mesh((bits - [0.5, 0.5, 0.0]) * size, np.array(triangles))
    (whole,) = finished([part("cuboid", mesh, _paint(generator), smooth=False)], height_m)
    return (replace(whole, corners_m=whole.vertices),)


def _paint(generator: np.random.Generator) -> Material:
    red, other = generator.uniform(0.45, 0.75), generator.uniform(0.02, 0.05)
    return Material((red, other, other), roughness=0.25)
