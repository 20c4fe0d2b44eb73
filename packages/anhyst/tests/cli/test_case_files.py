"""Files of other users are read correctly, or rejected with the reason; see shared/cases."""

from __future__ import annotations

import json
import re
import runpy
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from .command import Result, quick

KILOGRAM_FORCE = 9.80665


@pytest.fixture
def case(cases: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Copy a case into its own folder, or let its script write it."""

    def bring(name: str) -> Path:
        source = cases / name
        if source.suffix == ".py":
            monkeypatch.chdir(tmp_path)
            runpy.run_path(str(source))
        elif source.is_dir():
            shutil.copytree(source, tmp_path / name)
        else:
            shutil.copy(source, tmp_path)
        return tmp_path

    return bring


def inspected(name: str, folder: Path, *options: str) -> dict[str, Any]:
    completed = quick("inspect", name, "--json", *options, cwd=folder)
    assert completed.returncode == 0, completed.stderr
    found: dict[str, Any] = json.loads(completed.stdout)
    found["said"] = " ".join([*found["warnings"], *found["notes"], *found["repairs"], completed.stderr])
    return found


def identified(name: str, folder: Path, *options: str, code: int = 0) -> tuple[dict[str, Any], Result]:
    completed = quick("identify", name, "--out", "model.toml", "--json", *options, cwd=folder)
    assert completed.returncode == code, completed.stderr
    return (json.loads(completed.stdout) if completed.stdout else {}), completed


def proposal(message: str) -> str:
    """Return the value of the first --columns that a message proposes."""
    found = re.search(r"--columns (?:\"([^\"]*)\"|'([^']*)'|(\S+))", message)
    return next(filter(None, found.groups()), "") if found else ""


@pytest.mark.parametrize(
    ("name", "largest_percent"), [("square_steel_ev0.csv", 2.0), ("two_temperatures.csv", 0.1)]
)
def test_identify_fits_case_files_within_their_stated_error(
    case: Any, name: str, largest_percent: float
) -> None:
    found, _ = identified(name, case(name))
    assert 100.0 * found["fit"]["rms"] / found["fit"]["largest_output"] < largest_percent


def test_even_output_is_refused(case: Any) -> None:
    folder = case("butterfly.csv")
    for verb in (["inspect"], ["identify", "--out", "model.toml"]):
        completed = quick(verb[0], "butterfly.csv", *verb[1:], cwd=folder)
        assert completed.returncode == 2
        assert "even" in completed.stderr


def test_resonance_is_named_and_is_a_negative_result(case: Any) -> None:
    folder = case("resonance.csv")
    verdict = inspected("resonance.csv", folder)["verdict"]
    assert "resonates" in " ".join(verdict["sentences"])
    _, done = identified("resonance.csv", folder, code=1)
    frequency_Hz = float(re.search(r"([\d.]+) Hz", done.stderr)[1])  # type: ignore[index]
    assert frequency_Hz == pytest.approx(35.0, rel=0.1)
    assert "the fit is complete" not in done.stdout


def test_full_scale_is_that_of_identify_and_predict(case: Any) -> None:
    folder = case("displacement_offset.csv")
    found, _ = identified("displacement_offset.csv", folder)
    completed = quick(
        "predict", "model.toml", "displacement_offset.csv", "--out", "x.csv", "--json", cwd=folder
    )
    assert completed.returncode == 0, completed.stderr
    deviation = json.loads(completed.stdout)["deviation"]
    assert deviation["largest"] == pytest.approx(found["fit"]["largest_output"], rel=1e-6)
    assert deviation["rms"] == pytest.approx(found["fit"]["rms"], rel=0.05)


def test_clipped_force_is_not_a_delay(case: Any) -> None:
    found = inspected("floored_force.csv", case("floored_force.csv"))
    assert "lags" not in found["said"]
    assert not found["loops"][0]["skew_samples"]


def test_ripple_of_a_pwm_amplifier_is_filtered(case: Any) -> None:
    folder = case("make_pwm.py")
    found = inspected("pwm0.1.csv", folder)
    assert found["verdict"]["width_A"] == pytest.approx(0.28, abs=0.03)
    assert "ripple" in found["said"]
    identified("pwm0.1.csv", folder)


def test_input_offset_is_unbiased(case: Any) -> None:
    folder = case("make_offset_noise.py")
    for noise in ("0.5", "2", "5"):
        identified(f"offset_{noise}mA.csv", folder, "--history", "settled")
        text = (folder / "model.toml").read_text()
        value = float(re.search(r"(?m)^I_0_A *= ([-\d.e]+)", text)[1])  # type: ignore[index]
        assert value == pytest.approx(0.012, abs=0.001), noise


def test_delay_is_found_in_seconds(case: Any) -> None:
    found = inspected("delay10ms.csv", case("delay10ms.csv"))
    assert found["loops"][0]["skew_s"] == pytest.approx(0.010, rel=0.05)
    assert "10" in found["said"]
    assert "ms" in found["said"]


def test_gaps_come_from_file_names(case: Any) -> None:
    found = inspected("german", case("german"))
    gaps = [0.5e-3, 0.8e-3, 1.2e-3, 1.8e-3]
    assert found["schedule_values"] == pytest.approx(gaps)
    assert "file name" in found["said"]


def test_noisy_plateaus_are_gaps(case: Any) -> None:
    found = inspected("stepping.csv", case("stepping.csv"))
    assert len(found["schedule_values"]) == 4


def test_hole_in_the_clock_is_named(case: Any) -> None:
    assert "missing" in inspected("missing.csv", case("missing.csv"))["said"]


def test_worst_error_contradicts_no_verdict(case: Any) -> None:
    folder = case("voltage.csv")
    completed = quick("identify", "voltage.csv", "--out", "model.toml", cwd=folder)
    assert completed.returncode in {0, 1}
    assert "the fit is complete" not in completed.stdout


@pytest.mark.parametrize(("name", "column"), [("force_kgf.csv", 2), ("force_kg.csv", 2)])
def test_kilograms_are_read_as_force(case: Any, name: str, column: int) -> None:
    folder = case(name)
    kilograms = np.genfromtxt(folder / name, delimiter=",", skip_header=1)[:, column]
    found = inspected(name, folder)
    largest = max(loop["output_high_N"] for loop in found["loops"])
    assert largest == pytest.approx(KILOGRAM_FORCE * kilograms.max(), rel=1e-6)


@pytest.mark.parametrize("name", ["scope_time_ch1_ch2.csv", "tout_yout.mat"])
def test_clock_is_no_signal(case: Any, name: str) -> None:
    folder = case(name)
    completed = quick("inspect", name, cwd=folder)
    columns = proposal(completed.stderr)
    assert not re.search(r"(?i)\b(time|tout|t)=(I|F)_", columns)
    if completed.returncode == 2:
        assert columns.index("=I_A") < columns.index("=F_N")


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("catman_names_above.txt", ()),
        ("labview.lvm", ()),
        ("comsol_percent.csv", ()),
        ("rigol_start_increment.csv", ("--columns", "CH1=I_A,CH2=F_N", "--scale", "CH1=1,CH2=1")),
        ("comma_in_header.csv", ("--columns", '"Current, coil (A)"=I_A,"Force, z component (N)"=F_N')),
        ("invalid_samples.mf4", ("--columns", "I=I_A,F=F_N", "--drop", "invalid")),
        ("mdf4_named.mdf", ("--columns", "I=I_A,F=F_N")),
    ],
)  # fmt: skip
def test_layouts_of_loggers_are_read(case: Any, name: str, options: tuple[str, ...]) -> None:
    found = inspected(name, case(name), *options)
    assert found["samples"] >= 1000
    assert max(loop["input_high_A"] for loop in found["loops"]) > 1.0


def test_overrange_samples_are_skipped_and_counted(case: Any) -> None:
    folder = case("scope_overrange.csv")
    options = ("--columns", "Channel A=I_A,Channel B=F_N", "--scale", "Channel A=1,Channel B=1")
    refused = quick("inspect", "scope_overrange.csv", *options, cwd=folder)
    assert refused.returncode == 2
    assert "--drop invalid" in refused.stderr
    found = inspected("scope_overrange.csv", folder, *options, "--drop", "invalid")
    count = (folder / "scope_overrange.csv").read_text(encoding="utf-8").count("∞")
    assert re.search(rf"\b{count} ", found["said"])


def test_settings_next_to_the_data_are_read_or_reported(case: Any) -> None:
    completed = quick("inspect", "scope_metadata_beside_data.csv", cwd=case("scope_metadata_beside_data.csv"))
    assert "1200=I_A" not in completed.stderr


def test_branches_in_one_direction_are_refused(case: Any) -> None:
    completed = quick("inspect", "first_quadrant.csv", cwd=case("first_quadrant.csv"))
    assert completed.returncode == 2
    assert "both branches in one direction" in completed.stderr
