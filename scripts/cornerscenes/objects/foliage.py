"""Leaves: batches of curved sheets that rise, bend under their weight, fold and wave."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from ..shape import Material, Part, Rgb
from .grid import sheets
from .mesh import Mesh, part

# Successive leaves of a shoot are turned by this angle [radians], the golden angle.
GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))


@dataclass(frozen=True)
class Leaves:
    """How each leaf of a batch grows; all arrays have one entry for each leaf.

    Attributes
    ----------
    base : Float[np.ndarray, "n 3"]
        Where the blade starts.
    azimuth : Float[np.ndarray, " n"]
        Direction of growth around z [radians].
    elevation : Float[np.ndarray, " n"]
        Angle of the start above the horizontal [radians].
    length, width : Float[np.ndarray, " n"]
        Along the midrib, and across at the widest place.
    droop : Float[np.ndarray, " n"]
        By how much the tip points lower than the start [radians].
    turn : Float[np.ndarray, " n"]
        By how much the azimuth changes towards the tip [radians].
    roll, twist : Float[np.ndarray, " n"]
        Rotation about the midrib at the start, and added to it towards the tip [radians].
    fold : Float[np.ndarray, " n"]
        Angle by which each half rises from the midrib [radians].
    wave : Float[np.ndarray, " n"]
        Height of the waves of the edge, as a fraction of the width.
    phase : Float[np.ndarray, " n"]
        Phase of those waves [radians].
    """

    base: Float[np.ndarray, "n 3"]
    azimuth: Float[np.ndarray, " n"]
    elevation: Float[np.ndarray, " n"]
    length: Float[np.ndarray, " n"]
    width: Float[np.ndarray, " n"]
    droop: Float[np.ndarray, " n"]
    turn: Float[np.ndarray, " n"]
    roll: Float[np.ndarray, " n"]
    twist: Float[np.ndarray, " n"]
    fold: Float[np.ndarray, " n"]
    wave: Float[np.ndarray, " n"]
    phase: Float[np.ndarray, " n"]


def blades(
    leaves: Leaves,
    outline: Float[np.ndarray, " rows"],
    across: Sequence[float],
    waves: float = 2.5,
    sag: float = 1.5,
) -> Float[np.ndarray, "n rows columns 3"]:
    """Shape the blades of a batch of leaves.

    Parameters
    ----------
    leaves : Leaves
        The batch.
    outline : Float[np.ndarray, " rows"]
        Width along the midrib as a fraction of the greatest, evenly spaced from base to tip.
    across : sequence of float
        Where the columns lie, from -1 (right edge) to 1 (left edge).
    waves : float
        Number of waves along an edge.
    sag : float
        Exponent of the bending: 1 bends evenly, more bends mostly near the tip.

    Returns
    -------
    Float[np.ndarray, "n rows columns 3"]
        Positions of the nodes; the upper side of the leaf is the front of the sheets.
    """
    rows = len(outline)
    s = np.linspace(0, 1, rows)
    rise = leaves.elevation[:, None] - leaves.droop[:, None] * s**sag
    heading = leaves.azimuth[:, None] + leaves.turn[:, None] * s**1.5
    tangent = np.stack(
        [np.cos(rise) * np.cos(heading), np.cos(rise) * np.sin(heading), np.sin(rise)], axis=-1
    )
    steps = 0.5 * (tangent[:, 1:] + tangent[:, :-1]) * (leaves.length / (rows - 1))[:, None, None]
    midrib = leaves.base[:, None] + np.concatenate(
        [np.zeros((len(steps), 1, 3)), np.cumsum(steps, axis=1)], axis=1
    )
    # Upright blades keep a well-defined side: it depends on the heading alone.
    side = np.stack([-np.sin(heading), np.cos(heading), np.zeros_like(heading)], axis=-1)
    normal = np.cross(tangent, side)
    roll = (leaves.roll[:, None] + leaves.twist[:, None] * s)[..., None]
    side, normal = (
        np.cos(roll) * side + np.sin(roll) * normal,
        np.cos(roll) * normal - np.sin(roll) * side,
    )
    u = np.asarray(across, float)
    half = 0.5 * leaves.width[:, None, None] * outline[:, None] * u
    fold = leaves.fold[:, None, None]
    ripple = np.sin(2 * np.pi * waves * s[:, None] + leaves.phase[:, None, None] + 0.9 * np.sign(u))
    lift = (
        np.abs(half) * np.sin(fold)
        + (leaves.wave * leaves.width)[:, None, None] * outline[:, None] * u**2 * ripple
    )
    return (
        midrib[:, :, None]
        + (half * np.cos(fold))[..., None] * side[:, :, None]
        + lift[..., None] * normal[:, :, None]
    )


def toned_parts(
    name: str,
    points: Float[np.ndarray, "n rows columns 3"],
    tone: Int[np.ndarray, " n"],
    colours: Sequence[Rgb],
    roughness: float | None,
    chosen: Bool[np.ndarray, "n rows_1 columns_1"] | None = None,
) -> list[Part]:
    """Make one part of leaves for each tone of colour.

    Parameters
    ----------
    name : str
        Name of the parts, to which the number of the tone is added.
    points : Float[np.ndarray, "n rows columns 3"]
        Nodes of the leaves.
    tone : Int[np.ndarray, " n"]
        Which colour each leaf has.
    colours : sequence of Rgb
        The tones.
    roughness : float or None
        Of the waxy coat, see `Material`.
    chosen : Bool[np.ndarray, "n rows_1 columns_1"] or None
        The cells that have these colours; `None` for all.

    Returns
    -------
    list of Part
        The parts that are not empty.
    """
    parts = []
    for number, colour in enumerate(colours):
        mine = tone == number
        picked = None if chosen is None else chosen[mine]
        if not mine.any() or (picked is not None and not picked.any()):
            continue
        mesh = sheets(points[mine], picked)
        material = Material(colour, roughness=roughness, two_sided=True)
        parts.append(part(f"{name} {number + 1}", mesh, material))
    return parts


def tones(
    generator: np.random.Generator, colour: Rgb, count: int, spread: float
) -> tuple[Rgb, ...]:
    """Vary a green from darker and bluer to lighter and yellower.

    Parameters
    ----------
    generator : np.random.Generator
        Adds a little chance.
    colour : Rgb
        The middle tone.
    count : int
        Number of tones.
    spread : float
        Relative difference between the middle and the extremes, below 1.

    Returns
    -------
    tuple of Rgb
        The tones, from dark to light.
    """
    result = []
    for place in np.linspace(-1, 1, count):
        light = (1 + spread * place) * generator.uniform(0.93, 1.07)
        warm = 1 + 0.35 * spread * place * generator.uniform(0.7, 1.3)
        red, green, blue = colour
        result.append((float(red * light * warm), float(green * light), float(blue * light / warm)))
    return tuple(result)


def stem(name: str, mesh: Mesh, colour: Rgb) -> Part:
    """Make a part of stems or wood.

    Parameters
    ----------
    name : str
        What they are.
    mesh : Mesh
        Their surface.
    colour : Rgb
        Their colour, linear Rec. 709.

    Returns
    -------
    Part
        The stems, with a slight gloss.
    """
    return part(name, mesh, Material(colour, roughness=0.45))
