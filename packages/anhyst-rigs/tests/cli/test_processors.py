"""The same files, seed and version give the same model and recordings on every processor."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from anhyst._core import batch_levels
from anhyst.identification.screening import INSTRUCTION_SET_VARIABLE
from anhyst.model.actuator import read_model
from anhyst.model.writer import write_model
from tests.repository import ROOT
from tests.study import bearings

from .command import anhyst

LOOPS = ROOT / "examples" / "electromagnet" / "loops.csv"
OPENBLAS = {"base": "Prescott", "avx2": "Haswell", "avx512": "SkylakeX"}
"""Core type that OpenBLAS would choose on a processor of each level."""


def variables(level: str) -> dict[str, str]:
    """Return environment variables that limit this processor to the features of a lower level."""
    found = np.show_config("dicts")["SIMD Extensions"].get("found", [])
    beyond = {"base": found, "avx2": [one for one in found if "512" in one or "V4" in one]}
    chosen = {
        INSTRUCTION_SET_VARIABLE: level,
        "OPENBLAS_CORETYPE": OPENBLAS[level],
        "NPY_DISABLE_CPU_FEATURES": " ".join(beyond.get(level, [])),
    }
    if level == "base":
        chosen["GLIBC_TUNABLES"] = "glibc.cpu.hwcaps=-AVX2,-FMA"
    return chosen


@pytest.mark.slow
def test_every_processor_finds_the_same_model_to_1e_9(tmp_path: Path) -> None:
    current = np.concatenate([np.linspace(0.0, 4.0, 200), np.linspace(4.0, 0.5, 200)])
    forces = []
    for level in batch_levels():
        out = tmp_path / f"{level}.toml"
        asked = ("identify", LOOPS, "--law", "play-cells", "--out", out)
        completed = anhyst(*asked, cwd=tmp_path, variables=variables(level))
        assert completed.returncode == 0, completed.stderr
        forces.append(read_model(out).predict(current, 0.45e-3, history="demagnetised").output)
    for force in forces[1:]:
        assert np.max(np.abs(force - forces[0])) < 1e-9 * np.max(forces[0])


KIND = {"cells": 'kind = "electromagnet"', "law": 'kind = "law"\nmodel = "magnet.toml"'}
SHORT = {
    "also_gaps_m = [0.42e-3, 0.48e-3]": "also_gaps_m = []",
    "heights_m = [10e-6, 20e-6, 50e-6, 100e-6]": "heights_m = [20e-6]",
    "frequency_Hz = 1.0": "frequency_Hz = 10.0",
    "noise_seeds = 20": "noise_seeds = 2",
}


def write_files(folder: Path, force: str) -> None:
    """Write the shortened example with one model for all processors."""
    rig = (bearings.EXAMPLE / "rig.toml").read_text()
    for old, new in {**SHORT, KIND["cells"]: KIND[force]}.items():
        assert rig.count(old) == 1, old
        rig = rig.replace(old, new)
    wave = """
[[load.disturbance]]
kind = "sine"
force_N = 2.0
frequency_Hz = 33.0
"""
    (folder / "rig.toml").write_text(rig + wave)
    controller = (bearings.EXAMPLE / "controller.toml").read_text()
    own = 'variant = "full"'
    assert controller.count(own) == 1
    controller = controller.replace(own, f'{own}\nmodel = "model.toml"')
    (folder / "controller.toml").write_text(controller)
    for name in ("loops.csv", "loops.toml"):
        shutil.copy(bearings.EXAMPLE / name, folder)
    for name in ("model.toml", "magnet.toml"):
        write_model(bearings.knowledge().model, folder / name)


def leaves(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield every value of a JSON file with its path."""
    if isinstance(value, dict | list):
        for key, one in value.items() if isinstance(value, dict) else enumerate(value):
            yield from leaves(one, f"{path}/{key}")
    else:
        yield path, value


def expected(path: str, value: Any) -> Any:
    """Approximate value: 1e-9, but 3e-5 for the frequency of a peak, because the peak is flat."""
    if not isinstance(value, float):
        return value
    return pytest.approx(value, rel=3e-5 if path.endswith("peak_frequency") else 1e-9, abs=0.0)


@pytest.mark.slow
@pytest.mark.parametrize("force", ["cells", pytest.param("law", marks=pytest.mark.campaign)])
def test_every_processor_records_the_same_run_bit_for_bit(force: str, tmp_path: Path) -> None:
    write_files(tmp_path, force)
    recordings, figures = [], []
    levels = batch_levels()
    for level in dict.fromkeys((levels[0], levels[-1])):
        out = tmp_path / level
        out.mkdir()
        completed = anhyst(
            "simulate", "rig.toml", "--out", out / "run.csv", cwd=tmp_path, variables=variables(level)
        )
        assert completed.returncode == 0, completed.stderr
        recordings.append((out / "run.csv").read_bytes())
        figures.append(dict(leaves(json.loads((out / "figures.json").read_text()))))
    for recording, found in zip(recordings[1:], figures[1:], strict=True):
        assert recording == recordings[0]
        assert found == {path: expected(path, value) for path, value in figures[0].items()}
