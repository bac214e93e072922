"""The head of a dog, and short ways to write the pieces of a body.

The middle of the skull is the origin of the frame of the head; the muzzle points along x.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from .blob import Blob, Cone, Ellipsoid


def rotation(yaw: float, pitch: float, roll: float) -> Float[np.ndarray, "3 3"]:
    """Turn a head.

    Parameters
    ----------
    yaw, pitch, roll : float
        Angles to the left, nose down and onto the right ear [radians].

    Returns
    -------
    Float[np.ndarray, "3 3"]
        Rotation matrix acting on column vectors.
    """
    cy, sy, cp, sp, cr, sr = (f(a) for a in (yaw, pitch, roll) for f in (np.cos, np.sin))
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    return about_z @ about_y @ about_x


def cone(
    start: Sequence[float], end: Sequence[float], radii: tuple[float, float], blend: float = 0.03
) -> Cone:
    """Shorten the writing of a cone.

    Parameters
    ----------
    start, end : sequence of 3 floats
        Centres of the end spheres.
    radii : tuple of 2 floats
        Their radii.
    blend : float
        Over which distance it melts into the pieces before.

    Returns
    -------
    Cone
        The cone.
    """
    return Cone(np.asarray(start, float), np.asarray(end, float), *radii, blend)


def egg(
    centre: Sequence[float], half: Sequence[float], blend: float = 0.03, pitch: float = 0.0
) -> Ellipsoid:
    """Shorten the writing of an ellipsoid.

    Parameters
    ----------
    centre, half : sequence of 3 floats
        Its middle and its half axes.
    blend : float
        Over which distance it melts into the pieces before.
    pitch : float
        By how much its front is turned down [radians].

    Returns
    -------
    Ellipsoid
        The ellipsoid.
    """
    return Ellipsoid(
        np.asarray(centre, float), np.asarray(half, float), blend, rotation(0.0, pitch, 0.0)
    )


def head(
    at: Float[np.ndarray, " 3"], turn: Float[np.ndarray, "3 3"]
) -> tuple[list[Blob], list[Blob]]:
    """Make a head.

    Parameters
    ----------
    at : Float[np.ndarray, " 3"]
        Middle of the skull, in the frame of the dog.
    turn : Float[np.ndarray, "3 3"]
        Rotation from the frame of the head to the frame of the dog.

    Returns
    -------
    tuple of list of Blob
        The head, and where its coat is light, in the frame of the dog.
    """
    flesh: list[Blob] = [
        egg((0.0, 0.0, 0.002), (0.078, 0.061, 0.058), 0.04),
        cone((0.035, 0.0, -0.022), (0.122, 0.0, -0.026), (0.047, 0.0335), 0.03),
        cone((0.015, 0.0, -0.048), (0.098, 0.0, -0.060), (0.036, 0.021), 0.02),
    ]
    for side in (-1, 1):
        flesh += [
            egg((0.105, 0.017 * side, -0.043), (0.042, 0.021, 0.024), 0.016),
            egg((0.052, 0.029 * side, 0.028), (0.022, 0.018, 0.016), 0.02),
            egg((0.012, 0.040 * side, -0.026), (0.045, 0.028, 0.035), 0.03),
        ]
    light: list[Blob] = [
        egg((0.135, 0.0, -0.035), (0.065, 0.08, 0.052), 0.02),
        cone((0.10, 0.0, 0.02), (0.0, 0.0, 0.072), (0.026, 0.013), 0.02),
        cone((0.03, 0.0, -0.09), (0.12, 0.0, -0.07), (0.035, 0.03), 0.02),
    ]
    return _placed(flesh, at, turn), _placed(light, at, turn)


def _placed(
    blobs: list[Blob], at: Float[np.ndarray, " 3"], turn: Float[np.ndarray, "3 3"]
) -> list[Blob]:
    """Move pieces from the frame of the head to the frame of the dog."""
    result: list[Blob] = []
    for b in blobs:
        if isinstance(b, Cone):
            result.append(
                Cone(at + turn @ b.start, at + turn @ b.end, b.start_radius, b.end_radius, b.blend)
            )
        else:
            result.append(Ellipsoid(at + turn @ b.centre, b.half, b.blend, turn @ b.turn))
    return result
