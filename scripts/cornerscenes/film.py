"""The film of a scene: radiance, finest where the corners are, and its variance."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import ceil, isqrt
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from cornerscenes.mitsuba_backend import World
from cornerscenes.noise_floor import LONGEST_PX, SeenEdge, noise_floor_px, sides
from cornerscenes.recipes import FilmRecipe
from cornerscenes.scene import Scene

# Pixels so near to a corner are those from which its edges are located.
CORNER_RADIUS_PX = LONGEST_PX + 1.0

# How often passes are made: everywhere in the box, and then where the noise so far calls for more.
_TURNS = 3


@dataclass(frozen=True)
class SeenCorner:
    """A visible corner.

    Attributes
    ----------
    image_point_px : Float[np.ndarray, "2"]
        Its projection.
    edges : tuple[SeenEdge, ...]
        Those of its edges that are seen from it.
    blur_px : float
        Standard deviation of the lens's blur there.
    """

    image_point_px: Float[np.ndarray, "2"]
    edges: tuple[SeenEdge, ...]
    blur_px: float


class Window(NamedTuple):
    """A rectangle of pixels: first column, first row, one past the last column, the last row."""

    left: int
    top: int
    right: int
    bottom: int

    @classmethod
    def about(cls, points_px: Float[np.ndarray, "n 2"], margin_px: int) -> Window:
        """Return the smallest window with a margin about points."""
        left, top = (np.floor(points_px.min(axis=0)).astype(int) - margin_px).tolist()
        right, bottom = (np.ceil(points_px.max(axis=0)).astype(int) + margin_px + 1).tolist()
        return cls(left, top, right, bottom)

    @property
    def is_empty(self) -> bool:
        """Whether no pixel is in it."""
        return self.right <= self.left or self.bottom <= self.top

    def within(self, other: Window) -> Window:
        """Return what it shares with another window."""
        return Window(
            max(self.left, other.left),
            max(self.top, other.top),
            min(self.right, other.right),
            min(self.bottom, other.bottom),
        )

    def pixels(self) -> Int[np.ndarray, "n 2"]:
        """Return column and row of its pixels, row by row."""
        x, y = np.meshgrid(np.arange(self.left, self.right), np.arange(self.top, self.bottom))
        return np.stack([x.ravel(), y.ravel()], axis=1)

    def image_of(self, cells: Float[np.ndarray, "n s s c"]) -> Float[np.ndarray, "h w c"]:
        """Return the image that the s x s cells of its pixels make up."""
        _, scale, _, channels = cells.shape
        height, width = self.bottom - self.top, self.right - self.left
        rows = cells.reshape(height, width, scale, scale, channels).swapaxes(1, 2)
        return rows.reshape(height * scale, width * scale, channels)

    def of(self, image: np.ndarray, scale: int = 1) -> np.ndarray:
        """Return the part that it covers of an image `scale` times finer than the sensor."""
        rows = slice(scale * self.top, scale * self.bottom)
        return image[rows, scale * self.left : scale * self.right]


@dataclass(frozen=True)
class Film:
    """Radiance of a scene.

    Attributes
    ----------
    radiance : Float[np.ndarray, "h w 3"]
        Linear Rec. 709 on the oversampled grid; outside the fovea one value per pixel, repeated.
    variance : Float[np.ndarray, "h w 3"]
        Variance of the mean radiance of each pixel, at sensor resolution.
    fovea_px : Window
        Where it is fine.
    corner_samples : tuple[int, ...]
        Of each visible corner: the paths per film cell about it, or more.
    """

    radiance: Float[np.ndarray, "h w 3"]
    variance: Float[np.ndarray, "h w 3"]
    fovea_px: Window
    corner_samples: tuple[int, ...]


class FilmRenderer:
    """Renders the film of a scene: coarsely, finer in the target's box, finest at its corners."""

    def __init__(self, scene: Scene, world: World, recipe: FilmRecipe, key: str) -> None:
        """Take a scene, the same as the renderer holds it, and the name of the random streams."""
        self._scene, self._recipe, self._key = scene, recipe, key
        self._view = world.seen_by(scene.camera, scene.world_from_camera, scene.lens)
        # Paths of one pixel of the box in one pass, and the number of passes there.
        cells = recipe.oversampling**2
        self._samples, self._fovea_passes = passes_of(recipe.fovea_samples * cells)
        self._most_passes = recipe.corner_samples * cells // self._samples

    def film(self, corners: list[SeenCorner]) -> Film:
        """Return the film.

        About each corner passes are added until its render noise floor is as low as the recipe
        asks. How many that takes is told by the noise so far, a few times over.

        Parameters
        ----------
        corners : list[SeenCorner]
            The visible corners.
        """
        scale, camera = self._recipe.oversampling, self._scene.camera
        pixels, variance = self._periphery()
        radiance = np.repeat(np.repeat(pixels, scale, axis=0), scale, axis=1)
        whole = Window(0, 0, camera.width, camera.height)
        points = self._scene.image_of(self._scene.target.vertices_m())
        fovea = Window.about(points, self._recipe.margin_px).within(whole)
        if fovea.is_empty:
            return Film(radiance, variance, Window(0, 0, 0, 0), ())
        tiles = fovea.pixels()
        from_corner = [np.linalg.norm(tiles - c.image_point_px, axis=1) for c in corners]
        near = np.reshape([d <= CORNER_RADIUS_PX for d in from_corner], (-1, len(tiles)))
        cells, means = (_Average(len(tiles)) for _ in range(2))
        passes = np.full(len(tiles), self._fovea_passes)
        for turn in range(_TURNS):
            for count in sorted({*(passes - means.count)} - {0}):
                chosen = np.flatnonzero(passes - means.count == count)
                name = f"fovea/{turn}/{count}"
                for image in self._passes(tiles[chosen], 1, scale, count, name):
                    cells.add(chosen, image)
                    means.add(chosen, image.mean(axis=(1, 2)))
            fovea.of(pixels)[:] = fovea.image_of(means.mean()[:, None, None])
            fovea.of(variance)[:] = fovea.image_of(means.variance()[:, None, None])
            for corner, about in zip(corners, near, strict=True):
                needed = self._passes_for(corner, pixels, variance, means.count[about])
                passes[about] = np.maximum(passes[about], needed)
        fovea.of(radiance, scale)[:] = fovea.image_of(cells.mean())
        samples = [int(means.count[about].min()) * self._samples // scale**2 for about in near]
        return Film(radiance, variance, fovea, tuple(samples))

    def _periphery(self) -> tuple[Float[np.ndarray, "h w 3"], Float[np.ndarray, "h w 3"]]:
        """Return mean radiance and its variance of all pixels, of few paths each.

        A pass's paths of one pixel of the box are shared out over a square of pixels here: the
        renderer compiles its code for their number.
        """
        each, passes = passes_of(self._recipe.periphery_samples)
        side = max(1, isqrt(self._samples // each))
        passes = self._recipe.periphery_samples * side**2 // self._samples
        width, height = self._scene.camera.width, self._scene.camera.height
        x, y = (np.minimum(np.arange(0, n, side), n - side) for n in (width, height))
        tiles = np.stack(np.meshgrid(x, y), axis=2).reshape(-1, 2)
        average = _Average(len(tiles))
        for image in self._passes(tiles, side, side, passes, "periphery"):
            average.add(slice(None), image)
        mean, variance = np.zeros((height, width, 3)), np.zeros((height, width, 3))
        rows, columns = (tiles[:, axis, None] + np.arange(side) for axis in (1, 0))
        place = rows[:, :, None], columns[:, None, :]
        mean[place], variance[place] = average.mean(), average.variance()
        return mean, variance

    def _passes(
        self, tiles: Int[np.ndarray, "n 2"], side: int, divisions: int, count: int, name: str
    ) -> Iterator[Float[np.ndarray, "n d d 3"]]:
        key = f"{self._key}/{name}"
        return self._view.passes(tiles, side, divisions, self._samples, count, key)

    def _passes_for(
        self,
        corner: SeenCorner,
        pixels: Float[np.ndarray, "h w 3"],
        variance: Float[np.ndarray, "h w 3"],
        so_far: Int[np.ndarray, " n"],
    ) -> int:
        """Return how many passes a corner needs, from a film of those so far about it."""
        floor = floor_px(corner, pixels, variance)
        if floor is None or len(so_far) == 0:
            return 0
        needed = ceil(so_far.mean() * (floor / self._recipe.noise_floor_px) ** 2)
        return min(needed, self._most_passes)


class _Average:
    """The means of what is rendered several times with independent noise, and their variance."""

    def __init__(self, size: int) -> None:
        """Take how many places there are."""
        self.count = np.zeros(size, dtype=int)
        self._sum: Any = None
        self._squares: Any = None

    def add(self, places: Any, values: Float[np.ndarray, "n ..."]) -> None:
        """Add one value to each of some places."""
        if self._sum is None:
            self._sum = np.zeros((len(self.count), *values.shape[1:]))
            self._squares = np.zeros_like(self._sum)
        self.count[places] += 1
        self._sum[places] += values
        self._squares[places] += values**2

    def mean(self) -> Float[np.ndarray, "n ..."]:
        """Return the mean at each place."""
        return self._sum / self._per_place()

    def variance(self) -> Float[np.ndarray, "n ..."]:
        """Return the variance of the mean at each place, from that of its values."""
        count = self._per_place()
        squares = self._squares - self._sum**2 / count
        return np.maximum(squares, 0.0) / (count * (count - 1))

    def _per_place(self) -> Int[np.ndarray, "n ..."]:
        return self.count.reshape(-1, *(1,) * (self._sum.ndim - 1))


def passes_of(paths: int) -> tuple[int, int]:
    """Return the paths per pass and the number of passes, 2 to 7, that make up a number of paths.

    Parameters
    ----------
    paths : int
        A multiple of four, 8 or more. A pass takes a power of four of them.
    """
    each = 4
    while paths % (4 * each) == 0 and paths >= 8 * each:
        each *= 4
    return each, paths // each


def binned(image: Float[np.ndarray, "h w 3"], scale: int) -> Float[np.ndarray, "h w 3"]:
    """Return the means over scale x scale cells, in float64."""
    height, width, channels = image.shape
    cells = image.reshape(height // scale, scale, width // scale, scale, channels)
    return cells.mean(axis=(1, 3), dtype=np.float64)


def floor_px(
    corner: SeenCorner, pixels: Float[np.ndarray, "h w 3"], variance: Float[np.ndarray, "h w 3"]
) -> float | None:
    """Return a corner's render noise floor in an image at sensor resolution [px]."""
    point = corner.image_point_px
    found = [(edge, sides(pixels, variance, point, edge)) for edge in corner.edges]
    return noise_floor_px(found, corner.blur_px)


def significant(values: np.ndarray, bits: int) -> Float[np.ndarray, "..."]:
    """Return float32 values rounded to a number of significant bits: what compresses."""
    drop = np.uint32(24 - bits)
    whole = np.ascontiguousarray(values, dtype=np.float32).view(np.uint32)
    half = np.uint32(1) << (drop - np.uint32(1))
    return ((whole + half) >> drop << drop).view(np.float32)
