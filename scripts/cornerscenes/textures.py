"""Procedural textures of floors, walls and targets: reflectance, linear Rec. 709."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float
from scipy import fft
from scipy.ndimage import gaussian_filter

from cornerscenes.shape import Rgb, Texture

# Side of the square that a background's texture shows [m]; it repeats beyond, without a seam.
TILE_M = 3.0
_CELLS = 1536


def planks(generator: np.random.Generator, colour: Rgb) -> Texture:
    """Make boards 12 cm wide: grain along x, a tone per board, dark joints 2 mm wide."""
    board = _rows() // _cells(0.12)
    tone = generator.uniform(0.82, 1.12, board.max() + 1)[board]
    shade = tone[:, None] * (1.0 + 0.06 * _noise(generator, (0.8, 40.0)))
    joint = _cells(0.002)
    shade[_rows() % _cells(0.12) < joint] *= 0.35
    for index in range(board.max() + 1):  # one butt joint per board
        start = int(generator.integers(0, _CELLS - joint))
        shade[board == index, start : start + joint] *= 0.35
    return _tinted(shade, colour)


def plaster(generator: np.random.Generator, colour: Rgb) -> Texture:
    """Make painted plaster: nearly uniform, with faint roller marks."""
    return _tinted(1.0 + 0.012 * _noise(generator, 9.0), colour)


def concrete(generator: np.random.Generator, colour: Rgb) -> Texture:
    """Make cast concrete: clouds, fine grain, a few dark pores."""
    shade = 1.0 + 0.08 * _noise(generator, 60.0) + 0.03 * _noise(generator, 1.2)
    pores = gaussian_filter((generator.random((_CELLS, _CELLS)) < 2e-4).astype(float), 1.0)
    return _tinted(shade * (1.0 - np.clip(3.0 * pores, 0.0, 0.5)), colour)


def tiles(generator: np.random.Generator, colour: Rgb) -> Texture:
    """Make square tiles of 20 cm with pale joints 4 mm wide, each with a tone of its own."""
    size, joint = _cells(0.20), _cells(0.004)
    index = _rows() // size
    tone = generator.uniform(0.93, 1.05, (index.max() + 1, index.max() + 1))
    shade = tone[index[:, None], index[None, :]] * (1.0 + 0.015 * _noise(generator, 6.0))
    in_joint = _rows() % size < joint
    shade[in_joint[:, None] | in_joint[None, :]] = 1.35
    return _tinted(shade, colour)


def carpet(generator: np.random.Generator, colour: Rgb) -> Texture:
    """Make a short pile: fine, lively grain."""
    return _tinted(1.0 + 0.16 * _noise(generator, 0.9) + 0.05 * _noise(generator, 25.0), colour)


def bricks(generator: np.random.Generator, colour: Rgb) -> Texture:
    """Make a running bond of bricks of 25 by 10 cm with pale joints 1 cm wide."""
    long, high, joint = _cells(0.25), _cells(0.10), _cells(0.010)
    course = _rows() // high
    along = _rows()[None, :] + (course[:, None] % 2) * (long // 2)
    brick = along // long
    tone = generator.uniform(0.80, 1.15, (course.max() + 1, brick.max() + 1))
    shade = tone[course[:, None], brick] * (1.0 + 0.05 * _noise(generator, 1.5))
    in_joint = (_rows() % high < joint)[:, None] | (along % long < joint)
    shade[in_joint] = 1.25
    return _tinted(shade, colour)


BACKGROUNDS: dict[str, Callable[[np.random.Generator, Rgb], Texture]] = {
    "planks": planks,
    "plaster": plaster,
    "concrete": concrete,
    "tiles": tiles,
    "carpet": carpet,
    "bricks": bricks,
}


def wood(generator: np.random.Generator, colour: Rgb, extent_m: tuple[float, float]) -> Texture:
    """Make stained wood: grain along the first side, 1 cell per 0.5 mm."""
    shape = _face_shape(extent_m)
    grain = gaussian_filter(generator.standard_normal(shape), (1.2, 60.0), mode="wrap")
    rings = np.sin(2.0 * np.pi * (np.arange(shape[0]) / 22.0)[:, None] + 2.5 * grain / grain.std())
    return _tinted(1.0 + 0.10 * grain / grain.std() + 0.07 * rings, colour)


def scratches(
    generator: np.random.Generator, colour: Rgb, extent_m: tuple[float, float]
) -> Texture:
    """Make paint with some forty bright scratches, 0.5 to 1 mm wide."""
    rows, columns = _face_shape(extent_m)
    y, x = np.mgrid[0:rows, 0:columns]
    bare = np.zeros((rows, columns))
    for _ in range(40):
        middle = generator.random(2) * (columns, rows)
        angle, length = generator.uniform(0.0, np.pi), generator.uniform(8.0, 80.0)
        along = (x - middle[0]) * np.cos(angle) + (y - middle[1]) * np.sin(angle)
        across = -(x - middle[0]) * np.sin(angle) + (y - middle[1]) * np.cos(angle)
        width = generator.uniform(0.5, 1.0)
        bare = np.maximum(bare, (np.abs(along) < 0.5 * length) * np.exp(-((across / width) ** 2)))
    mixed = np.array(colour) * (1.0 - 0.6 * bare[..., None]) + 0.6 * bare[..., None] * 0.55
    return np.clip(mixed, 0.0, 0.95)


def label(
    generator: np.random.Generator, colour: Rgb, extent_m: tuple[float, float]
) -> tuple[Texture, Float[np.ndarray, "4 2"]]:
    """Make a face with a label: a pale rectangle with lines of print and a bar code.

    Returns
    -------
    Texture
        The face.
    Float[np.ndarray, "4 2"]
        The label's corners as shares of the face's first and last side.
    """
    rows, columns = _face_shape(extent_m)
    face = np.tile(np.array(colour), (rows, columns, 1))
    left, right = (round(share * columns) for share in (generator.uniform(0.15, 0.25), 0.8))
    low, high = (round(share * rows) for share in (generator.uniform(0.2, 0.3), 0.75))
    face[low:high, left:right] = (0.72, 0.71, 0.66)
    line = max(2, (high - low) // 9)
    for top in range(low + line, low + (high - low) // 2, 2 * line):
        end = round(left + (right - left) * generator.uniform(0.55, 0.92))
        face[top : top + line, left + line : end] = (0.05, 0.05, 0.06)
    bars = np.repeat(generator.random((right - left - 2 * line) // 2 + 1) < 0.5, 2)
    bars = bars[: right - left - 2 * line]
    code = face[low + (high - low) * 3 // 5 : high - line, left + line : right - line]
    code[:, bars] = (0.04, 0.04, 0.05)
    corners = np.array([[left, low], [right, low], [right, high], [left, high]])
    return face, corners / (columns, rows)


def _face_shape(extent_m: tuple[float, float]) -> tuple[int, int]:
    """Rows and columns of a face's texture, at 0.5 mm a cell."""
    return max(16, round(extent_m[1] / 5e-4)), max(16, round(extent_m[0] / 5e-4))


def _rows() -> np.ndarray:
    return np.arange(_CELLS)


def _cells(length_m: float) -> int:
    return max(1, round(length_m / TILE_M * _CELLS))


def _noise(
    generator: np.random.Generator, sigma: float | tuple[float, float]
) -> Float[np.ndarray, "h w"]:
    """Return noise smoothed by a Gaussian of sigma [cells], seamless, of standard deviation 1."""
    rows, columns = sigma if isinstance(sigma, tuple) else (sigma, sigma)
    spectrum = np.asarray(fft.rfft2(generator.standard_normal((_CELLS, _CELLS))))
    across = np.exp(-2.0 * (np.pi * rows * fft.fftfreq(_CELLS)) ** 2)
    along = np.exp(-2.0 * (np.pi * columns * fft.rfftfreq(_CELLS)) ** 2)
    shaped = spectrum * across[:, None] * along
    noise = np.asarray(fft.irfft2(shaped, s=(_CELLS, _CELLS)))
    return noise / noise.std()


def _tinted(shade: Float[np.ndarray, "h w"], colour: Rgb) -> Texture:
    return np.clip(shade[..., None] * np.array(colour), 0.01, 0.95)
