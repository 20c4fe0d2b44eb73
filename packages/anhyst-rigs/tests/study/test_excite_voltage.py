"""Test that ``excite --voltage`` keeps its limits and that its records contain the flux linkage."""

from __future__ import annotations

import math
import shutil
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from anhyst.data.reading import read_loops
from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.force.file import read_rig as read_force_rig
from anhyst_rigs.study.excite.design import MAX_WARMTH, Specimen
from anhyst_rigs.study.excite.excite import Excitation, excite, read_specimen, write_excitation
from anhyst_rigs.study.excite.voltage import design_voltage_record, measure_voltage, plan_voltage
from anhyst_rigs.study.force_control import force_control
from tests.refusals import refused
from tests.study.measured_rigs import measured_rig

RESISTANCE, CONTINUOUS_A, THERMAL_S, RISE_K = 12.0, 0.3, 60.0, 60.0
VOLTAGE_SENSOR = """
[[sensor]]
of = "voltage"
range_V = 30.0
adc_bits = 16
noise_V = 0.005
offset_V = 0.003
"""
EXCITE = f"""
[excite]
current_low_A = -1.2
continuous_A = {CONTINUOUS_A}
thermal_s = {THERMAL_S}
rise_K = {RISE_K}
"""


def solenoid(
    folder: Path, lines: str = VOLTAGE_SENSOR + EXCITE, resistance: str = "resistance_ohm = 12.0"
) -> Path:
    """Copy the bundled solenoid, with a measured voltage and the resistance of its winding."""
    path = measured_rig("solenoid", folder, extra_lines=lines).path
    file = folder / "solenoid.toml"
    text = file.read_text(encoding="utf-8").replace("[circuit]", f"[circuit]\n{resistance}")
    file.write_text(text, encoding="utf-8")
    return path


def true_psi(specimen: Specimen, gap: float) -> FloatArray:
    """Return the flux linkage along the record of a gap, Wb."""
    assert specimen.held_rig is not None
    (record,) = design_voltage_record(specimen, specimen.max_current.value)
    magnet = specimen.held_rig.magnet()
    for reversal in record.approach_reversals:
        magnet.hold(reversal, gap)
    return magnet.run(record.path, np.full(record.path.size, gap))[:, 1]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("voltage")


@pytest.fixture(scope="module")
def measured(folder: Path) -> Excitation:
    return excite(solenoid(folder), folder / "coil.csv", measure=measure_voltage)


def test_record_stays_within_the_limits_of_current_rate_and_heat(measured: Excitation) -> None:
    """Current, its rate and the warmth of the winding never exceed the limits of the rig file."""
    drive, specimen = measured.drive_history, measured.specimen
    assert np.abs(drive.current).max() <= specimen.max_current.value * (1.0 + 1e-9)
    largest_rate = np.abs(np.diff(drive.current)).max() / specimen.sample_s
    assert largest_rate <= specimen.max_rate.value * (1.0 + 1e-9)
    assert 0.02 < drive.warmth.max() <= MAX_WARMTH


def test_gaps_are_four_in_a_geometric_sequence(measured: Excitation) -> None:
    """The gaps include both ends of the range, and their ratios are equal to the feeler gauge's step."""
    gaps = np.array(measured.loops.schedule_values)
    assert gaps.size == 4
    assert gaps[0] == 1.0e-3
    assert gaps[-1] == 2.8e-3
    ratios = gaps[1:] / gaps[:-1]
    assert ratios == pytest.approx(math.pow(2.8, 1.0 / 3.0), rel=0.01)
    assert any("3 determine the reluctance of the gap" in note for note in measured.notes)


def test_flux_linkage_follows_from_the_recorded_voltage(measured: Excitation, folder: Path) -> None:
    """The file gives the flux linkage to 0.6 % of its largest value, 0.15 % rms, from 0 at the first sample."""
    loops = read_loops(folder / "coil.csv")
    assert loops.output.name == "flux_linkage"
    for loop in loops:
        assert loop.history.kind == "demagnetised"
        assert loop.schedule_value is not None
        psi = true_psi(measured.specimen, loop.schedule_value)
        error = (loop.output - psi) / psi.max()
        assert np.abs(error).max() < 6e-3
        assert np.std(error) < 1.5e-3


def test_winding_warms_by_its_losses(measured: Excitation) -> None:
    """While the peak is held, the voltage follows the resistance at the warmth of the winding."""
    loop, drive = measured.loops[0], measured.drive_history
    assert loop.time is not None
    current, warmth = (np.interp(loop.time, drive.time, values) for values in (drive.current, drive.warmth))
    held = np.flatnonzero((current == current.max()) & (np.gradient(current) == 0.0))
    assert held.size > 200
    expected = RESISTANCE * (1.0 + 3.93e-3 * RISE_K * warmth[held])
    offset = 0.003 / current.max()
    assert np.median(loop.output[held] / current.max() - expected) == pytest.approx(offset, abs=1e-3)
    assert np.mean(expected) > 1.01 * RESISTANCE


