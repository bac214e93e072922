"""Recipes are read strictly, and errors say file, key, found, allowed."""

import json
import re
import tomllib
from pathlib import Path

import jsonschema
import pytest

from cornergrasps import schemas as grasp_schemas
from cornerscenes import schemas
from cornerscenes.library import Backgrounds, Library, Lights, Materials
from cornerscenes.recipes import Family, Suite
from cornerscenes.tables import RecipeError, known, read

SCENES = Path(__file__).parents[2] / "scenes"
KINDS = {
    "family": sorted((SCENES / "families").glob("*.toml")),
    "suite": sorted((SCENES / "suites").glob("*.toml")),
    "materials": [SCENES / "materials.toml"],
    "backgrounds": [SCENES / "backgrounds.toml"],
    "lights": [SCENES / "lights.toml"],
    "plan": sorted((SCENES / "plans").glob("*.toml")),
    "camera": sorted((SCENES / "cameras").glob("*.toml")),
    "range-sensor": sorted((SCENES / "range-sensors").glob("*.toml")),
    "gripper": sorted((SCENES / "grippers").glob("*.toml")),
    "robot": sorted((SCENES / "robots").glob("*.toml")),
}
RECIPES = [(kind, path) for kind, paths in KINDS.items() for path in paths]


def edited(tmp_path: Path, kind: str, name: str, old: str, new: str) -> Path:
    text = (SCENES / kind / f"{name}.toml").read_text()
    assert old in text
    path = tmp_path / f"{name}.toml"
    path.write_text(text.replace(old, new, 1))
    return path


def test_every_committed_recipe_is_valid():
    library = Library.of(SCENES)
    families = {
        name: read(Family, SCENES / "families" / f"{name}.toml")
        for name in known(SCENES / "families")
    }
    for family in families.values():
        library.used_by(family)
    for name in known(SCENES / "suites"):
        suite = read(Suite, SCENES / "suites" / f"{name}.toml")
        assert {scene.family for scene in suite.all_scenes(name)} <= set(families)


@pytest.mark.parametrize(("kind", "path"), RECIPES, ids=lambda value: getattr(value, "stem", value))
def test_every_recipe_names_its_schema_and_keeps_it(kind: str, path: Path):
    text = path.read_text()
    named = text.splitlines()[0].removeprefix("#:schema ")
    schema = path.parent / named
    assert schema.resolve() == SCENES / "schemas" / f"{kind}.json"
    jsonschema.validate(tomllib.loads(text), json.loads(schema.read_text()))


OF_PYTHON = {**schemas.KINDS, **grasp_schemas.KINDS}


@pytest.mark.parametrize("kind", OF_PYTHON)
def test_the_committed_schemas_are_those_of_the_sources(kind: str):
    text = (SCENES / "schemas" / f"{kind}.json").read_text()
    assert text == schemas.schema_text(OF_PYTHON[kind]), "cornerbench schemas writes them again"


@pytest.mark.parametrize(
    ("kind", "old", "new"),
    [
        ("suite", "oversampling = 4", "oversampling = 3"),
        ("suite", "oversampling = 4", "oversamplng = 4"),
        ("suite", "fovea_samples = 8 ", "fovea_samples = 9 "),
        ("suite", 'split = "dev"', 'split = "train"'),
        ("family", "width = 512", 'width = "512"'),
        ("plan", 'algorithm = "harris"', 'algorithm = "haris"'),
    ],
)
def test_a_schema_refuses_what_the_reader_refuses(kind: str, old: str, new: str):
    path = (
        SCENES / {"suite": "suites/quick", "family": "families/paper", "plan": "plans/paper"}[kind]
    )
    text = path.with_suffix(".toml").read_text()
    assert old in text
    schema = json.loads((SCENES / "schemas" / f"{kind}.json").read_text())
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(tomllib.loads(text.replace(old, new, 1)), schema)


@pytest.mark.parametrize("kind", [Family, Suite, Materials, Backgrounds, Lights])
def test_every_key_of_a_recipe_is_described(kind: type):
    schema = schemas.schema_of(kind)
    tables = [schema, *schema.get("$defs", {}).values()]
    keys = [(key, value) for table in tables for key, value in table.get("properties", {}).items()]
    undescribed = [key for key, value in keys if "description" not in value and "$ref" not in value]
    assert not undescribed


