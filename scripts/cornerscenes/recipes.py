"""Suites and scene families: the TOML files under ``scenes``, read strictly.

An unknown key, a wrong type or a value out of range is an error that names the file, the key, what
was found, what is allowed and the nearest known name.
"""

from __future__ import annotations

import difflib
import math
import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator


class RecipeError(Exception):
    """A recipe that cannot be used; the message names file, key, found, allowed."""


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


Recipe = TypeVar("Recipe", bound=_Table)

Positive = Annotated[float, Field(gt=0.0, strict=False)]
Real = Annotated[float, Field(strict=False)]
Unit = Annotated[float, Field(ge=0.0, le=1.0, strict=False)]
Colour = Annotated[tuple[Unit, Unit, Unit], Field(strict=False)]
Point = Annotated[tuple[Real, Real, Real], Field(strict=False)]


def _ordered(bounds: tuple[float, float]) -> tuple[float, float]:
    if bounds[0] > bounds[1]:
        raise ValueError(f"[{bounds[0]}, {bounds[1]}]: must be [low, high]")
    return bounds


Range = Annotated[tuple[Real, Real], Field(strict=False), AfterValidator(_ordered)]
PositiveRange = Annotated[tuple[Positive, Positive], Field(strict=False), AfterValidator(_ordered)]
UnitRange = Annotated[tuple[Unit, Unit], Field(strict=False), AfterValidator(_ordered)]


class CameraRecipe(_Table):
    """The colour camera."""

    width: Annotated[int, Field(ge=16, le=8192)]
    height: Annotated[int, Field(ge=16, le=8192)]
    horizontal_field_of_view_deg: Annotated[float, Field(ge=1.0, le=150.0, strict=False)]


class RangeSensorRecipe(_Table):
    """The range sensor; it shares the camera's pose and field of view."""

    width: Annotated[int, Field(ge=1, le=4096)]
    height: Annotated[int, Field(ge=1, le=4096)]


class PoseRecipe(_Table):
    """Where a camera stands and what it looks at."""

    position_m: Point
    looks: Literal["down", "at target"]
    jitter_m: Annotated[float, Field(ge=0.0, le=1.0, strict=False)] = 0.0


class RoomRecipe(_Table):
    """Two walls and a floor."""

    wall_x_m: Range
    wall_y_m: Range
    extent_m: Annotated[float, Field(ge=0.5, le=20.0, strict=False)]
    height_m: Annotated[float, Field(ge=0.1, le=20.0, strict=False)]


class TargetRecipe(_Table):
    """The cuboid; each dimension is drawn from its own range."""

    length_m: PositiveRange
    width_m: PositiveRange
    height_m: PositiveRange
    position_x_m: Range
    position_y_m: Range
    yaw_deg: Range
    colour: Colour
    roughness: Annotated[float, Field(gt=0.0, le=1.0, strict=False)]


class ObjectRecipe(_Table):
    """One object beside the target: an occluder stands between it and the camera."""

    builders: Annotated[tuple[str, ...], Field(min_length=1, strict=False)]
    height_m: PositiveRange
    role: Literal["occluder", "bystander"]


class LightRecipe(_Table):
    """Sky light and one square area light that faces the target."""

    sky_zenith: Annotated[tuple[Positive, Positive, Positive], Field(strict=False)]
    sky_horizon: Annotated[tuple[Positive, Positive, Positive], Field(strict=False)]
    area_radiance: PositiveRange
    area_size_m: Positive
    area_position_m: Point
    area_jitter_m: Annotated[float, Field(ge=0.0, le=1.0, strict=False)]


class Family(_Table):
    """A kind of scene: ranges from which its scenes are drawn."""

    summary: str
    camera: CameraRecipe
    range_sensor: RangeSensorRecipe
    poses: Annotated[dict[str, PoseRecipe], Field(min_length=1)]
    room: RoomRecipe
    target: TargetRecipe
    objects: Annotated[tuple[ObjectRecipe, ...], Field(strict=False)]
    light: LightRecipe


