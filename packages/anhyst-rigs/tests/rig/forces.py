"""Provide a force rig whose program is built once for all tests."""

from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path

import pytest

from anhyst_rigs.rig.force.file import ForceControlRig, read_rig
from anhyst_rigs.rig.force.programs import Program
from anhyst_rigs.study.force_control import build_program
from tests.once import made_once
from tests.repository import ROOT
from tests.truths import truth

EXAMPLE = ROOT / "examples" / "solenoid"


def example() -> ForceControlRig:
    return read_rig(EXAMPLE / "rig.toml")


def program(factory: pytest.TempPathFactory, board: str = "library") -> Program:
    """Build a program for the end of the stroke only, which is identified quickly."""

    def make(folder: Path) -> None:
        model = truth("solenoid-end")
        built = build_program("full", model, example().settings.timing.rate_Hz, board, folder)
        (folder / "program").write_bytes(pickle.dumps(built))

    return load(made_once(factory, f"force-{board}", make))


def load(folder: Path) -> Program:
    """Return the program that is stored in a folder."""
    found: Program = pickle.loads((folder / "program").read_bytes())
    return replace(found, firmware=folder / "firmware")
