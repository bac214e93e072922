"""A run that is killed at any moment loses no scene that is whole, and leaves nothing by halves."""

from pathlib import Path

from studies.kills import is_same_after_kills


def test_a_dataset_is_the_same_after_kills_at_random_moments(tiny: Path, tmp_path: Path):
    # In the first scenes, where nothing is whole, and later; `studies.kills` does it twenty times.
    moments = [0.7, 3.1]
    assert is_same_after_kills("tiny", tiny, tmp_path / "killed", moments, ["--jobs", "1"])
