"""Provide the irons of examples/irons for tests, and the generator of their loops."""

from __future__ import annotations

import importlib.util
import sys
from functools import cache
from types import ModuleType

import numpy as np

from anhyst._core import Piece
from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.parts.iron import AnySteel, DuhemSteel, PreisachSteel
from tests.plant.rigs import example_steel
from tests.repository import ROOT

FOLDER = ROOT / "examples" / "irons"


@cache
def generator() -> ModuleType:
    """Return the module ``make_loops.py`` of the folder."""
    spec = importlib.util.spec_from_file_location("make_iron_loops", FOLDER / "make_loops.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # needed by its dataclasses
    spec.loader.exec_module(module)
    return module


STEELS: dict[str, AnySteel] = generator().tables()
PREISACH = {name: s for name, s in STEELS.items() if isinstance(s, PreisachSteel)}
DUHEM = {name: s for name, s in STEELS.items() if isinstance(s, DuhemSteel)}
WITH_CELLS = STEELS | {"cells": example_steel()}
WIPED_OUT = PREISACH | {"cells": example_steel()}
"""Irons with return-point memory."""


def width(steel: AnySteel) -> float:
    """Return a field that is proportional to the coercivity of a steel, A/m."""
    if isinstance(steel, PreisachSteel):
        return steel.pinning_A_per_m
    return steel.coercivity_A_per_m if isinstance(steel, DuhemSteel) else 150.0


def fields(turns: list[float], samples: int) -> FloatArray:
    """Return linear paths between reversals with the given number of samples each."""
    at = np.linspace(0.0, len(turns) - 1.0, samples * (len(turns) - 1) + 1)
    return np.asarray(np.interp(at, np.arange(len(turns)), turns))


def run(steel: AnySteel, path: list[float] | FloatArray) -> FloatArray:
    """Return the flux density of initially demagnetised iron along fields, T."""
    found: FloatArray = Piece(steel.make_steel()).run(np.asarray(path, dtype=np.float64))[:, 1]
    return found


def work(field: FloatArray, density: FloatArray) -> float:
    """Return the integral of H over B along a path, J/m^3."""
    return float(np.sum(0.5 * (field[1:] + field[:-1]) * np.diff(density)))