class FilmRecipe(_Table):
    """How finely a suite is rendered."""

    oversampling: Annotated[int, Field(ge=1, le=16)]
    fovea_samples: Annotated[int, Field(ge=4, le=65536)]
    periphery_samples: Annotated[int, Field(ge=4, le=65536)]
    passes: Annotated[int, Field(ge=2, le=64)]
    margin_px: Annotated[int, Field(ge=0, le=512)]
    max_depth: Annotated[int, Field(ge=1, le=64)]

    @model_validator(mode="after")
    def _power_of_four(self) -> FilmRecipe:
        # A square number, because the multi-jittered sampler rounds all others. A power of two,
        # because then no film cell's samples are split between threads, whose sums would differ
        # in the last bit from run to run.
        for key in ("fovea_samples", "periphery_samples"):
            samples = getattr(self, key)
            exponent = max(1, round(math.log(samples / self.passes, 4)))
            nearest = self.passes * 4**exponent
            if samples != nearest:
                raise ValueError(
                    f"{key} is {samples}, must be passes ({self.passes}) times a power of four; "
                    f"near: {nearest}"
                )
        return self


class SceneRecipe(_Table):
    """One scene of a suite."""

    name: Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9-]{0,63}$")]
    family: str
    pose: str
    visible_fraction: UnitRange


class Suite(_Table):
    """A list of scenes to render, and how."""

    summary: str
    film: FilmRecipe
    scenes: Annotated[tuple[SceneRecipe, ...], Field(min_length=1, strict=False)]

    @model_validator(mode="after")
    def _distinct(self) -> Suite:
        names = [scene.name for scene in self.scenes]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"names of scenes must differ, found twice: {', '.join(twice)}")
        return self


def read(kind: type[Recipe], path: Path) -> Recipe:
    """Read one recipe.

    Parameters
    ----------
    kind : type
        `Family` or `Suite`.
    path : Path
        Its TOML file.

    Raises
    ------
    RecipeError
        When the file is missing, is not TOML, or holds what the kind does not allow.
    """
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise RecipeError(unknown_name(path.parent, path.stem, known(path.parent))) from None
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise RecipeError(f"{path}: {error}") from error
    try:
        return kind.model_validate(table)
    except ValidationError as error:
        lines = [f"{path}: {_explain(item, kind)}" for item in error.errors(include_url=False)]
        raise RecipeError("\n".join(lines)) from None


def known(folder: Path) -> list[str]:
    """Return the names of the recipes in a folder, sorted."""
    return sorted(file.stem for file in folder.glob("*.toml"))


def unknown_name(place: Path | str, found: str, names: list[str]) -> str:
    """Return the sentence for a name that nothing answers to."""
    near = difflib.get_close_matches(found, names, n=1)
    hint = f"did you mean {near[0]!r}? " if near else ""
    return f"{place}: unknown name {found!r}; {hint}known: {', '.join(names)}"


def _explain(item: Any, kind: type[BaseModel]) -> str:
    location = item["loc"]
    key = ".".join(str(step) for step in location)
    if item["type"] == "extra_forbidden":
        return unknown_name(f"key {key}", str(location[-1]), _keys(kind, location[:-1]))
    if item["type"] == "missing":
        return f"{key} is missing"
    if item["type"] == "value_error":
        return f"{key} {item['ctx']['error']}".strip()
    return f"{key} is {item['input']!r}: {item['msg'].removeprefix('Input ')}"


def _keys(kind: type[BaseModel], location: tuple[str | int, ...]) -> list[str]:
    """Return the keys that the table at a location may have."""
    schema = kind.model_json_schema()
    node: Any = schema
    for step in location:
        node = _resolved(schema, node)
        if isinstance(step, int):
            node = node["items"]
        else:
            node = node.get("properties", {}).get(step) or node.get("additionalProperties")
    return sorted(_resolved(schema, node)["properties"])


def _resolved(schema: Any, node: Any) -> Any:
    return schema["$defs"][node["$ref"].rpartition("/")[2]] if "$ref" in node else node
