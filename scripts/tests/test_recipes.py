"""Recipes are read strictly, and errors say file, key, found, allowed."""

from pathlib import Path

import pytest

from cornerscenes.recipes import Family, RecipeError, Suite, known, read

SCENES = Path(__file__).parents[2] / "scenes"


def edited(tmp_path: Path, kind: str, name: str, old: str, new: str) -> Path:
    text = (SCENES / kind / f"{name}.toml").read_text()
    assert old in text
    path = tmp_path / f"{name}.toml"
    path.write_text(text.replace(old, new, 1))
    return path


def test_every_committed_recipe_is_valid():
    for name in known(SCENES / "families"):
        read(Family, SCENES / "families" / f"{name}.toml")
    for name in known(SCENES / "suites"):
        suite = read(Suite, SCENES / "suites" / f"{name}.toml")
        assert {scene.family for scene in suite.scenes} <= set(known(SCENES / "families"))


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
    with pytest.raises(RecipeError, match=r"film.oversampling is 40: .*less than or equal to 16"):
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


def test_samples_that_would_be_rounded_or_summed_in_any_order_are_refused(tmp_path: Path):
    path = edited(tmp_path, "suites", "quick", "fovea_samples = 48", "fovea_samples = 50")
    with pytest.raises(RecipeError, match=r"fovea_samples is 50.*near: 48"):
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
