"""Provide the program of the XCP slave for tests."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.link.foreign import slaves


@pytest.fixture(scope="session")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The slave with debug information, at fixed addresses."""
    return slaves.build(tmp_path_factory)
