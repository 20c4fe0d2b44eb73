"""Read identified models from files, for tests that start from a model.

``make truths`` identifies these models again after an improvement of the identification. It calls
``tests.kept_models`` of the rigs, which measures virtual magnets for some models.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

from anhyst.model.actuator import Model, read_model

FOLDER = Path(__file__).parent / "kept_models"


def path_of(name: str) -> Path:
    """Return the path of a model file."""
    return FOLDER / f"{name}.toml"


@cache
def truth(name: str) -> Model:
    """Return the stored model of this name."""
    return read_model(path_of(name))
