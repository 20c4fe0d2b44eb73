"""Test a stage whose flux is estimated from the voltage of a coil instead of a Hall probe."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from anhyst.support.errors import InputError
from anhyst.support.kinds import MethodName
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.loop import Scenario, SimulatedLoop
from anhyst_rigs.rig.stage.file import read_stage
from anhyst_rigs.rig.stage.fitted import identify_stage_magnet, make_stage
from anhyst_rigs.rig.stage.loop import Feedforward, track
from anhyst_rigs.rig.stage.setpoint import scan_motion
from anhyst_rigs.study.tracking.gains import find_gains
from anhyst_rigs.study.tracking.measures import measure

EXAMPLE = Path(__file__).parents[4] / "examples" / "stage"
SENSE = 'of = "voltage"\nturns = 50\nrange_V = 40.0\nadc_bits = 20\nnoise_V = 0.0002\n'
WINDING = 'of = "voltage"\nrange_V = 160.0\nadc_bits = 20\nnoise_V = 0.001\n'
PROBE = 'of = "flux"'


def coil_stage(folder: Path, sensor: str, number_format: str = "fixed", keeps_probe: bool = False) -> BodyRig:
    """Return the example with the voltage of a coil instead of the Hall probe."""
    first, *sensors = (EXAMPLE / "rig.toml").read_text(encoding="utf-8").split("[[sensor]]")
    kept = [text for text in sensors if keeps_probe or PROBE not in text]
    text = "[[sensor]]".join([first, *kept[:1], f"\n{sensor}\n", *kept[1:]])
    shutil.copytree(EXAMPLE, folder / "stage")
    path = folder / "stage" / "rig.toml"
    path.write_text(text.replace('format = "fixed"', f'format = "{number_format}"'), encoding="utf-8")
    return read_stage(path)


@pytest.mark.parametrize("sensor", [SENSE, WINDING])
def test_the_plant_reads_the_mean_voltage_of_a_tick(tmp_path: Path, sensor: str) -> None:
    """The mean is the change of the flux linkage per tick, and for a winding the ohmic drop."""
    rig = coil_stage(tmp_path, f"{sensor}offset_V = 0.005\n")
    setup = make_stage(rig, identify_stage_magnet(rig), "fused")
    scenario = Scenario(np.zeros(400), feed=np.full(400, 30.0))
    run = SimulatedLoop(setup, 1).run(scenario).columns
    flux, current, read = run["flux_Wb"], run["current_A"], run["flux_read_T"]
    induced = np.diff(flux) / rig.dt
    mean = induced / 5.0 if sensor is SENSE else induced + 0.6 * (current[1:] + current[:-1])
    settled = slice(200, None)
    error = (read[1:] - mean)[settled]
    assert abs(error.mean() - 0.005) < 2e-3
    assert error.std() < 0.02


def test_a_stage_has_one_sensor_of_the_flux(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="the flux has one sensor"):
        coil_stage(tmp_path, SENSE, keeps_probe=True)


def test_a_coil_is_not_calibrated_online(tmp_path: Path) -> None:
    rig = coil_stage(tmp_path, SENSE)
    text = rig.path.read_text(encoding="utf-8").replace("[control]", "[control]\ncalibrate = true")
    rig.path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match="online calibration needs a Hall probe"):
        read_stage(rig.path)


def test_a_recording_contains_the_voltage(tmp_path: Path) -> None:
    rig = coil_stage(tmp_path, SENSE)
    setup = make_stage(rig, identify_stage_magnet(rig), "fused")
    run = track(setup, scan_motion(rig.settings.scan, [22.0]), Feedforward(), 1)
    assert {"coil_read_V", "coil_read_2_V"} <= set(run.columns)
    assert "flux_read_T" not in run.columns


def test_the_formats_agree_in_the_loop(tmp_path: Path) -> None:
    errors = []
    for number_format in ("fixed", "f64"):
        rig = coil_stage(tmp_path / number_format, SENSE, number_format)
        setup = make_stage(rig, identify_stage_magnet(rig), "fused")
        motion = scan_motion(rig.settings.scan, rig.settings.scan.test_m_per_s2)
        errors.append(track(setup, motion, Feedforward(), 1)["error_m"])
    assert np.abs(errors[0] - errors[1]).max() < 20e-9


@pytest.mark.slow
@pytest.mark.parametrize(("sensor", "peak", "average"), [(SENSE, 100e-9, 6.5e-9), (WINDING, 100e-9, 20e-9)])
def test_a_coil_replaces_the_hall_probe_of_fused(
    tmp_path: Path, sensor: str, peak: float, average: float
) -> None:
    """A Hall probe leaves 67 and 5.4 nm."""
    rig = coil_stage(tmp_path, sensor)
    setup, scan = make_stage(rig, identify_stage_magnet(rig), "fused"), rig.settings.scan
    gains, motion = (
        find_gains(setup, scan_motion(scan, scan.train_m_per_s2)),
        scan_motion(scan, scan.test_m_per_s2),
    )
    measures = [measure(track(setup, motion, gains, seed), motion, scan.slit_s) for seed in (1, 2, 3)]
    assert np.mean([each.peak_m for each in measures]) < peak
    assert np.mean([each.average_m for each in measures]) < average


@pytest.mark.slow
@pytest.mark.parametrize("method", ["flux", "fused"])
@pytest.mark.parametrize(
    "fault", ["resistance_error = -0.2\n", "resistance_error = 0.2\n", "offset_V = 0.005\n"]
)
def test_a_wrong_resistance_or_offset_does_not_lose_the_loop(
    tmp_path: Path, method: MethodName, fault: str
) -> None:
    """Five repetitions of the test set-point."""
    rig = coil_stage(tmp_path, WINDING + fault if "resistance" in fault else SENSE + fault)
    setup, scan = make_stage(rig, identify_stage_magnet(rig), method), rig.settings.scan
    motion = scan_motion(scan, scan.test_m_per_s2 * 5)
    assert track(setup, motion, Feedforward(), 1).loss is None
