"""Models that were identified once and are kept: tests that start from a model read it here.

``make truths`` identifies them all again, for when identification gives better ones
(``tests.kept_models`` of the rigs, which measures virtual magnets for some of them).
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

from anhyst.model.actuator import Model, read_model

FOLDER = Path(__file__).parent / "kept_models"


def path_of(name: str) -> Path:
    """Where the model file of a truth lies."""
    return FOLDER / f"{name}.toml"


@cache
def truth(name: str) -> Model:
    """Return the kept model of this name."""
    return read_model(path_of(name))