@pytest.mark.parametrize("kind", [Family, Suite, Materials, Backgrounds, Lights])
def test_every_key_of_a_recipe_is_in_the_format_s_description(kind: type):
    written = (SCENES / "FORMAT.md").read_text()
    schema = schemas.schema_of(kind)
    tables = [schema, *schema.get("$defs", {}).values()]
    keys = {key for table in tables for key in table.get("properties", {})}
    assert keys
    assert not {key for key in keys if not re.search(rf"[`.]{key}(\[\])?[`.]", written)}


def test_every_family_and_suite_is_in_the_format_s_description():
    written = (SCENES / "FORMAT.md").read_text()
    for name in (*known(SCENES / "families"), *known(SCENES / "suites")):
        assert f"| `{name}` |" in written
    for name in known(SCENES / "suites"):
        count = len(read(Suite, SCENES / "suites" / f"{name}.toml").all_scenes(name))
        assert f"| `{name}` | {count} |" in written


def test_an_unknown_key_is_named_with_its_table_s_keys(tmp_path: Path):
    path = edited(tmp_path, "suites", "quick", "oversampling", "oversamplng")
    with pytest.raises(RecipeError) as error:
        read(Suite, path)
    message = str(error.value)
    assert "quick.toml" in message
    assert "key film.oversamplng" in message
    assert "did you mean 'oversampling'?" in message


def test_a_value_out_of_range_is_named_with_what_is_allowed(tmp_path: Path):
    path = edited(tmp_path, "suites", "quick", "oversampling = 4", "oversampling = 40")
    with pytest.raises(RecipeError, match=r"film.oversampling is 40: .*1, 2, 4, 8 or 16"):
        read(Suite, path)


def test_a_wrong_type_is_named(tmp_path: Path):
    path = edited(tmp_path, "families", "paper", "width = 512", 'width = "512"')
    with pytest.raises(RecipeError, match=r"camera.width is '512'"):
        read(Family, path)


def test_a_reversed_range_is_refused(tmp_path: Path):
    path = edited(tmp_path, "suites", "quick", "[0.78, 0.90]", "[0.90, 0.78]")
    with pytest.raises(RecipeError, match=r"visible_fraction \[0.9, 0.78\]: must be"):
        read(Suite, path)


def test_a_reversed_range_of_a_family_is_refused(tmp_path: Path):
    path = edited(tmp_path, "families", "paper", "x_m = [0.40, 0.43]", "x_m = [0.43, 0.4]")
    with pytest.raises(RecipeError, match=r"room.wall_x_m \[0.43, 0.4\]: must be \[low, high\]"):
        read(Family, path)


def test_samples_that_make_no_passes_are_refused(tmp_path: Path):
    path = edited(tmp_path, "suites", "quick", "fovea_samples = 8 ", "fovea_samples = 50 ")
    with pytest.raises(RecipeError, match=r"fovea_samples is 50: .*multiple of 4"):
        read(Suite, path)
    path = edited(tmp_path, "suites", "quick", "corner_samples = 256", "corner_samples = 8")
    path.write_text(path.read_text().replace("fovea_samples = 8 ", "fovea_samples = 16 "))
    with pytest.raises(RecipeError, match=r"corner_samples is 8, must not be less than"):
        read(Suite, path)


def test_two_scenes_of_one_name_are_refused(tmp_path: Path):
    path = edited(tmp_path, "suites", "quick", '"oblique-clear"', '"overhead-clear"')
    with pytest.raises(RecipeError, match="found twice: overhead-clear"):
        read(Suite, path)


def test_a_missing_recipe_names_the_nearest(tmp_path: Path):
    with pytest.raises(RecipeError, match="did you mean 'quick'"):
        read(Suite, SCENES / "suites" / "quik.toml")
    (tmp_path / "broken.toml").write_text("a = [1,")
    with pytest.raises(RecipeError, match=r"broken\.toml"):
        read(Suite, tmp_path / "broken.toml")
