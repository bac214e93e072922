"""Potted plants: one with broad leaves and a leafy bush."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from ..shape import Part
from .foliage import GOLDEN_ANGLE, Leaves, blades, stem, toned_parts, tones
from .mesh import Mesh, finished, merged
from .pot import pot_with_soil
from .sweep import smooth_curve, tube, tubes


def broad_leaved_plant(generator: np.random.Generator, height_m: float) -> tuple[Part, ...]:
    """Make a rubber plant: upright stems with large glossy leaves in a spiral.

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
    parts, soil = pot_with_soil(generator, 0.155, 0.27)
    bases, azimuths, ages, ways = [], [], [], []
    stems: list[Mesh] = []
    lean = generator.uniform(0, 2 * np.pi)
    tops = (0.88, 0.66, 0.54)[: int(generator.integers(2, 4))]
    for number, top in enumerate(tops):
        way = lean + 2 * np.pi * number / len(tops)
        out = np.array([np.cos(way), np.sin(way), 0.0]) * generator.uniform(0.04, 0.08)
        foot = out * 0.45 + [0.0, 0.0, soil - 0.03]
        path = smooth_curve(
            [foot, foot + out * 0.7 + [0, 0, 0.4 * (top - soil)], out * 1.9 + [0, 0, top]], 24
        )
        stems.append(tube(path, np.linspace(0.0125, 0.006, 24), 10))
        count = int(12 * (top - soil) / 0.5) + 2
        place = np.linspace(0.22, 1.0, count)
        bases.append(path[np.round(place * 23).astype(int)])
        turn = generator.uniform(0, 2 * np.pi)
        azimuths.append(turn + GOLDEN_ANGLE * np.arange(count) + generator.normal(0, 0.15, count))
        ages.append(1 - place)
        ways.append(np.full(count, way))
    node, azimuth, age = np.concatenate(bases), np.concatenate(azimuths), np.concatenate(ages)
    # Leaves turn away from the neighbouring stems.
    azimuth += 0.35 * np.sin(np.concatenate(ways) - azimuth)
    n = len(node)
    # Old leaves, low on the stem, hang; the youngest at the top stand upright and are small.
    rise = 1.15 - 1.05 * age**0.7 + generator.normal(0, 0.12, n)
    long = (0.15 + 0.16 * np.minimum(1.0, age / 0.35)) * generator.uniform(0.88, 1.12, n)
    ahead = np.stack(
        [np.cos(rise) * np.cos(azimuth), np.cos(rise) * np.sin(azimuth), np.sin(rise)], axis=1
    )
    petiole = (0.035 + 0.045 * np.minimum(1, age / 0.3))[:, None]
    bent = ahead + np.array([0.0, 0.0, 0.35])
    t = np.linspace(0, 1, 6)[:, None]
    start = node + bent * petiole * 0.9
    stalks = node[:, None] + (bent * petiole * 0.9)[:, None] * t
    stalks += (ahead * petiole * 0.1)[:, None] * t**2
    start = stalks[:, -1]
    leaves = Leaves(
        start,
        azimuth,
        rise,
        long,
        long * generator.uniform(0.50, 0.58, n),
        droop=0.45 + 0.65 * age + generator.normal(0, 0.12, n),
        turn=generator.normal(0, 0.2, n),
        roll=generator.normal(0, 0.18, n),
        twist=generator.normal(0, 0.25, n),
        fold=0.20 + 0.3 * (1 - age) ** 4 + generator.normal(0, 0.05, n),
        wave=np.full(n, 0.022),
        phase=generator.uniform(0, 2 * np.pi, n),
    )
    s = np.linspace(0, 1, 17)
    # An ellipse drawn out to a short point.
    outline = np.sin(np.pi * s**0.82) ** 0.72 * (1 - 0.28 * s**6) + 0.012
    outline[-2] *= 0.62
    across = (-1, -0.82, -0.58, -0.3, -0.032, 0.032, 0.3, 0.58, 0.82, 1)
    points = blades(leaves, outline, across)
    rib = np.zeros((n, 16, 9), bool)
    rib[:, :, 4] = True
    tone = np.clip(np.round(4 * (1 - age) ** 1.5 + generator.normal(0, 0.7, n)), 0, 4).astype(int)
    greens = tones(generator, (0.055, 0.165, 0.045), 5, 0.55)
    parts += toned_parts("leaf", points, tone, greens, 0.22, ~rib)
    parts += toned_parts("midrib", points, np.zeros(n, int), ((0.20, 0.30, 0.09),), 0.3, rib)
    parts.append(stem("stems", merged(stems), (0.16, 0.135, 0.085)))
    parts.append(stem("petioles", tubes(stalks, np.full((n, 6), 0.0042), 6), (0.14, 0.24, 0.06)))
    return finished(parts, height_m)


