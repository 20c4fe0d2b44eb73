"""Models that are identified with default options can be compiled, even with a strong coupling."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from anhyst.model.actuator import least_slope, read_model
from anhyst.verification import verify
from tests.cli.command import quick
from tests.foreign.magnets import MAGNETS

RING_FIELD = 4000.0
"""Largest field, A/m, about four times the coercivity of the iron of the magnet ``hard``."""


def ring_loops() -> str:
    """Return nested B-H loops of a closed ring of the iron of the magnet ``hard``."""
    lines = ["loop,H_A_per_m,B_T"]
    for number, part in enumerate((1.0, 0.6, 0.35), start=1):
        iron = MAGNETS["hard"].make_iron()
        rise = np.linspace(-1.0, 1.0, 121) * part * RING_FIELD
        cycle = np.concatenate([rise, rise[-2:0:-1]])
        for _ in range(2):  # the second is settled
            flux_density = [iron.move(0.1 * field, 0.1, 1e-6) for field in cycle]
        lines += [f"{number},{field:.6g},{b:.6g}" for field, b in zip(cycle, flux_density, strict=True)]
    return "\n".join(lines) + "\n"


@pytest.fixture(scope="module")
def ring(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder with the identified ring, ``ring.toml``."""
    folder = tmp_path_factory.mktemp("ring")
    (folder / "ring.csv").write_text(ring_loops())
    # A dead band would make the law so steep after a reversal that the flux arm is not negative.
    arguments = ("ring.csv", "--history", "settled", "--no-dead-band", "--out", "ring.toml")
    result = quick("identify", *arguments, cwd=folder)
    assert result.returncode == 0, result.stderr
    assert "cannot be compiled" not in result.stderr
    return folder


@pytest.fixture
def _one_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("anhyst.verification.targets.HOST_COMPILERS", {"gcc": "gcc"})
    monkeypatch.setattr("anhyst.verification.targets.OPTIMISATIONS", ("-O2",))


def check_bits(folder: Path, targets: str = "host,cortex-m4") -> None:
    """Compare a compiled core on this machine, under sanitizers and on a Cortex-M4, bit for bit."""
    found = verify(folder, targets, host_steps=50_000, target_steps=5_000)
    assert found.passed, found.first_failure()
    assert len(found.results) == 2 * len(targets.split(","))


def worst_percent(folder: Path) -> float:
    budget = json.loads((folder / "budget.json").read_text())
    return float(budget["compiled"]["worst_percent"])


@pytest.mark.slow
@pytest.mark.needs("gcc")
@pytest.mark.usefixtures("_one_compiler")
def test_a_core_that_couples_more_than_its_gap_compiles_and_verifies(ring: Path) -> None:
    slope = least_slope(read_model(ring / "ring.toml"), np.zeros(1))[0]
    assert 0.0 < slope < 1.0  # so that the flux arm is negative
    arguments = ("ring.toml", "--kind", "full", "--io", "q15", "--rate", "2e4")
    result = quick("compile", *arguments, "--out", "c", cwd=ring)
    assert result.returncode == 0, result.stderr
    assert worst_percent(ring / "c") < 0.5
    check_bits(ring / "c")


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["full", "simplified"])
@pytest.mark.parametrize("io", ["q31", "f32"])
def test_every_kind_and_format_of_it_compiles(ring: Path, kind: str, io: str) -> None:
    out = f"{kind}-{io}"
    arguments = ("ring.toml", "--kind", kind, "--io", io, "--rate", "2e4", "--out", out)
    result = quick("compile", *arguments, cwd=ring)
    assert result.returncode == 0, result.stderr
    assert kind == "simplified" or worst_percent(ring / out) < 0.5


MEASURED: dict[str, tuple[str, tuple[str, ...], float]] = {
    "MnZn ferrite": ("ferrite_mnzn/mnzn_ferrite_3loops.csv", (), 0.1),
    "MnZn ferrite, 4 loops": ("ferrite_mnzn/mnzn_ferrite_4loops.csv", (), 0.1),
    "MnZn ferrite, hp": ("ferrite_mnzn/mnzn_hp_ferrite_4loops.csv", (), 0.1),
    "solid steel": ("steel_core1_dc/loops.csv", ("--loop", "nominal_Hmax_A_per_m"), 1.0),
    "M130": ("steel_m130_27s/m130_27s_steel_raw_3loops.csv", (), 1.0),
    "M130, symmetrised": ("steel_m130_27s/m130_27s_steel_symmetrised_3loops.csv", (), 1.0),
    "TEAM 32": ("steel_team32/loops.csv", ("--loop", "bmax_T"), 1.0),
    "ferrite core over gaps": (
        "ferrite_core_gaps/loops_by_gap.csv",
        ("--columns", "I_A_scaled=I_A,U_M_V=psi_Wb", "--output", "flux_linkage"),
        0.1,
    ),
    "gadolinium": ("gadolinium_temperature/gd_T-025C.csv", (), 0.1),
}
"""File, options of identify, and allowed error of the compiled law, %; larger close to a jump."""


REPEATS = {"MnZn ferrite, 4 loops", "MnZn ferrite, hp", "M130", "M130, symmetrised"}
"""The same material again, or a similar one."""


@pytest.mark.slow
@pytest.mark.needs("gcc")
@pytest.mark.usefixtures("_one_compiler")
@pytest.mark.parametrize(
    "name", [pytest.param(one, marks=[pytest.mark.campaign] * (one in REPEATS)) for one in MEASURED]
)
def test_measured_cores_without_a_jump_compile_and_verify(
    measurements: Path, tmp_path: Path, name: str
) -> None:
    file, options, largest = MEASURED[name]
    arguments = (measurements / file, *options, "--out", "model.toml")
    result = quick("identify", *arguments, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "cannot be compiled" not in result.stderr
    result = quick("compile", "model.toml", "--rate", "2e4", "--out", "c", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert worst_percent(tmp_path / "c") < largest
    check_bits(tmp_path / "c", "host")