def test_sense_coil_has_its_own_column_and_turns(tmp_path: Path) -> None:
    """The voltage of a sense coil has no resistive part, and the sidecar states both numbers of turns."""
    rig = solenoid(
        tmp_path, VOLTAGE_SENSOR.replace("30.0", "2.0").replace("0.005", "0.0002") + "turns = 50\n" + EXCITE
    )
    result = excite(rig, tmp_path / "coil.csv", measure=measure_voltage)
    constants = tomllib.loads((tmp_path / "coil.toml").read_text(encoding="utf-8"))["constants"]
    assert constants == {"turns": 900, "sense_turns": 50}
    header = (tmp_path / "coil.csv").read_text(encoding="utf-8").splitlines()[0]
    assert "u_sense_V" in header.split(",")
    for loop in read_loops(tmp_path / "coil.csv"):
        assert loop.schedule_value is not None
        psi = true_psi(result.specimen, loop.schedule_value)
        assert np.abs(loop.output - psi).max() < 6e-3 * psi.max()


def test_unipolar_source_leaves_the_zero_unknown(tmp_path: Path) -> None:
    """Without negative currents, records begin conditioned, and a note states the consequence."""
    result = excite(solenoid(tmp_path, VOLTAGE_SENSOR), tmp_path / "coil.csv", measure=measure_voltage)
    assert {loop.history.kind for loop in result.loops} == {"conditioned"}
    assert any("excite.current_low_A" in note for note in result.notes)


@pytest.mark.parametrize(
    ("lines", "resistance", "expected"),
    [
        (EXCITE, "resistance_ohm = 12.0", "missing sensor: rig.toml; --voltage"),
        (VOLTAGE_SENSOR, "", "missing circuit.resistance_ohm: rig.toml; --voltage"),
        (
            f"{VOLTAGE_SENSOR}[excite]\ngaps_m = [1e-3, 2e-3]\n",
            "resistance_ohm = 12.0",
            "too-few-gaps excite.gaps_m: rig.toml",
        ),
        (
            f"{VOLTAGE_SENSOR}[excite]\nforce_max_N = 20.0\n",
            "resistance_ohm = 12.0",
            "option-not-for-this excite.force_max_N: rig.toml",
        ),
    ],
)
def test_plan_refuses_what_it_cannot_measure(
    tmp_path: Path, lines: str, resistance: str, expected: str
) -> None:
    """A missing sensor, an unknown resistance, too few gaps and a force limit are refused with the remedy."""
    rig = solenoid(tmp_path, lines, resistance)
    with refused(expected):
        excite(rig, tmp_path / "coil.csv", measure=measure_voltage)
    assert not (tmp_path / "coil.csv").exists()


def test_ramp_is_as_long_as_the_time_constant_requires(tmp_path: Path) -> None:
    """In a ramp, the flux linkage changes by a quarter of the resistive volt-seconds, or the rate is at its limit."""
    specimen = plan_voltage(read_specimen(solenoid(tmp_path)).specimen)
    ramp_s = specimen.max_current.value / specimen.sweep_rate
    psi = true_psi(specimen, min(specimen.gaps)).max()
    assert ramp_s * RESISTANCE * specimen.max_current.value == pytest.approx(4.0 * psi, rel=0.05)


@pytest.mark.slow
def test_controller_from_voltage_alone_follows_the_true_force(tmp_path: Path) -> None:
    """Excite, identify, compile and control without a force sensor: 1.5 % held, 3 % moving, of F_max."""
    rig = Path(shutil.copy(Path(__file__).with_name("electromagnet.toml"), tmp_path / "rig.toml"))
    excite(rig, tmp_path / "coil.csv", measure=measure_voltage)
    summary = force_control(rig, tmp_path / "run").figures["summary"]
    held = [summary[stage]["full"]["worst_percent"] for stage in ("end", "end_demagnetised", "positions")]
    assert max(held) < 1.5
    moving = summary["moving"]
    assert moving["full"]["worst_percent"] < 3.0
    assert moving["full"]["of_single"] < 0.4


def test_rig_refuses_flux_linkage_at_two_gaps(tmp_path: Path) -> None:
    """A rig whose loops of flux linkage do not give the force names the missing gaps."""
    rig = Path(shutil.copy(Path(__file__).with_name("electromagnet.toml"), tmp_path / "rig.toml"))
    result = excite(rig, tmp_path / "coil.csv", measure=measure_voltage)
    kept = result.loops.schedule_values[:2]
    write_excitation(replace(result, loops=result.loops.at(kept)), rig, tmp_path / "coil.csv")
    with refused("force-not-derived: coil.csv; 2 gaps"):
        read_force_rig(rig).measured_loops.read()
