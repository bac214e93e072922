"""Things made of wood: a crate and a stool."""

from __future__ import annotations

import numpy as np

from ..shape import Material, Part, Rgb
from .grid import box
from .mesh import Mesh, creased, finished, merged, part
from .sweep import lathe, rounded, tube

WOODS: tuple[Rgb, ...] = (
    (0.44, 0.31, 0.18),
    (0.56, 0.42, 0.26),
    (0.35, 0.235, 0.135),
    (0.50, 0.385, 0.25),
)


def crate(generator: np.random.Generator, height_m: float) -> tuple[Part, ...]:
    """Make an open crate of wooden slats.

    Parameters
    ----------
    generator : np.random.Generator
        Chooses the tone of each slat and small errors of its place.
    height_m : float
        Its height [m].

    Returns
    -------
    tuple of Part
        The crate, one part for each tone of wood.
    """
    long, deep, high, board, post = 0.42, 0.30, 0.27, 0.012, 0.032
    slat = 0.074
    gap = (high - 3 * slat) / 2 - 0.002
    pieces: list[tuple[tuple[float, float, float], tuple[float, float, float]]] = []
    for x in (-1, 1):
        for y in (-1, 1):
            place = (x * (long / 2 - board - post / 2), y * (deep / 2 - board - post / 2))
            pieces.append(((post, post, high - 0.012), (*place, high / 2)))
    for row in range(3):
        z = slat / 2 + row * (slat + gap)
        for sign in (-1, 1):
            pieces.append(((long, board, slat), (0, sign * (deep - board) / 2, z)))
            pieces.append(
                ((board, deep - 2 * board - 0.001, slat), (sign * (long - board) / 2, 0, z))
            )
    for k in range(4):
        y = (k - 1.5) * (deep - 2 * board) / 4
        pieces.append(((long - 2 * board - 0.001, 0.058, 0.01), (0, y, 0.011)))
    groups: list[list[Mesh]] = [[] for _ in WOODS]
    for size, place in pieces:
        error = generator.normal(0, 0.0008, 3) * [1, 1, 0.6]
        plank = box(size, 0.0018).moved(np.asarray(place) + error)
        groups[int(generator.integers(len(WOODS)))].append(plank)
    parts = []
    for number, group in enumerate(groups):
        if group:
            mesh = merged(group)
            wood = Material(WOODS[number], roughness=0.6)
            parts.append(part(f"planks {number + 1}", mesh, wood, smooth=False))
    return finished(parts, height_m)


def stool(generator: np.random.Generator, height_m: float) -> tuple[Part, ...]:
    """Make a wooden stool with a round seat and splayed legs.

    Parameters
    ----------
    generator : np.random.Generator
        Chooses the number of legs, proportions and wood.
    height_m : float
        Height of the seat [m].

    Returns
    -------
    tuple of Part
        The stool.
    """
    count = int(generator.integers(3, 5))
    radius = generator.uniform(0.15, 0.18)
    dish = [(0, 0.415), (radius - 0.01, 0.415), (radius, 0.432), (radius - 0.006, 0.450),
            (0.6 * radius, 0.446), (0, 0.444)]  # fmt: skip
    seat = creased(lathe(rounded(dish, 0.008), 64))
    start = generator.uniform(0, 2 * np.pi)
    legs, rungs, knots = [], [], []
    for k in range(count):
        angle = start + 2 * np.pi * k / count
        out = np.array([np.cos(angle), np.sin(angle), 0.0])
        top, foot = out * 0.68 * radius + [0, 0, 0.425], out * 1.12 * radius
        t = np.linspace(0, 1, 14)[:, None]
        leg = top + (foot - top) * t
        thick = 0.0165 - 0.006 * np.abs(t[:, 0] - 0.45) - 0.002 * t[:, 0]
        legs.append(tube(leg, thick, 16))
        knots.append(top + (foot - top) * (0.58 + 0.07 * (k % 2)))
    for k in range(count):
        rungs.append(tube(np.linspace(knots[k], knots[(k + 1) % count], 6), 0.009, 12))
    wood, other = generator.permutation(len(WOODS))[:2]
    parts = [
        part("seat", seat, Material(WOODS[wood], roughness=0.3)),
        part("legs", creased(merged(legs), 60), Material(WOODS[other], roughness=0.3)),
        part("rungs", creased(merged(rungs), 60), Material(WOODS[other], roughness=0.3)),
    ]
    return finished(parts, height_m)
