"""Dogs with floppy ears and short hair, sitting or standing, in one of a few coats."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..shape import Material, Part, Rgb
from .blob import evaluate
from .dog_pose import Pose, sitting, standing
from .implicit import meshed, onto_surface, slope
from .mesh import Mesh, finished, merged, part, split_by_field
from .sweep import lathe, smooth_curve, tube

# Edge of the meshing grid, in the unit of the poses.
CELL = 0.0095


@dataclass(frozen=True)
class Coat:
    """Colours of a coat, linear Rec. 709.

    Attributes
    ----------
    base, light, dark, ear : Rgb
        Flanks and head; belly, feet and muzzle; back; ears.
    """

    base: Rgb
    light: Rgb
    dark: Rgb
    ear: Rgb


COATS = (
    Coat((0.37, 0.235, 0.125), (0.70, 0.67, 0.61), (0.035, 0.031, 0.028), (0.26, 0.165, 0.09)),
    Coat((0.58, 0.43, 0.26), (0.68, 0.56, 0.40), (0.50, 0.355, 0.20), (0.43, 0.295, 0.16)),
    Coat((0.125, 0.083, 0.054), (0.70, 0.67, 0.61), (0.105, 0.07, 0.046), (0.085, 0.056, 0.037)),
)
COLLARS: tuple[Rgb, ...] = ((0.03, 0.12, 0.42), (0.03, 0.22, 0.20), (0.05, 0.05, 0.06))


def _ball(
    centre: Float[np.ndarray, " 3"],
    half: tuple[float, float, float],
    turn: Float[np.ndarray, "3 3"],
) -> Mesh:
    """Make a turned ellipsoid."""
    latitude = np.linspace(-np.pi / 2, np.pi / 2, 13)
    line = np.stack([np.cos(latitude), np.sin(latitude)], axis=1)
    line[[0, -1], 0] = 0.0
    ball = lathe(line, 20)
    return Mesh(ball.vertices * np.asarray(half), ball.triangles).moved(centre, turn)


def _ears(pose: Pose, generator: np.random.Generator) -> Mesh:
    """Hang two floppy ears, thick sheets folded over at the root, from the head."""
    ears = []
    for side in (-1, 1):
        out, forward = generator.uniform(-0.002, 0.010), generator.uniform(-0.008, 0.008)
        path = smooth_curve(
            [
                (-0.014, 0.034 * side, 0.036),
                (-0.012, 0.052 * side, 0.038),
                (-0.004 + forward, 0.069 * side, 0.018),
                (0.004 + forward, (0.073 + out * 0.6) * side, -0.025),
                (0.010 + forward, (0.073 + out) * side, -0.068),
                (0.014 + forward, (0.072 + out) * side, -0.094),
            ],
            28,
        )
        wide = smooth_curve([(0.022,), (0.030,), (0.037,), (0.043,), (0.036,), (0.004,)], 28)
        # The outline of the tip is round: the last stretch narrows as the root of the rest.
        thick = smooth_curve([(0.010,), (0.010,), (0.008,), (0.007,), (0.006,), (0.003,)], 28)
        ears.append(
            tube(
                path,
                np.concatenate([np.maximum(wide, 0.003), thick], axis=1),
                20,
                up=(1.0, 0.0, 0.12),
            )
        )
    return merged(ears).moved(pose.head, pose.turn)


def _collar(pose: Pose) -> tuple[Mesh, Mesh]:
    """Lay a collar around the neck, and hang a tag from it."""
    middle, along = pose.collar
    across = np.array([0.0, 1.0, 0.0])
    up = np.cross(along, across)
    angle = np.linspace(0, 2 * np.pi, 56, endpoint=False)[:, None]
    spokes = np.cos(angle) * across + np.sin(angle) * up
    near, far = np.zeros(len(spokes)), np.full(len(spokes), 0.2)
    for _ in range(14):
        half = (near + far) / 2
        outside = evaluate(pose.body, middle + half[:, None] * spokes) > 0
        near, far = np.where(outside, near, half), np.where(outside, half, far)
    # A strap does not follow hollows: even the radius out.
    reach = np.mean([np.roll(far, k) for k in range(-3, 4)], axis=0)
    ring = middle + np.maximum(reach, far)[:, None] * spokes
    strap = tube(ring, np.tile([0.0125, 0.0045], (len(ring), 1)), 10, up=tuple(along), closed=True)
    low = ring[np.argmin(ring[:, 2] - 0.6 * ring[:, 0])]
    out = (low - middle) / np.linalg.norm(low - middle)
    disc = lathe([(0, -0.0015), (0.0125, -0.0015), (0.014, 0), (0.0125, 0.0015), (0, 0.0015)], 24)
    down = np.cross(across, out)
    tag = disc.moved(
        low + 0.005 * out - 0.022 * down * np.sign(down[2]), np.stack([down, across, out], axis=1)
    )
    return strap, tag


def _mouth(pose: Pose) -> Mesh:
    """Draw the line of the lips on the muzzle, and the groove below the nose."""
    lines = []
    for side in (-1, 1):
        guide = smooth_curve(
            [
                (0.150, 0.003 * side, -0.046),
                (0.145, 0.022 * side, -0.056),
                (0.115, 0.036 * side, -0.064),
                (0.075, 0.045 * side, -0.060),
                (0.055, 0.052 * side, -0.052),
            ],
            26,
        )
        lines.append(
            (guide, smooth_curve([(0.0018,), (0.0022,), (0.0022,), (0.0018,), (0.001,)], 26))
        )
    lines.append(
        (smooth_curve([(0.162, 0, -0.018), (0.158, 0, -0.042)], 8), np.full((8, 1), 0.0016))
    )
    tubes = []
    for guide, radii in lines:
        points = onto_surface(pose.body, pose.head + guide @ pose.turn.T, 0.01, 6)
        # Half sunk into the skin, the lines look drawn, not laid on.
        points = points - 0.0006 * slope(pose.body, points, 0.004)[1]
        tubes.append(tube(points, radii[:, 0], 6))
    return merged(tubes)


def _eyes(pose: Pose) -> tuple[Mesh, Mesh]:
    """Set the eyes into the head, and dark lids around them."""
    balls, lids = [], []
    for side in (-1, 1):
        guide = pose.head + pose.turn @ np.array([0.075, 0.034 * side, 0.006])
        centre = onto_surface(pose.body, guide[None], 0.01, 6)
        out = slope(pose.body, centre, 0.008)[1][0]
        out /= np.linalg.norm(out)
        lid = pose.turn @ np.array([0.0, 1.0, 0.0])
        lid = lid - (lid @ out) * out
        lid /= np.linalg.norm(lid)
        frame = np.stack([out, lid, np.cross(out, lid)], axis=1)
        balls.append(_ball(centre[0] - 0.0045 * out, (0.0115, 0.0115, 0.0108), frame))
        lids.append(_ball(centre[0] - 0.0035 * out, (0.0062, 0.0150, 0.0128), frame))
    return merged(balls), merged(lids)


def _dog(pose: Pose, generator: np.random.Generator, height_m: float) -> tuple[Part, ...]:
    """Dress a pose in a coat."""
    coat = COATS[int(generator.integers(len(COATS)))]
    collar = COLLARS[int(generator.integers(len(COLLARS)))]
    skin = meshed(pose.body, CELL)
    # Paws stand flat: what melted through the floor is pressed back onto it.
    skin = Mesh(np.maximum(skin.vertices, [-9.0, -9.0, 0.0]), skin.triangles)
    wave = generator.uniform(0, 2 * np.pi, 6)

    def edge(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        # Patches of a coat have wavy edges.
        x, y, z = points.T
        return 0.005 * (
            np.sin(31 * x + wave[0]) * np.sin(37 * z + wave[1])
            + np.sin(43 * y + 20 * x + wave[2])
            + 0.5 * np.sin(89 * z - 60 * x + wave[3]) * np.sin(81 * y + wave[4])
        )

    light, rest = split_by_field(skin, -evaluate(pose.light, skin.vertices) + edge(skin.vertices))
    dark, base = split_by_field(rest, -evaluate(pose.dark, rest.vertices) + edge(rest.vertices))
    strap, tag = _collar(pose)
    eyes, lids = _eyes(pose)
    nose = _ball(
        pose.head + pose.turn @ np.array([0.151, 0, -0.008]), (0.0155, 0.0195, 0.0135), pose.turn
    )
    black = Material((0.018, 0.017, 0.017), roughness=0.3)
    parts = [
        part("flanks", base, Material(coat.base)),
        part("belly and feet", light, Material(coat.light)),
        part("back", dark, Material(coat.dark)),
        part("ears", _ears(pose, generator), Material(coat.ear)),
        part("nose", nose, black),
        part("eyes", eyes, Material((0.022, 0.016, 0.012), roughness=0.08)),
        part("lids", lids, Material((0.02, 0.018, 0.016))),
        part("lips", _mouth(pose), Material((0.02, 0.018, 0.016))),
        part("collar", strap, Material(collar, roughness=0.35)),
        part("tag", tag, Material((0.55, 0.46, 0.24), roughness=0.25)),
    ]
    return finished(parts, height_m, centre=True)


def standing_dog(generator: np.random.Generator, height_m: float) -> tuple[Part, ...]:
    """Make a dog standing on four legs, looking along x.

    Parameters
    ----------
    generator : np.random.Generator
        Chooses stride, gaze, tail and coat.
    height_m : float
        Overall height, floor to the highest point [m].

    Returns
    -------
    tuple of Part
        The dog.
    """
    return _dog(standing(generator), generator, height_m)


def sitting_dog(generator: np.random.Generator, height_m: float) -> tuple[Part, ...]:
    """Make a dog sitting on its haunches, looking along x.

    Parameters
    ----------
    generator : np.random.Generator
        Chooses gaze, side of the tail and coat.
    height_m : float
        Overall height, floor to the highest point [m].

    Returns
    -------
    tuple of Part
        The dog.
    """
    return _dog(sitting(generator), generator, height_m)
