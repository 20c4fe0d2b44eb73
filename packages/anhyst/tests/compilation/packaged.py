"""Folders that are compiled once for the tests of packages, and compilers."""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from anhyst.compensate.plan import CompileRequest
from anhyst.compilation import output, play
from anhyst.compilation.output import compile_model
from anhyst.compilation.packages import make_package_files
from anhyst.compilation.play import compile_play
from anhyst.model.writer import write_model
from anhyst.support.atomic import write_files
from tests.actuators import magnet, ring
from tests.compensate.test_solid import LAYERS, RATE
from tests.compensate.test_solid import magnet as solid_magnet
from tests.compilation.test_compile import WARNINGS, measured
from tests.core.test_c_core import tool
from tests.repository import ROOT
from tests.truths import path_of

CONTROLLER = ROOT / "examples" / "bearing" / "controller.toml"


@dataclass(frozen=True)
class Plain:
    """Inputs of a package: files of a compiled folder, its manifest, and its names."""

    files: Mapping[str, str]
    manifest: Mapping[str, Any]
    values: Mapping[str, Any]

    def write(self, package: str, folder: Path) -> Path:
        write_files(folder, make_package_files(package, self.files, self.manifest, self.values))
        return folder


def recorded(module: Any, compile_: Callable[[], object]) -> Plain:
    """Compile without a package, and store the inputs of a package."""
    kept: list[Plain] = []

    def keep(package: None, files: Any, manifest: Any, values: Any) -> Any:
        kept.append(Plain(files, dict(manifest), values))
        return files

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "make_package_files", keep)
        compile_()
    return kept[0]


def model_file(place: Path, model: Any) -> Path:
    write_model(model, place / "model.toml")
    return place / "model.toml"


def _cells(place: Path) -> Plain:
    request = CompileRequest("full", "q15", 1e4, accuracy=2.0, name="upper_2")
    return recorded(output, lambda: compile_model(path_of("cells-play-cells"), place / "c", request))


def _single(place: Path) -> Plain:
    request = CompileRequest("simplified", "f32", 1e4, accuracy=40.0, name="real")
    file = model_file(place, measured(magnet()))
    return recorded(output, lambda: compile_model(file, place / "c", request))


def _ring(place: Path) -> Plain:
    request = CompileRequest("full", "q31", 1e4, accuracy=2.0)
    file = model_file(place, measured(ring(), -120.0, 120.0))
    return recorded(output, lambda: compile_model(file, place / "c", request))


def _euler(place: Path) -> Plain:
    request = CompileRequest("euler", "q15", 1e4, accuracy=40.0, name="anhyst_euler")
    file = model_file(place, measured(magnet()))
    return recorded(output, lambda: compile_model(file, place / "c", request))


def _play(place: Path) -> Plain:
    file = model_file(place, measured(magnet()))
    return recorded(play, lambda: compile_play(file, place / "c", 1e4, "q31", "a"))


def _controller(place: Path) -> Plain:
    request = CompileRequest("full", "q31", 20e3)
    file = path_of("bearing")
    return recorded(output, lambda: compile_model(file, place / "c", request, CONTROLLER))


def _solid(place: Path) -> Plain:
    file = solid_magnet(LAYERS["three and sheets"]).save(place / "model.toml")
    request = CompileRequest("full", "q31", RATE, name="solid")
    return recorded(output, lambda: compile_model(file, place / "c", request))


CASES = {
    "cells": _cells,
    "single": _single,
    "controller": _controller,
    "ring": _ring,
    "euler": _euler,
    "play": _play,
    "solid": _solid,
}
MARKS = dict.fromkeys(("controller", "play", "solid"), pytest.mark.slow)
MARKS |= dict.fromkeys(("ring", "euler"), pytest.mark.campaign)
PARAMS = [pytest.param(one, marks=MARKS.get(one, ())) for one in CASES]


@cache
def plain(place: Path, case: str) -> Plain:
    folder = place / case
    folder.mkdir()
    return CASES[case](folder)


def run(*command: object, folder: Path | None = None) -> str:
    """Run a command; return its output."""
    words = [str(word) for word in command]
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{' '.join(words)}\n{done.stdout}{done.stderr}"
    return done.stdout


def built(program: Path, sources: Iterable[Path], folders: Iterable[Path], *flags: str) -> Path:
    """Compile with all warnings."""
    include = [f"-I{folder}" for folder in folders]
    run(tool("cc"), *WARNINGS, *flags, *include, *sources, "-o", program)
    return program


def passed(plain: Plain) -> str:
    """Return the output of an example if every bit is right."""
    table = plain.files["controller.csv" if plain.values["control"] else "vectors.csv"]
    return f"{len(table.splitlines()) - 1} rows, 0 differ\n"


@pytest.fixture(scope="module", autouse=True)
def undrawn() -> Iterator[None]:
    """Omit the figure of a budget, which takes a fifth of the compile time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("anhyst.compilation.budget_page._draw_deviations", lambda budget, runs: None)
        patch.setattr("anhyst.compilation.budget_page.svg_text", lambda figure, prefix: "<svg/>")
        yield


@pytest.fixture(scope="session")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder in which all cases are compiled once."""
    return tmp_path_factory.mktemp("packages")


@pytest.fixture(params=PARAMS)
def case(place: Path, request: pytest.FixtureRequest) -> Plain:
    """Return one case after the other."""
    return plain(place, request.param)
