"""Things that hold something: a mug, a watering can and a woven basket."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from ..shape import Material, Part, Rgb
from .mesh import Mesh, compact, creased, finished, merged, part
from .sweep import lathe, rounded, smooth_curve, tube, tubes

GLAZES: tuple[Rgb, ...] = (
    (0.05, 0.16, 0.40),
    (0.10, 0.32, 0.30),
    (0.50, 0.47, 0.40),
    (0.16, 0.18, 0.20),
)
ENAMELS: tuple[Rgb, ...] = (
    (0.06, 0.27, 0.14),
    (0.08, 0.22, 0.42),
    (0.45, 0.47, 0.46),
    (0.52, 0.42, 0.07),
)


def mug(generator: np.random.Generator, height_m: float) -> tuple[Part, ...]:
    """Make a two-coloured mug with a handle.

    Parameters
    ----------
    generator : np.random.Generator
        Chooses glaze, girth and which way the handle points.
    height_m : float
        Height of the rim [m].

    Returns
    -------
    tuple of Part
        The mug; its glaze changes colour at the rim.
    """
    girth = generator.uniform(0.038, 0.046)
    foot = girth * generator.uniform(0.84, 1.0)
    wall = 0.0038
    outside = rounded(
        [(0, 0.0015), (foot - 0.006, 0.0015), (foot - 0.004, 0), (foot, 0), (girth, 0.095)], 0.004
    )
    lip = rounded(
        [(girth, 0.095), (girth - 0.0004, 0.0967), (girth - wall, 0.0967), (girth - wall, 0.095)],
        0.0015,
    )
    inside = rounded([(girth - wall, 0.095), (foot - wall, 0.006), (0, 0.006)], 0.010, 6)
    body = creased(lathe(np.concatenate([outside, lip[1:-1], inside]), 80))
    centres = body.vertices[body.triangles].mean(axis=1)
    radius = np.hypot(centres[:, 0], centres[:, 1])
    level = centres[:, 2]
    bowl = radius < foot - wall + (girth - foot) * level / 0.095 + 0.4 * wall
    pale = (bowl & (level > 0.003)) | (level > 0.0945)
    way = generator.uniform(0, 2 * np.pi)
    reach = girth * 0.965
    path = smooth_curve(
        [
            (reach, 0, 0.078),
            (reach + 0.016, 0, 0.0805),
            (reach + 0.0285, 0, 0.066),
            (reach + 0.027, 0, 0.044),
            (reach + 0.014, 0, 0.026),
            (reach * 0.97 - 0.001, 0, 0.020),
        ],
        40,
    )
    handle = tube(path, np.tile([0.0034, 0.0062], (40, 1)), 18).moved(turn=_about_z(way))
    glaze = Material(GLAZES[int(generator.integers(len(GLAZES)))], roughness=0.12)
    cream = Material((0.72, 0.70, 0.64), roughness=0.12)
    parts = [
        part("outside", compact(Mesh(body.vertices, body.triangles[~pale])), glaze),
        part("inside", compact(Mesh(body.vertices, body.triangles[pale])), cream),
        part("handle", creased(handle, 60), glaze),
    ]
    return finished(parts, height_m)


def watering_can(generator: np.random.Generator, height_m: float) -> tuple[Part, ...]:
    """Make a watering can with a long spout, a rose and an arched handle.

    Parameters
    ----------
    generator : np.random.Generator
        Chooses colour and direction.
    height_m : float
        Height of the handle [m].

    Returns
    -------
    tuple of Part
        The can.
    """
    profile = [
        (0, 0.004), (0.106, 0.004), (0.109, 0), (0.116, 0), (0.117, 0.010), (0.113, 0.014),
        (0.106, 0.160), (0.109, 0.164), (0.105, 0.169), (0.064, 0.196), (0.060, 0.222),
        (0.065, 0.226), (0.060, 0.228), (0.056, 0.220), (0.060, 0.193), (0.102, 0.160),
        (0.108, 0.010), (0, 0.010),
    ]  # fmt: skip
    body = creased(lathe(rounded(profile, 0.004, 3), 64), 50)
    spine = smooth_curve(
        [(0.095, 0, 0.045), (0.165, 0, 0.092), (0.235, 0, 0.165), (0.300, 0, 0.240)], 30
    )
    spout = tube(spine, np.linspace(0.027, 0.0125, 30), 24)
    along = spine[-1] - spine[-3]
    along = along / np.linalg.norm(along)
    side = np.array([0.0, 1.0, 0.0])
    frame = np.stack([np.cross(side, along), side, along], axis=1)
    rose = creased(
        lathe(
            rounded(
                [(0, -0.012), (0.015, -0.012), (0.016, 0.0), (0.036, 0.034), (0.038, 0.040),
                 (0.034, 0.043), (0.018, 0.0475), (0, 0.049)],
                0.003,
            ),
            40,
        )
    )  # fmt: skip
    holes = []
    for ring, count in ((0.0, 1), (0.011, 6), (0.022, 12)):
        for angle in 2 * np.pi * np.arange(count) / count:
            height = 0.0482 - 0.0042 * (ring / 0.03) ** 2
            disc = lathe([(0, -0.002), (0.0017, -0.002), (0.0017, 0.0012), (0, 0.0012)], 10)
            holes.append(disc.moved((ring * np.cos(angle), ring * np.sin(angle), height)))
    arch = smooth_curve(
        [(-0.108, 0, 0.055), (-0.150, 0, 0.075), (-0.192, 0, 0.140), (-0.178, 0, 0.235),
         (-0.105, 0, 0.315), (-0.010, 0, 0.325), (0.055, 0, 0.265), (0.082, 0, 0.182)],
        70,
    )  # fmt: skip
    handle = tube(arch, np.tile([0.010, 0.0065], (70, 1)), 16, up=(0, 1, 0))
    brace = tube([(0.075, 0, 0.185), (0.16, 0, 0.172), (0.222, 0, 0.155)], 0.0042, 10)
    turn = _about_z(generator.uniform(0, 2 * np.pi))
    enamel = Material(ENAMELS[int(generator.integers(len(ENAMELS)))], roughness=0.2)
    at = spine[-1]
    parts = [
        part("can", body.moved(turn=turn), enamel),
        part("spout", creased(merged([spout, brace]), 60).moved(turn=turn), enamel),
        part("handle", creased(handle, 60).moved(turn=turn), enamel),
        part("rose", rose.moved(at, frame).moved(turn=turn), Material((0.42, 0.42, 0.41), 0.25)),
        part("holes", creased(merged(holes)).moved(at, frame).moved(turn=turn),
              Material((0.015, 0.015, 0.015))),
    ]  # fmt: skip
    return finished(parts, height_m, centre=True)


def basket(generator: np.random.Generator, height_m: float) -> tuple[Part, ...]:
    """Make a round basket woven of osiers, open at the top.

    Parameters
    ----------
    generator : np.random.Generator
        Chooses taper and colours.
    height_m : float
        Height of the grips [m].

    Returns
    -------
    tuple of Part
        The basket.
    """
    rows, stakes, segments = 15, 24, 96
    wide = generator.uniform(0.19, 0.22)
    taper = generator.uniform(0.80, 0.92)
    rise = 0.0165

    def girth(level: Float[np.ndarray, " *shape"]) -> Float[np.ndarray, " *shape"]:
        # The wall is a little rounded near the floor.
        part = level / (rows * rise)
        return wide * (taper + (1 - taper) * part - 0.10 * np.exp(-part / 0.07))

    angle = np.linspace(0, 2 * np.pi, segments, endpoint=False)
    row = np.arange(rows)[:, None]
    level = rise * (row + 0.6) + 0.0008 * np.sin(3 * angle + generator.uniform(0, 6, (rows, 1)))
    # Each osier passes before one stake and behind the next, the next row the other way about.
    reach = girth(level) + 0.0058 * np.cos(stakes / 2 * angle + np.pi * row)
    paths = np.stack([reach * np.cos(angle), reach * np.sin(angle), level], axis=-1)
    section = np.tile([0.0086, 0.0042], (1, segments, 1))
    tone = generator.integers(0, 3, rows)
    straw: tuple[Rgb, ...] = ((0.46, 0.34, 0.20), (0.40, 0.285, 0.16), (0.52, 0.40, 0.25))
    parts = []
    for number, colour in enumerate(straw):
        mine = paths[tone == number]
        if len(mine):
            woven = tubes(mine, np.repeat(section, len(mine), 0), 6, up=(0, 0, 1), closed=True)
            parts.append(part(f"osiers {number + 1}", woven, Material(colour, roughness=0.5)))
    z = np.linspace(0.004, rows * rise, 12)
    around = 2 * np.pi * np.arange(stakes)[:, None] / stakes
    radius = girth(z)
    posts = np.stack(
        [radius * np.cos(around), radius * np.sin(around), np.broadcast_to(z, (stakes, 12))],
        axis=-1,
    )
    upright = tubes(posts, np.full((stakes, 12), 0.0042), 6)
    top = rows * rise + 0.002
    turns = np.linspace(0, 2 * np.pi, 192, endpoint=False)
    rope = []
    for start in (0.0, np.pi):
        wind = 30 * turns + start
        out = wide + 0.006 * np.cos(wind)
        rope.append(
            np.stack([out * np.cos(turns), out * np.sin(turns), top + 0.006 * np.sin(wind)], axis=1)
        )
    rim = tubes(np.array(rope), np.full((2, 192), 0.0078), 7, up=(0, 0, 1), closed=True)
    grips = []
    swing = np.linspace(0, np.pi, 24)
    for way in (0.0, np.pi):
        arc = np.stack(
            [np.full(24, wide) - 0.005 * np.sin(swing), 0.062 * np.cos(swing),
             top - 0.004 + 0.06 * np.sin(swing) ** 0.8], axis=1,
        )  # fmt: skip
        grips.append(tube(arc, 0.0085, 10).moved(turn=_about_z(way)))
    low = float(girth(np.array(rise * 0.6)))
    floor = lathe([(0, 0.001), (low, 0.001), (low, 0.010), (0, 0.010)], 48)
    wood = Material((0.36, 0.255, 0.145), roughness=0.5)
    parts += [
        part("stakes", upright, wood),
        part("rim", rim, Material(straw[0], roughness=0.5)),
        part("grips", merged(grips), wood),
        part("floor", creased(floor), wood),
    ]
    return finished(parts, height_m)


def _about_z(angle: float) -> Float[np.ndarray, "3 3"]:
    """Rotate about the vertical."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
