"""Fixtures shared by all tests."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session")
def measurements() -> Path:
    """Folder of real measurements; tests that need it skip where it is absent."""
    folder = Path(os.environ.get("ANHYST_DATA", ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip("real measurements are not here: set ANHYST_DATA to their folder")
    return folder
