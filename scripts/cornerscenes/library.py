"""The libraries of materials, backgrounds and lights, from which families choose by name.

Every entry belongs to one split, dev or test, so the two share none of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar

from pydantic import Field, RootModel, model_validator

from cornerscenes.tables import (
    Colour,
    ColourRange,
    Point,
    PositiveRange,
    RecipeError,
    Rgb,
    Split,
    Summary,
    Table,
    Unit,
    UnitRange,
    read,
    unknown_name,
)

if TYPE_CHECKING:
    from cornerscenes.recipes import Family

T = TypeVar("T")


class Entry(Table):
    """What a library holds: dev scenes take dev entries, test scenes take test entries."""

    summary: Summary
    split: Annotated[Split, Field(description="the scenes that may take it")]


class MaterialEntry(Entry):
    """What a target is made of."""

    red: Annotated[bool, Field(description="whether the paper's extraction finds it in good light")]
    colour: Annotated[ColourRange, Field(description="reflectance, [lowest, highest] RGB")]
    roughness: Annotated[
        UnitRange | None, Field(description="GGX roughness of a coat; none where it is matt")
    ] = None
    metallic: Annotated[Unit, Field(description="share of the reflection that is a metal's")] = 0.0
    pattern: Annotated[
        Literal["plain", "wood", "label", "scratches"], Field(description="what is on the faces")
    ] = "plain"


class SurfaceEntry(Table):
    """What a floor or a wall is made of."""

    pattern: Annotated[
        Literal["planks", "plaster", "concrete", "tiles", "carpet", "bricks"],
        Field(description="what it looks like"),
    ]
    colour: Annotated[Colour, Field(description="reflectance about which the pattern varies, RGB")]
    roughness: Annotated[
        float | None,
        Field(gt=0.0, le=1.0, strict=False, description="GGX roughness of a coat; none where matt"),
    ] = None


class BackgroundEntry(Entry):
    """What a room is made of."""

    floor: SurfaceEntry
    walls: SurfaceEntry


class LampEntry(Table):
    """One lamp; it shines at the target."""

    kind: Annotated[
        Literal["square", "point", "sun"],
        Field(description="a square gives soft shadows, a point or the sun sharp ones"),
    ]
    colour: Annotated[Rgb, Field(description="its strength is multiplied by this")] = (1, 1, 1)
    strength: Annotated[
        PositiveRange,
        Field(description="radiance of a square, intensity of a point, irradiance of a sun"),
    ]
    position_m: Annotated[Point, Field(description="where it is; of a sun, whence it shines")]
    jitter_m: Annotated[
        float, Field(ge=0.0, le=5.0, strict=False, description="largest shift of it on each axis")
    ] = 0.0
    size_m: Annotated[PositiveRange | None, Field(description="side of a square")] = None

    @model_validator(mode="after")
    def _size(self) -> LampEntry:
        if (self.size_m is None) == (self.kind == "square"):
            raise ValueError("has size_m if and only if its kind is square")
        return self


class LightEntry(Entry):
    """Sky and lamps; a sky blends between its radiances with the sine of elevation."""

    zenith: Annotated[Rgb, Field(description="radiance overhead")] = (0, 0, 0)
    horizon: Annotated[Rgb, Field(description="radiance at the horizon")] = (0, 0, 0)
    nadir: Annotated[Rgb, Field(description="radiance underfoot, where there is no floor")] = (
        0,
        0,
        0,
    )
    lamps: Annotated[
        tuple[LampEntry, ...], Field(strict=False, description="what shines besides the sky")
    ] = ()


class Materials(RootModel[dict[str, MaterialEntry]]):
    """What targets can be made of, by name."""


class Backgrounds(RootModel[dict[str, BackgroundEntry]]):
    """What rooms can be made of, by name."""


class Lights(RootModel[dict[str, LightEntry]]):
    """How scenes can be lit, by name."""


@dataclass(frozen=True)
class Library:
    """Materials, backgrounds and lights by name."""

    materials: dict[str, MaterialEntry]
    backgrounds: dict[str, BackgroundEntry]
    lights: dict[str, LightEntry]

    @classmethod
    def of(cls, recipes: Path) -> Library:
        """Read the three libraries of a folder of recipes."""
        return cls(
            read(Materials, recipes / "materials.toml").root,
            read(Backgrounds, recipes / "backgrounds.toml").root,
            read(Lights, recipes / "lights.toml").root,
        )

    def used_by(self, family: Family) -> Library:
        """Return the entries that a family names.

        Raises
        ------
        RecipeError
            When it names one that is not there.
        """

        def chosen(kind: str, entries: dict[str, T], names: tuple[str, ...]) -> dict[str, T]:
            for name in names:
                if name not in entries:
                    raise RecipeError(unknown_name(kind, name, sorted(entries)))
            return {name: entries[name] for name in names}

        target = family.target
        rooms = () if family.room is None else family.room.backgrounds
        return Library(
            chosen("target.materials", self.materials, target.materials + target.other_materials),
            chosen("room.backgrounds", self.backgrounds, rooms),
            chosen("lights", self.lights, family.lights),
        )

    def described(self) -> dict[str, Any]:
        """Return all that decides what is rendered, for a hash of it."""
        return {
            kind: {name: entry.model_dump(exclude={"summary"}) for name, entry in entries.items()}
            for kind, entries in vars(self).items()
        }


def of_split(
    key: str, entries: Mapping[str, Entry], names: tuple[str, ...], split: str
) -> list[str]:
    """Return those of the names whose entries belong to a split.

    Raises
    ------
    RecipeError
        When there is none.
    """
    found = [name for name in names if entries[name].split == split]
    if not found:
        raise RecipeError(f"{key}: none of {', '.join(names)} belongs to split {split!r}")
    return found
