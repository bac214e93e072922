"""The soft body of a dog in two poses, as pieces to melt together.

Lengths are in units in which a standing dog is about 0.5 high at the shoulder. The dog looks
along x, its left is y, up is z.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from .blob import Blob, Cone
from .dog_head import cone, egg, head, rotation


@dataclass(frozen=True)
class Pose:
    """A dog without its coat.

    Attributes
    ----------
    body : tuple of Blob
        Everything but ears, eyes and nose.
    light, dark : tuple of Blob
        Where the coat is light (belly, feet, muzzle) and where it is dark (back).
    head : Float[np.ndarray, " 3"]
        Middle of the skull.
    turn : Float[np.ndarray, "3 3"]
        Rotation from the frame of the head to the frame of the dog.
    collar : tuple of Float[np.ndarray, " 3"]
        Middle of the collar and the direction of the neck through it (unit vector).
    """

    body: tuple[Blob, ...]
    light: tuple[Blob, ...]
    dark: tuple[Blob, ...]
    head: Float[np.ndarray, " 3"]
    turn: Float[np.ndarray, "3 3"]
    collar: tuple[Float[np.ndarray, " 3"], Float[np.ndarray, " 3"]]


def _paw(x: float, y: float, long: float = 0.043) -> list[Blob]:
    """Put a paw with four toes on the floor."""
    toes = [
        egg(
            (x + long * (0.62 - 0.22 * abs(t) ** 2), y + 0.0135 * t, 0.016),
            (0.019, 0.0095, 0.0155),
            0.006,
        )
        for t in (-1.5, -0.5, 0.5, 1.5)
    ]
    return [egg((x, y, 0.021), (long, 0.028, 0.024), 0.018), *toes]


def _chain(
    points: Float[np.ndarray, "n 3"], radii: Float[np.ndarray, " n"], blend: float
) -> list[Blob]:
    """Thread rounded cones on a path."""
    return [
        Cone(points[k], points[k + 1], float(radii[k]), float(radii[k + 1]), blend)
        for k in range(len(points) - 1)
    ]


def standing(generator: np.random.Generator) -> Pose:
    """Put a dog on its four feet.

    Parameters
    ----------
    generator : np.random.Generator
        Chooses the stride, where the head looks and how the tail is held.

    Returns
    -------
    Pose
        The dog.
    """
    body: list[Blob] = [
        egg((0.095, 0, 0.385), (0.165, 0.092, 0.118), 0.05, 0.06),
        cone((0.06, 0, 0.405), (-0.17, 0, 0.425), (0.092, 0.076), 0.06),
        egg((-0.195, 0, 0.415), (0.105, 0.082, 0.085), 0.05, -0.1),
        egg((0.205, 0, 0.375), (0.075, 0.07, 0.085), 0.05),
        cone((0.175, 0, 0.435), (0.285, 0, 0.565), (0.088, 0.060), 0.05),
    ]
    light: list[Blob] = [
        egg((0.24, 0, 0.33), (0.10, 0.065, 0.12), 0.03),
        egg((0.03, 0, 0.27), (0.24, 0.075, 0.055), 0.03),
        cone((0.28, 0, 0.40), (0.335, 0, 0.53), (0.05, 0.035), 0.03),
    ]
    for side in (-1, 1):
        fore, hind = generator.uniform(-0.035, 0.035, 2)
        y = 0.072 * side
        body += [
            cone((0.165, 0.062 * side, 0.42), (0.175, 0.07 * side, 0.345), (0.06, 0.056), 0.04),
            cone((0.175, 0.07 * side, 0.345), (0.125 + fore * 0.3, y, 0.265), (0.055, 0.039)),
            cone((0.125 + fore * 0.3, y, 0.265), (0.145 + fore * 0.9, y, 0.11), (0.037, 0.026)),
            cone((0.145 + fore * 0.9, y, 0.11), (0.155 + fore, y, 0.035), (0.0255, 0.023), 0.02),
            *_paw(0.172 + fore, y),
            egg((-0.19, 0.058 * side, 0.36), (0.085, 0.048, 0.115), 0.04, 0.25),
            cone((-0.175, y, 0.33), (-0.13 + hind * 0.4, 0.08 * side, 0.255), (0.066, 0.046)),
            cone(
                (-0.13 + hind * 0.4, 0.08 * side, 0.255),
                (-0.25 + hind, y, 0.135),
                (0.045, 0.024),
                0.03,
            ),
            cone((-0.25 + hind, y, 0.135), (-0.235 + hind, y, 0.035), (0.0245, 0.022), 0.02),
            *_paw(-0.215 + hind, y),
        ]
        light += [
            cone((0.15 + fore, y, 0.0), (0.14 + fore, y, 0.16), (0.09, 0.06), 0.03),
            cone((-0.22 + hind, y, 0.0), (-0.23 + hind, y, 0.085), (0.09, 0.055), 0.03),
        ]
    swing = generator.uniform(-0.05, 0.05)
    tail = np.array(
        [
            [-0.27, 0, 0.45],
            [-0.325, swing * 0.2, 0.475],
            [-0.365, swing * 0.5, 0.525],
            [-0.388, swing, 0.585],
            [-0.392, swing * 1.3, 0.645],
        ]
    )
    body += _chain(tail, np.array([0.031, 0.025, 0.021, 0.018, 0.011]), 0.022)
    light.append(cone(tail[3] * 0.4 + tail[4] * 0.6, tail[4], (0.026, 0.03), 0.02))
    dark: list[Blob] = [
        egg((-0.035, 0, 0.49), (0.20, 0.15, 0.125), 0.03, 0.05),
        cone(tail[0] + [0, 0, 0.03], tail[2], (0.03, 0.032), 0.03),
    ]
    at = np.array([0.325, 0.0, 0.612])
    turn = rotation(
        generator.uniform(-0.4, 0.4), generator.uniform(0.0, 0.14), generator.uniform(-0.12, 0.12)
    )
    skull, face = head(at, turn)
    along = np.array([0.11, 0.0, 0.13])
    return Pose(
        tuple(body + skull),
        tuple(light + face),
        tuple(dark),
        at,
        turn,
        (np.array([0.247, 0.0, 0.513]), along / np.linalg.norm(along)),
    )


def sitting(generator: np.random.Generator) -> Pose:
    """Make a dog sit.

    Parameters
    ----------
    generator : np.random.Generator
        Chooses where the head looks and to which side the tail lies.

    Returns
    -------
    Pose
        The dog.
    """
    body: list[Blob] = [
        egg((-0.155, 0, 0.125), (0.115, 0.10, 0.115), 0.05),
        cone((-0.13, 0, 0.16), (0.03, 0, 0.355), (0.105, 0.098), 0.06),
        egg((0.04, 0, 0.345), (0.095, 0.093, 0.135), 0.05, -0.35),
        cone((0.035, 0, 0.43), (0.095, 0, 0.575), (0.088, 0.060), 0.05),
    ]
    light: list[Blob] = [
        egg((0.135, 0, 0.33), (0.07, 0.06, 0.15), 0.03),
        egg((0.06, 0, 0.20), (0.07, 0.07, 0.12), 0.03),
        cone((0.14, 0, 0.42), (0.155, 0, 0.54), (0.05, 0.035), 0.03),
    ]
    for side in (-1, 1):
        y = 0.066 * side
        body += [
            cone((0.055, 0.068 * side, 0.40), (0.075, 0.074 * side, 0.32), (0.055, 0.05), 0.04),
            cone((0.07, 0.074 * side, 0.32), (0.055, 0.074 * side, 0.235), (0.05, 0.038)),
            cone((0.055, 0.074 * side, 0.235), (0.095, y, 0.10), (0.037, 0.026)),
            cone((0.095, y, 0.10), (0.11, y, 0.035), (0.0255, 0.023), 0.02),
            *_paw(0.128, y),
            egg((-0.085, 0.098 * side, 0.135), (0.115, 0.046, 0.088), 0.035, -0.35),
            cone((-0.04, 0.115 * side, 0.17), (0.005, 0.122 * side, 0.125), (0.058, 0.045)),
            cone((0.0, 0.122 * side, 0.12), (-0.12, 0.125 * side, 0.035), (0.042, 0.028), 0.03),
            cone((-0.12, 0.125 * side, 0.028), (0.01, 0.14 * side, 0.024), (0.026, 0.023), 0.02),
            *_paw(0.035, 0.143 * side, 0.04),
        ]
        light += [
            cone((0.11, y, 0.0), (0.10, y, 0.15), (0.06, 0.05), 0.03),
            cone((0.13, y, 0.0), (0.17, y, 0.0), (0.06, 0.05), 0.03),
            cone((0.02, 0.16 * side, 0.0), (0.07, 0.15 * side, 0.0), (0.055, 0.055), 0.02),
        ]
    side = 1.0 if generator.random() < 0.5 else -1.0
    tail = np.array(
        [
            [-0.25, 0, 0.07],
            [-0.31, 0.02 * side, 0.035],
            [-0.365, 0.065 * side, 0.023],
            [-0.395, 0.125 * side, 0.019],
            [-0.40, 0.19 * side, 0.014],
        ]
    )
    body += _chain(tail, np.array([0.036, 0.029, 0.023, 0.019, 0.013]), 0.022)
    light.append(cone(tail[3] * 0.4 + tail[4] * 0.6, tail[4], (0.026, 0.03), 0.02))
    dark: list[Blob] = [
        cone((-0.27, 0, 0.24), (-0.065, 0, 0.455), (0.15, 0.125), 0.03),
        cone(tail[0] + [-0.02, 0, 0.03], tail[2], (0.05, 0.035), 0.03),
    ]
    at = np.array([0.133, 0.0, 0.625])
    turn = rotation(
        generator.uniform(-0.45, 0.45),
        generator.uniform(0.02, 0.16),
        generator.uniform(-0.16, 0.16),
    )
    skull, face = head(at, turn)
    along = np.array([0.06, 0.0, 0.145])
    return Pose(
        tuple(body + skull),
        tuple(light + face),
        tuple(dark),
        at,
        turn,
        (np.array([0.075, 0.0, 0.525]), along / np.linalg.norm(along)),
    )
