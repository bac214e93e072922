"""A run that is killed at any moment loses no scene that is whole, and leaves nothing by halves."""

from pathlib import Path

from studies.kills import is_same_after_kills
from studies.runs import render


def test_a_dataset_is_the_same_after_kills_at_random_moments(tmp_path: Path):
    render("tiny", tmp_path / "reference", "--scenes", "0..2")
    render("tiny", tmp_path / "reference", "--scenes", "2..4", "--jobs", "1")
    moments = [3.7, 4.4, 2.9]  # in the first scenes, in the last ones, where the workers begin
    assert is_same_after_kills("tiny", tmp_path / "reference", tmp_path / "killed", moments)
