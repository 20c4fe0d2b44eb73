"""Load the libraries for Windows, which have no start-up code, on this machine and step them."""

from __future__ import annotations

import platform
import subprocess
import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

import anhyst
from anhyst.support.numeric import FloatArray
from anhyst_exchange import stage_part
from anhyst_exchange.exporter import ExportedPart, compile_all, export_fmu
from tests.core.test_c_core import run_command, tool
from tests.exchange import test_piezo
from tests.exchange.conftest import Fmu
from tests.exchange.slave import RATE, fmpy, needs_binary, slave
from tests.exchange.test_actuator import drives, gaps, magnet
from tests.exchange.test_bearing import PLANAR
from tests.exchange.test_fmu import GAP, demands
from tests.once import made_once
from tests.study import bearings

pytestmark = [
    needs_binary,
    pytest.mark.skipif(platform.machine() != "x86_64", reason="Windows is built for x86-64"),
]

WINDOWS = "x86_64-windows"
LOADER = Path(__file__).with_name("windows") / "load.c"


@pytest.mark.slow
@pytest.mark.parametrize("of", ["actuator", "compensator"])
def test_the_library_for_windows_gives_the_same_bits(
    of: ExportedPart, fmu: Fmu, identified: anhyst.Model, tmp_path: Path
) -> None:
    if of == "actuator":
        model = magnet("play-cells", "reluctance")
        inputs = {"current": drives(model, 300), "gap": gaps(model, 300)}
        output, step = "force", 1e-4
    else:
        model = identified
        inputs = {"demand": demands(300), "gap": np.full(300, GAP)}
        output, step = "current", 1.0 / RATE
    found = in_both(fmu(model, of, "2.0"), inputs, output, step, tmp_path)
    assert np.ptp(found) > 1.0


@pytest.mark.slow
def test_the_windows_library_of_a_piezo_stage_gives_the_same_bits(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = made_once(tmp_path_factory, "fmu-piezo", test_piezo.made) / "2.fmu"
    expected = test_piezo.part(0, 300)["reference_m"]
    inputs = {"reference_m": expected, "load_m": np.linspace(0.0, 1e-6, expected.size)}
    found = in_both(path, inputs, "position_m", test_piezo.TICK, tmp_path)
    assert np.ptp(found) > 1e-5


def in_both(
    path: Path, inputs: Mapping[str, FloatArray], output: str, step: float, tmp_path: Path
) -> list[float]:
    """Return an output of the libraries of an FMU for Windows and for this machine."""
    with zipfile.ZipFile(path) as archive:
        archive.extractall(tmp_path)
    library = tmp_path / "anhyst.dll"
    library.write_bytes(compile_all(tmp_path / "sources", "anhyst", [WINDOWS], None)[WINDOWS])
    loader = tmp_path / "load"
    run_command(
        *(tool("cc", "gcc", "clang"), "-std=gnu99", "-Wall", "-Wextra", "-Werror", "-Wno-pedantic"),
        *(str(LOADER), "-o", str(loader), "-lm"),
    )
    about = fmpy.read_model_description(path)
    (reference,) = (one.valueReference for one in about.modelVariables if one.name == output)
    rows = zip(*(values.tolist() for values in inputs.values()), strict=True)
    completed = subprocess.run(
        [loader, library, about.guid, repr(step), str(reference)],
        input="\n".join(" ".join(map(repr, row)) for row in rows),
        capture_output=True,
        text=True,
        check=False,
    )
    assert completed.returncode == 0, completed.stderr
    with slave(path, tmp_path) as made:
        expected = [row[0] for row in made.run(inputs, [output], step)]
    assert list(map(float, completed.stdout.split())) == expected
    return expected


@pytest.mark.slow
def test_a_stage_of_ten_magnets_is_linked_for_windows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stage_part, "identify_stage_magnet", lambda _: bearings.knowledge())
    fmu = export_fmu(PLANAR, tmp_path / "p.fmu", platforms=[WINDOWS])
    with zipfile.ZipFile(fmu) as archive:
        assert archive.read("binaries/win64/anhyst.dll")[:2] == b"MZ"
