"""What several test files use."""

from pathlib import Path

import pytest

from studies.runs import render


@pytest.fixture(scope="session")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Suite `tiny`, rendered by two workers."""
    folder = tmp_path_factory.mktemp("tiny") / "dataset"
    render("tiny", folder, "--jobs", "2")
    return folder
