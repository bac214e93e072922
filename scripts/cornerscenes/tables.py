"""Reading recipes: TOML files, strictly, with errors that say what to write instead.

An unknown key, a wrong type or a value out of range is an error that names the file, the key, what
was found, what is allowed and the nearest known name.
"""

from __future__ import annotations

import difflib
import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, RootModel, ValidationError
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue


class RecipeError(Exception):
    """A recipe that cannot be used; the message names file, key, found, allowed."""


class Table(BaseModel):
    """A table of a recipe: no unknown keys, no conversions, no changes."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


Recipe = TypeVar("Recipe", bound=Table | RootModel[Any])

Positive = Annotated[float, Field(gt=0.0, strict=False)]
NotNegative = Annotated[float, Field(ge=0.0, strict=False)]
Real = Annotated[float, Field(strict=False)]
Unit = Annotated[float, Field(ge=0.0, le=1.0, strict=False)]
Rgb = Annotated[tuple[NotNegative, NotNegative, NotNegative], Field(strict=False)]
Colour = Annotated[tuple[Unit, Unit, Unit], Field(strict=False)]
Point = Annotated[tuple[Real, Real, Real], Field(strict=False)]
Names = Annotated[tuple[str, ...], Field(min_length=1, strict=False)]
SceneName = Annotated[
    str, Field(pattern=r"^[a-z0-9][a-z0-9-]{0,63}$", description="the scene's folder")
]
FieldOfView = Annotated[
    float, Field(ge=1.0, le=150.0, strict=False, description="angle between its outer columns")
]
Split = Literal["dev", "test"]
Summary = Annotated[str, Field(description="one line for a person")]


def _ordered(bounds: tuple[float, float]) -> tuple[float, float]:
    if bounds[0] > bounds[1]:
        raise ValueError(f"[{bounds[0]}, {bounds[1]}]: must be [low, high]")
    return bounds


Range = Annotated[tuple[Real, Real], Field(strict=False), AfterValidator(_ordered)]
PositiveRange = Annotated[tuple[Positive, Positive], Field(strict=False), AfterValidator(_ordered)]
UnitRange = Annotated[tuple[Unit, Unit], Field(strict=False), AfterValidator(_ordered)]
ColourRange = Annotated[tuple[Colour, Colour], Field(strict=False)]


def read(kind: type[Recipe], path: Path) -> Recipe:
    """Read one recipe.

    Parameters
    ----------
    kind : type
        What the file holds, `Family` or `Suite` for instance.
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


def schema_of(kind: type[BaseModel]) -> JsonSchemaValue:
    """Return the JSON Schema of a kind of recipe."""
    return kind.model_json_schema(schema_generator=_TomlSchema)


class _TomlSchema(GenerateJsonSchema):
    """JSON Schema of TOML, which has no null: what may be `None` is a key that may be missing."""

    def nullable_schema(self, schema: Any) -> JsonSchemaValue:
        return self.generate_inner(schema["schema"])

    def default_schema(self, schema: Any) -> JsonSchemaValue:
        if schema.get("default", ...) is None:
            return self.generate_inner(schema["schema"])
        return super().default_schema(schema)

    def field_title_should_be_set(self, schema: Any) -> bool:
        return False  # a key's title would be the key again


def _keys(kind: type[BaseModel], location: tuple[str | int, ...]) -> list[str]:
    """Return the keys that the table at a location may have."""
    schema = schema_of(kind)
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