def bush(generator: np.random.Generator, height_m: float) -> tuple[Part, ...]:
    """Make a small leafy tree: branching stems with many small leaves.

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
    parts, soil = pot_with_soil(generator, 0.15, 0.25)
    boughs, twigs = _branches(generator, soil)
    count = 15
    place = np.linspace(0.18, 1.0, count)
    node = twigs[:, np.round(place * (twigs.shape[1] - 1)).astype(int)]
    ahead = np.gradient(twigs, axis=1)[:, np.round(place * (twigs.shape[1] - 1)).astype(int)]
    heading = np.arctan2(ahead[..., 1], ahead[..., 0])
    # Leaves alternate left and right of their twig; the last continues it.
    side = np.where(np.arange(count) % 2 == 0, 1.0, -1.0)
    side[-1] = 0.0
    azimuth = (heading + side * generator.uniform(0.6, 1.3, heading.shape)).ravel()
    n = azimuth.size
    long = generator.uniform(0.068, 0.104, n) * np.tile(1 - 0.3 * place**3, len(twigs))
    leaves = Leaves(
        node.reshape(-1, 3),
        azimuth,
        generator.normal(0.25, 0.35, n),
        long,
        long * generator.uniform(0.44, 0.54, n),
        droop=generator.uniform(0.5, 1.3, n),
        turn=generator.normal(0, 0.25, n),
        roll=generator.normal(0, 0.4, n),
        twist=generator.normal(0, 0.3, n),
        fold=generator.uniform(0.12, 0.45, n),
        wave=np.full(n, 0.02),
        phase=generator.uniform(0, 2 * np.pi, n),
    )
    # The first row is a short stalk.
    outline = np.array([0.05, 0.10, 0.70, 0.97, 0.98, 0.83, 0.54, 0.03])
    points = blades(leaves, outline, (-1, 0, 1))
    height = leaves.base[:, 2]
    young = (height - height.min()) / np.ptp(height)
    tone = np.clip(np.round(1.2 + 3.0 * young + generator.normal(0, 1.1, n)), 0, 5).astype(int)
    parts += toned_parts(
        "leaf", points, tone, tones(generator, (0.095, 0.235, 0.055), 6, 0.5), 0.35
    )
    parts.append(stem("boughs", boughs, (0.17, 0.135, 0.095)))
    thin = np.tile(np.linspace(0.0032, 0.0014, twigs.shape[1]), (len(twigs), 1))
    parts.append(stem("twigs", tubes(twigs, thin, 4), (0.15, 0.17, 0.07)))
    return finished(parts, height_m)


def _branches(
    generator: np.random.Generator, soil: float
) -> tuple[Mesh, Float[np.ndarray, "n k 3"]]:
    """Grow the wood of a bush: boughs as a mesh, and the paths of its leafy twigs."""
    boughs, twigs = [], []
    stems = int(generator.integers(3, 5))
    turn = generator.uniform(0, 2 * np.pi)
    for number in range(stems):
        way = turn + 2 * np.pi * number / stems + generator.normal(0, 0.2)
        out = np.array([np.cos(way), np.sin(way), 0.0])
        top = generator.uniform(0.72, 0.86)
        path = smooth_curve(
            [
                out * 0.02 + [0, 0, soil - 0.03],
                out * 0.055 + [0, 0, soil + 0.45 * (top - soil)],
                out * generator.uniform(0.10, 0.17) + [0, 0, top],
            ],
            20,
        )
        boughs.append(tube(path, np.linspace(0.011, 0.004, 20), 8))
        shoots = 13
        for k in range(shoots):
            place = 0.16 + 0.84 * k / (shoots - 1)
            start = path[round(place * 19)]
            # Shoots keep away from the middle of the bush, the lower ones are the longest.
            angle = way + 0.75 * np.sin(GOLDEN_ANGLE * k * 3.1 + number) + generator.normal(0, 0.5)
            angle += np.pi * (k % 4 == 3)
            long = (0.235 - 0.075 * place) * generator.uniform(0.8, 1.15)
            rise = generator.uniform(0.15, 0.7) + 0.75 * place**3
            flat = np.array([np.cos(angle), np.sin(angle), 0.0])
            middle = start + long * 0.5 * (np.cos(rise) * flat + [0, 0, np.sin(rise)])
            rise -= generator.uniform(0.4, 0.9)
            end = middle + long * 0.5 * (np.cos(rise) * flat + [0, 0, np.sin(rise)])
            twigs.append(smooth_curve([start, middle, end], 11))
    return merged(boughs), np.array(twigs)
