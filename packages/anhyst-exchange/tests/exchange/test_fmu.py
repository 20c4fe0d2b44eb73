"""Compensators as FMUs in fmpy, and models as tables."""

from __future__ import annotations

import json
import subprocess
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import anhyst
from anhyst.compensate.block import Block
from anhyst.compensate.force_controller import FixedTwin
from anhyst.compensate.plan import CompileRequest, make_plan
from anhyst.support.numeric import FloatArray
from anhyst_exchange.exporter import ExportedPart, export_fmu, export_tables
from anhyst_exchange.part import FmiVersion
from tests.cli.command import quick as run
from tests.core.test_c_core import tool
from tests.exchange.conftest import Fmu
from tests.exchange.slave import HERE, RATE, fmpy, needs_binary, slave
from tests.refusals import says

GAP = 4e-4
pytestmark = needs_binary

Versions = dict[FmiVersion, Path]


@pytest.fixture(scope="module")
def model(identified: anhyst.Model) -> anhyst.Model:
    return identified


@pytest.fixture(scope="module")
def files(model: anhyst.Model, fmu: Fmu) -> Versions:
    versions: tuple[FmiVersion, ...] = ("2.0", "3.0")
    return {version: fmu(model, "compensator", version) for version in versions}


@contextmanager
def instance(path: Path, folder: Path) -> Iterator[Any]:
    """Yield an initialised instance of an FMU; reals are accessed by reference."""
    with slave(path, folder) as made:
        yield made.raw


def write(made: Any, references: list[int], values: list[float]) -> None:
    (made.setReal if hasattr(made, "setReal") else made.setFloat64)(references, values)


def current(made: Any) -> float:
    return float((made.getReal if hasattr(made, "getReal") else made.getFloat64)([3])[0])


def run_through(made: Any, demand: FloatArray, step: float, begin: float = 0.0) -> list[float]:
    found = []
    for place, one in enumerate(demand):
        write(made, [1, 2], [float(one), GAP])
        made.doStep(begin + place * step, step)
        found.append(current(made))
    return found


def demands(size: int) -> FloatArray:
    time = np.arange(size) / RATE
    return 80.0 * (1.0 - np.cos(2e2 * time)) + 5.0 * np.sin(3e3 * time) ** 2


def expected(model: anhyst.Model, demand: FloatArray) -> list[float]:
    """Return the result of the same fixed-point C in Python."""
    plan = make_plan(model, CompileRequest("full", "q31", RATE), 0)
    assert isinstance(plan.block, Block)
    return [*map(float, FixedTwin(plan.block, "q31").run(demand, np.full(demand.size, GAP)))]


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_the_fmu_is_valid_and_describes_itself(files: Versions, version: FmiVersion) -> None:
    from fmpy.validation import validate_fmu

    assert validate_fmu(str(files[version])) == []
    about = fmpy.read_model_description(files[version])
    assert about.fmiVersion == version
    units = {one.name: one.unit for one in about.modelVariables if one.name != "time"}
    assert units == {"demand": "N", "gap": "m", "current": "A"}
    assert float(about.defaultExperiment.stepSize) == 1.0 / RATE


@pytest.mark.slow
@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_the_fmu_gives_the_currents_of_the_compiled_c_bit_for_bit(
    files: Versions, version: FmiVersion, model: anhyst.Model, tmp_path: Path
) -> None:
    demand = demands(400)
    with instance(files[version], tmp_path) as made:
        found = run_through(made, demand, 1.0 / RATE)
    assert found == expected(model, demand)
    assert max(found) > 1.0


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_a_state_is_restored_and_transferred_to_another_instance(
    files: Versions, version: FmiVersion, tmp_path: Path
) -> None:
    demand = demands(300)
    with instance(files[version], tmp_path / "a") as made:
        run_through(made, demand[:200], 1.0 / RATE)
        get, put = (
            (made.getFMUstate, made.setFMUstate) if version == "2.0" else (made.getFMUState, made.setFMUState)
        )
        state = get()
        there = run_through(made, demand[200:], 1.0 / RATE, 200.0 / RATE)
        put(state)
        assert run_through(made, demand[200:], 1.0 / RATE, 200.0 / RATE) == there
        kept = made.serializeFMUstate(state) if version == "2.0" else made.serializeFMUState(state)
    with instance(files[version], tmp_path / "b") as other:
        if version == "2.0":
            other.setFMUstate(other.deSerializeFMUstate(kept))
        else:
            other.setFMUState(other.deserializeFMUState(kept))
        assert run_through(other, demand[200:], 1.0 / RATE, 200.0 / RATE) == there


