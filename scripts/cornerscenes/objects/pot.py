"""Pots with saucer and soil: the lower part of a potted plant."""

from __future__ import annotations

import numpy as np

from ..shape import Material, Part, Rgb
from .grid import grid_triangles, without_points
from .mesh import Mesh, creased, part
from .sweep import lathe, rounded

GLAZES: tuple[Rgb, ...] = (
    (0.62, 0.60, 0.55),
    (0.08, 0.14, 0.26),
    (0.30, 0.33, 0.34),
    (0.42, 0.37, 0.29),
    (0.06, 0.065, 0.075),
    (0.20, 0.33, 0.32),
)
SOIL: Rgb = (0.045, 0.033, 0.024)


def soil_disc(generator: np.random.Generator, radius: float, height: float) -> Mesh:
    """Make a bumpy disc of soil.

    Parameters
    ----------
    generator : np.random.Generator
        Chooses the bumps.
    radius, height : float
        Of the disc, and of its level above the floor.

    Returns
    -------
    Mesh
        The open disc, facing up.
    """
    rings, segments = 12, 40
    angle = np.linspace(0, 2 * np.pi, segments, endpoint=False)
    reach = np.linspace(0, 1, rings)[:, None]
    x, y = radius * reach * np.cos(angle), radius * reach * np.sin(angle)
    bump = generator.normal(0, 0.012, (rings, segments)) + 0.04 * (1 - reach**2)
    bump[0] = bump[0, 0]
    bump[-1] = 0.0
    index = np.arange(rings * segments).reshape(rings, segments)
    index[0] = 0
    triangles = grid_triangles(index, wrap=True)[:, ::-1]
    vertices = np.stack([x, y, height + radius * bump], axis=-1).reshape(-1, 3)
    return without_points(Mesh(vertices, triangles))


def pot_with_soil(
    generator: np.random.Generator, radius: float, height: float
) -> tuple[list[Part], float]:
    """Make a glazed pot on a saucer, filled with soil.

    Parameters
    ----------
    generator : np.random.Generator
        Chooses the form and the glaze.
    radius, height : float
        Radius of the rim and height of the pot with its saucer.

    Returns
    -------
    tuple of list of Part and float
        Pot, saucer and soil, and the level of the soil.
    """
    form = int(generator.integers(3))
    foot = generator.uniform(0.66, 0.78) * radius
    wall, low = 0.07 * radius, 0.06 * height
    if form == 0:  # a flower pot with a collar below its rim
        lip, drop = 1.06 * radius, 0.80 * height
        outside = [(foot, low), (0.965 * radius, drop), (lip, drop), (lip, height)]
    elif form == 1:  # a straight-sided modern pot
        foot = generator.uniform(0.84, 0.94) * radius
        outside = [(foot, low), (radius, height)]
    else:  # a rounded pot
        outside = [
            (0.72 * radius, low),
            (0.97 * radius, 0.30 * height),
            (1.06 * radius, 0.60 * height),
            (radius, 0.9 * height),
            (radius, height),
        ]
    inner = outside[-1][0] - 2 * wall if form == 0 else outside[-1][0] - wall
    level = 0.90 * height
    profile = [(0.0, low), *outside, (inner, height), (inner, 0.80 * height), (0.0, 0.80 * height)]
    reach = 0.30 * radius if form == 2 else 0.035 * radius
    line = rounded(profile[:-4], reach, 5)[:-1] if form == 2 else np.empty((0, 2))
    rim = profile[-6:] if form == 2 else profile
    rest = rounded(rim, 0.035 * radius)
    pot = lathe(np.concatenate([line, rest[1:]]) if len(line) else rest, 48)
    dish = rounded(
        [
            (0.0, 0.0),
            (0.92 * radius, 0.0),
            (1.08 * radius, 0.13 * height),
            (1.02 * radius, 0.13 * height),
            (0.88 * radius, low),
            (0.0, low),
        ],
        0.03 * radius,
    )
    glaze = Material(GLAZES[int(generator.integers(len(GLAZES)))], roughness=0.25)
    parts = []
    for name, mesh, material in (
        ("pot", creased(pot), glaze),
        ("saucer", creased(lathe(dish, 48)), glaze),
        ("soil", soil_disc(generator, inner + 0.3 * wall, level), Material(SOIL)),
    ):
        parts.append(part(name, mesh, material))
    return parts, level
