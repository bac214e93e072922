"""The film of a scene: radiance, finest where the corners are, and its variance."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from cornerscenes.mitsuba_backend import World
from cornerscenes.noise_floor import LONGEST_PX, SeenEdge, noise_floor_px, sides
from cornerscenes.recipes import FilmRecipe
from cornerscenes.scene import Scene
from cornerscenes.streams import seed

# Half the side of the window about a corner: the pixels from which its edges are located.
_CORNER_HALF_PX = ceil(LONGEST_PX)


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

    @property
    def area(self) -> int:
        """How many pixels are in it."""
        return 0 if self.is_empty else (self.right - self.left) * (self.bottom - self.top)

    def within(self, other: Window) -> Window:
        """Return what it shares with another window."""
        return Window(
            max(self.left, other.left),
            max(self.top, other.top),
            min(self.right, other.right),
            min(self.bottom, other.bottom),
        )

    def contains(self, point_px: Float[np.ndarray, "2"]) -> bool:
        """Return whether a point lies on its pixels."""
        x, y = np.round(point_px)
        return bool(self.left <= x < self.right and self.top <= y < self.bottom)

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
    windows : tuple[tuple[Window, int], ...]
        Where it is finest, about the corners: windows and the samples of their film cells.
    """

    radiance: Float[np.ndarray, "h w 3"]
    variance: Float[np.ndarray, "h w 3"]
    fovea_px: Window
    windows: tuple[tuple[Window, int], ...]


class FilmRenderer:
    """Renders the film of a scene: coarsely, finer in the target's box, finest at its corners."""

    def __init__(self, scene: Scene, world: World, recipe: FilmRecipe, key: str) -> None:
        """Take a scene, the same as the renderer holds it, and the name of the random streams."""
        self._scene, self._world, self._recipe, self._key = scene, world, recipe, key

    def film(self, corners: list[SeenCorner]) -> Film:
        """Return the film.

        About each corner passes are made until its render noise floor is as low as the recipe asks:
        two, from whose noise the number of passes follows that it takes, and then the rest.

        Parameters
        ----------
        corners : list[SeenCorner]
            The visible corners.
        """
        recipe, scale, camera = self._recipe, self._recipe.oversampling, self._scene.camera
        whole = Window(0, 0, camera.width, camera.height)
        coarse = self._passes(whole, 1, recipe.periphery_samples // 2, "periphery")
        coarse.add(2)
        radiance = np.repeat(np.repeat(coarse.mean(), scale, axis=0), scale, axis=1)
        variance = coarse.variance()
        points = self._scene.image_of(self._scene.target.vertices_m())
        fovea = Window.about(points, recipe.margin_px).within(whole)
        if fovea.is_empty:
            return Film(radiance, variance, Window(0, 0, 0, 0), ())
        box = self._passes(fovea, scale, recipe.fovea_samples // 2, "fovea")
        box.add(2)
        fovea.of(radiance, scale)[:] = box.mean()
        fovea.of(variance)[:] = box.variance()
        windows: list[tuple[Window, int]] = []
        about = [Window.about(c.image_point_px[None], _CORNER_HALF_PX) for c in corners]
        for window in merged([one.within(fovea) for one in about]):
            name = f"corner/{window.left}/{window.top}"
            finest = self._passes(window, scale, recipe.corner_samples, name)
            inside = [c for c in corners if window.contains(c.image_point_px)]
            finest.add(2)
            finest.add(self._more_passes(window, finest, inside, radiance, variance))
            window.of(radiance, scale)[:] = finest.mean()
            window.of(variance)[:] = finest.variance()
            windows.append((window, finest.count * recipe.corner_samples))
        return Film(radiance, variance, fovea, tuple(windows))

    def _passes(self, window: Window, scale: int, samples: int, name: str) -> _Passes:
        key = f"{self._key}/{name}"
        return _Passes(self._scene, self._world, window, scale, samples, key)

    def _more_passes(
        self,
        window: Window,
        finest: _Passes,
        corners: list[SeenCorner],
        radiance: Float[np.ndarray, "h w 3"],
        variance: Float[np.ndarray, "h w 3"],
    ) -> int:
        """Return how many passes a window needs beyond those made."""
        recipe = self._recipe
        window.of(radiance, recipe.oversampling)[:] = finest.mean()
        window.of(variance)[:] = finest.variance()
        pixels = binned(radiance, recipe.oversampling)
        floors = [floor_px(corner, pixels, variance) for corner in corners]
        return passes_needed(recipe, finest.count, floors) - finest.count


class _Passes:
    """Independent passes over a window: their mean, and the variance of the pixels' means."""

    def __init__(
        self, scene: Scene, world: World, window: Window, scale: int, samples: int, key: str
    ) -> None:
        self._scene, self._world, self._window = scene, world, window
        self._scale, self._samples, self._key = scale, samples, key
        self.count = 0
        height, width = window.bottom - window.top, window.right - window.left
        self._sum = np.zeros((scale * height, scale * width, 3))
        self._pixel_sum = np.zeros((height, width, 3))
        self._pixel_squares = np.zeros((height, width, 3))

    def add(self, passes: int) -> None:
        """Render more passes."""
        for _ in range(passes):
            image = self._world.radiance(
                self._scene.camera,
                self._scene.world_from_camera,
                self._scale,
                self._window,
                self._samples,
                seed(self._key, self.count),
                self._scene.lens,
            )
            pixels = binned(image, self._scale)
            self._sum += image
            self._pixel_sum += pixels
            self._pixel_squares += pixels**2
            self.count += 1

    def mean(self) -> Float[np.ndarray, "h w 3"]:
        """Return the mean radiance of the film cells."""
        return self._sum / self.count

    def variance(self) -> Float[np.ndarray, "h w 3"]:
        """Return the variance of the pixels' mean radiance."""
        squares = self._pixel_squares - self._pixel_sum**2 / self.count
        return np.maximum(squares, 0.0) / (self.count * (self.count - 1))


def passes_needed(recipe: FilmRecipe, made: int, floors_px: list[float | None]) -> int:
    """Return how many passes a window takes, from its corners' noise floors after some passes."""
    worst = max((floor for floor in floors_px if floor is not None), default=0.0)
    needed = ceil(made * (worst / recipe.noise_floor_px) ** 2)
    return max(made, min(needed, recipe.corner_passes))


def merged(windows: list[Window]) -> list[Window]:
    """Return windows that do not overlap: those that do become their common box."""
    done: list[Window] = []
    for window in windows:
        if window.is_empty:
            continue
        while (other := next((o for o in done if not window.within(o).is_empty), None)) is not None:
            done.remove(other)
            window = Window(
                min(window.left, other.left),
                min(window.top, other.top),
                max(window.right, other.right),
                max(window.bottom, other.bottom),
            )
        done.append(window)
    return done


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
