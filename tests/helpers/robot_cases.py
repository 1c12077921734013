"""Robot files with known right values, which lie beside the repository."""

from __future__ import annotations

from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[3] / "shared/data/cases/robots"


def robot_case(name: str) -> Path:
    """Return the path of a file; the test is skipped where there is none."""
    if not (FOLDER / name).is_file():
        pytest.skip(f"../shared/data/cases/robots/{name} is not there")
    return FOLDER / name
