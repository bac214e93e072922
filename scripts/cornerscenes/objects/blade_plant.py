"""Potted plants with long narrow leaves: a snake plant and a dracaena."""

from __future__ import annotations

import numpy as np

from ..shape import Part
from .foliage import GOLDEN_ANGLE, Leaves, blades, stem, toned_parts, tones
from .mesh import finished, merged
from .pot import pot_with_soil
from .sweep import smooth_curve, tube


def snake_plant(generator: np.random.Generator, height_m: float) -> tuple[Part, ...]:
    """Make a snake plant: stiff upright blades with pale edges and dark bands.

    Parameters
    ----------
    generator : np.random.Generator
        Chooses the form.
    height_m : float
        Overall height [m].

    Returns
    -------
    tuple of Part
        The plant in its pot.
    """
    parts, soil = pot_with_soil(generator, 0.15, 0.24)
    n = int(generator.integers(13, 18))
    order = np.arange(n)
    azimuth = GOLDEN_ANGLE * order + generator.uniform(0, 2 * np.pi)
    out = np.sqrt((order + 0.5) / n)
    radius = 0.085 * out
    base = np.stack(
        [radius * np.cos(azimuth), radius * np.sin(azimuth), np.full(n, soil - 0.02)], axis=1
    )
    long = (0.72 - 0.34 * out**1.5) * generator.uniform(0.82, 1.06, n)
    leaves = Leaves(
        base,
        azimuth + generator.normal(0, 0.5, n),
        np.pi / 2 - 0.06 - 0.24 * out * generator.uniform(0.5, 1.3, n),
        long,
        generator.uniform(0.062, 0.082, n),
        droop=generator.normal(0.08, 0.10, n),
        turn=generator.normal(0, 0.3, n),
        roll=generator.normal(0, 0.25, n),
        twist=generator.normal(0, 0.55, n),
        fold=generator.uniform(0.30, 0.5, n),
        wave=np.full(n, 0.055),
        phase=generator.uniform(0, 2 * np.pi, n),
    )
    rows = 72
    s = np.linspace(0, 1, rows)
    outline = np.minimum(1.0, 0.62 + 0.9 * s) * (1 - s**3.2) ** 0.75 + 0.012
    across = (-1, -0.84, -0.62, -0.36, -0.12, 0.12, 0.36, 0.62, 0.84, 1)
    points = blades(leaves, outline, across, waves=1.7)
    # Dark bands zigzag across the blade: a threshold on noise that changes slowly across.
    u = 0.5 * (np.asarray(across)[1:] + np.asarray(across)[:-1])
    place = 0.5 * (s[1:] + s[:-1])
    shift = generator.uniform(0, 2 * np.pi, (4, n, 1, 1))
    along = place[:, None] * (long / 0.6)[:, None, None]
    pattern = (
        np.sin(62 * along + 1.6 * np.sin(5 * u + shift[0]) + shift[1])
        + 0.8 * np.sin(105 * along + 1.2 * np.sin(7 * u + shift[2]) + shift[3])
        + generator.normal(0, 0.35, (n, rows - 1, len(u)))
    )
    edge = np.zeros((n, rows - 1, len(u)), bool)
    edge[:, :, [0, -1]] = True
    dark = (pattern > 0.1) & ~edge
    tone = generator.integers(0, 3, n)
    for name, colour, chosen in (
        ("blade", (0.115, 0.20, 0.085), ~edge & ~dark),
        ("band", (0.035, 0.085, 0.038), dark),
        ("edge", (0.50, 0.50, 0.16), edge),
    ):
        parts += toned_parts(name, points, tone, tones(generator, colour, 3, 0.18), 0.3, chosen)
    return finished(parts, height_m)


def dracaena(generator: np.random.Generator, height_m: float) -> tuple[Part, ...]:
    """Make a dracaena: bare canes, each with a tuft of long arching blades.

    Parameters
    ----------
    generator : np.random.Generator
        Chooses the form.
    height_m : float
        Overall height [m].

    Returns
    -------
    tuple of Part
        The plant in its pot.
    """
    parts, soil = pot_with_soil(generator, 0.14, 0.22)
    canes, nodes, azimuths, ages = [], [], [], []
    way = generator.uniform(0, 2 * np.pi)
    for number, top in enumerate((0.72, 0.55, 0.40)[: int(generator.integers(2, 4))]):
        angle = way + 2.2 * number + generator.normal(0, 0.2)
        out = np.array([np.cos(angle), np.sin(angle), 0.0])
        foot = out * 0.035 + [0.0, 0.0, soil - 0.03]
        path = smooth_curve(
            [foot, out * 0.045 + [0, 0, 0.5 * (soil + top)], out * 0.075 + [0, 0, top]], 60
        )
        # Scars of fallen leaves ring the cane.
        scars = 1 + 0.07 * (np.sin(np.arange(60) * 1.45) > 0.7)
        canes.append(tube(path, np.linspace(0.0155, 0.0125, 60) * scars, 12))
        count = int(generator.integers(26, 33))
        age = np.linspace(1, 0, count)
        nodes.append(path[np.round(59 - 11 * age).astype(int)])
        azimuths.append(generator.uniform(0, 6) + GOLDEN_ANGLE * np.arange(count))
        ages.append(age)
    node, azimuth, age = np.concatenate(nodes), np.concatenate(azimuths), np.concatenate(ages)
    n = len(node)
    long = (0.20 + 0.16 * np.minimum(1, age / 0.4)) * generator.uniform(0.88, 1.1, n)
    leaves = Leaves(
        node,
        azimuth,
        1.40 - 1.15 * age**0.8 + generator.normal(0, 0.08, n),
        long,
        generator.uniform(0.026, 0.034, n),
        droop=1.0 + 0.85 * age + generator.normal(0, 0.18, n),
        turn=generator.normal(0, 0.2, n),
        roll=generator.normal(0, 0.12, n),
        twist=generator.normal(0, 0.35, n),
        fold=generator.uniform(0.25, 0.45, n),
        wave=np.full(n, 0.03),
        phase=generator.uniform(0, 2 * np.pi, n),
    )
    s = np.linspace(0, 1, 20)
    outline = np.minimum(1.0, 0.55 + 1.6 * s) * (1 - s**2.4) ** 0.85 + 0.015
    points = blades(leaves, outline, (-1, -0.5, -0.14, 0.14, 0.5, 1), sag=1.3)
    stripe = np.zeros((n, 19, 5), bool)
    stripe[:, :, 2] = True
    tone = np.clip(np.round(3.4 * (1 - age) + generator.normal(0, 0.7, n)), 0, 3).astype(int)
    greens = tones(generator, (0.06, 0.175, 0.045), 4, 0.45)
    parts += toned_parts("leaf", points, tone, greens, 0.3, ~stripe)
    parts += toned_parts("stripe", points, np.zeros(n, int), ((0.30, 0.40, 0.11),), 0.3, stripe)
    parts.append(stem("canes", merged(canes), (0.30, 0.235, 0.16)))
    return finished(parts, height_m)
