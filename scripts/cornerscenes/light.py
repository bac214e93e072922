"""Light of a scene: a sky and lamps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from cornerscenes.shape import Rgb

Point = tuple[float, float, float]


@dataclass(frozen=True)
class Lamp:
    """One lamp.

    Attributes
    ----------
    kind : {"square", "point", "sun"}
        A square that faces `aim_m` and emits from that side; a point; parallel light. The shadows
        of the latter two are sharp.
    strength : Rgb
        Linear Rec. 709: radiance of a square, radiant intensity of a point, irradiance on a plane
        across the rays of a sun.
    position_m : Point
        Where it is in the world [m]; of a sun, a point that it shines from.
    aim_m : Point
        Where it shines to [m].
    size_m : float
        Side of a square [m], 0 for the others.
    """

    kind: Literal["square", "point", "sun"]
    strength: Rgb
    position_m: Point
    aim_m: Point
    size_m: float = 0.0

    @property
    def is_sharp(self) -> bool:
        """Whether its shadows have sharp outlines."""
        return self.kind != "square"


@dataclass(frozen=True)
class Light:
    """Sky and lamps.

    Attributes
    ----------
    zenith, horizon, nadir : Rgb
        Radiance of the sky overhead, level and underfoot, linear Rec. 709; it blends with the sine
        of elevation.
    lamps : tuple[Lamp, ...]
        The lamps.
    """

    zenith: Rgb
    horizon: Rgb
    nadir: Rgb
    lamps: tuple[Lamp, ...]