def test_the_fmu_keeps_its_own_rate_at_any_step(files: Versions, tmp_path: Path) -> None:
    demand = np.repeat(demands(60), 2)
    with instance(files["2.0"], tmp_path / "a") as made:
        halves = run_through(made, demand, 0.5 / RATE)
    with instance(files["2.0"], tmp_path / "b") as made:
        whole = run_through(made, demand[::2], 1.0 / RATE)
        # A step of three ticks holds the inputs and equals three single ticks.
        write(made, [1], [50.0])
        made.doStep(60.0 / RATE, 3.0 / RATE)
        held = current(made)
    assert halves[1::2] == whole
    assert halves[0::2] == whole
    with instance(files["2.0"], tmp_path / "c") as made:
        run_through(made, demand[::2], 1.0 / RATE)
        assert run_through(made, np.full(3, 50.0), 1.0 / RATE, 60.0 / RATE)[-1] == held


@pytest.mark.slow
@pytest.mark.parametrize("of", ["compensator", "actuator"])
def test_its_sources_compile_without_a_warning(
    of: ExportedPart, fmu: Fmu, model: anhyst.Model, tmp_path: Path
) -> None:
    for version in ("2.0", "3.0"):
        folder = tmp_path / version
        with zipfile.ZipFile(fmu(model, of, version)) as archive:
            archive.extractall(folder)
        sources = [str(one) for one in sorted((folder / "sources").rglob("*.c"))]
        strict = ["-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-fsyntax-only"]
        places = [f"-I{folder / 'sources'}", f"-I{folder / 'sources' / 'include'}"]
        completed = subprocess.run([tool("cc"), *strict, *places, *sources], capture_output=True,
                              text=True, check=False)  # fmt: skip
        assert completed.returncode == 0, completed.stderr


@pytest.mark.slow
def test_binaries_are_of_their_platforms(model: anhyst.Model, tmp_path: Path) -> None:
    path = export_fmu(model, tmp_path / "m.fmu", rate=RATE, fmi="3.0")
    begins = {
        "x86_64-linux": (b"\x7fELF", 18, b"\x3e"),
        "aarch64-linux": (b"\x7fELF", 18, b"\xb7"),
        "x86_64-windows": (b"MZ", 0, b"M"),
        "x86_64-darwin": (b"\xcf\xfa\xed\xfe", 4, b"\x07"),
        "aarch64-darwin": (b"\xcf\xfa\xed\xfe", 4, b"\x0c"),
    }
    with zipfile.ZipFile(path) as archive:
        for name, (magic, place, machine) in begins.items():
            (binary,) = (one for one in archive.namelist() if one.startswith(f"binaries/{name}/"))
            content = archive.read(binary)
            assert content.startswith(magic)
            assert content[place : place + 1] == machine


def test_the_command_writes_either_and_the_same_file_for_the_same_model(
    files: Versions, model: anhyst.Model, tmp_path: Path
) -> None:
    model.save(tmp_path / "model.toml")
    completed = run(
        *("export", "model.toml", "--as", "fmu", "--rate", "20000", "--out", "m.fmu"),
        *("--platforms", HERE),
        cwd=tmp_path,
    )
    assert completed.returncode == 0, completed.stderr
    assert fmpy.read_model_description(tmp_path / "m.fmu").modelName == "loops"
    with zipfile.ZipFile(tmp_path / "m.fmu") as one, zipfile.ZipFile(files["2.0"]) as other:
        assert one.namelist() == other.namelist()
        sources = [name for name in one.namelist() if not name.startswith("binaries")]
        assert all(one.read(name) == other.read(name) for name in sources)
    assert run("export", "model.toml", "--as", "lut", "-o", "m.csv", cwd=tmp_path).returncode == 0
    for arguments, said in (
        (["--as", "fmu", "--out", "m.fmu"], "missing --rate"),
        (["--as", "fmu", "--rate", "1e4", "--out", "m.zip"], "wrong-ending: m.zip"),
        (["--as", "lut", "--out", "m.xls"], "wrong-ending: m.xls"),
        (
            ["--as", "fmu", "--rate", "1e4", "-o", "n.fmu", "--platforms", "amiga"],
            "unknown-platform: 'amiga'",
        ),
    ):
        completed = run("export", "model.toml", *arguments, cwd=tmp_path)
        assert completed.returncode == 2
        assert says(completed.stderr, said)
    assert not (tmp_path / "n.fmu").exists()


def test_tables_are_the_settled_loop_of_the_model(model: anhyst.Model, tmp_path: Path) -> None:
    content = json.loads(export_tables(model, tmp_path / "m.json").read_text())
    gaps, currents = (np.array(content["axes"][name]) for name in ("gap_m", "I_A"))
    rising, falling = (np.array(content[f"F_N_{way}"]) for way in ("rising", "falling"))
    assert rising.shape == falling.shape == (gaps.size, currents.size)
    assert (falling - rising).min() > -1e-6
    assert (falling - rising).max() > 5.0
    path = np.concatenate([currents, currents[::-1]])
    assert np.allclose(model(path, gaps[4], history="settled")[: currents.size], rising[4])
    table = np.genfromtxt(export_tables(model, tmp_path / "m.csv"), delimiter=",", names=True)
    assert np.array_equal(table["F_N_rising"], rising.ravel())
    assert np.array_equal(table["gap_m"], np.repeat(gaps, currents.size))
