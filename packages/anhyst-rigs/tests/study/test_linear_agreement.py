"""Test that the simulated loop of an iron without hysteresis equals the linear loop."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from anhyst.compensate.methods import make_compensator
from anhyst.compensate.sources import Sources
from anhyst.control import Pidd2
from anhyst.control.controller_file import read_controller
from anhyst.data.reading import read_loops
from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.bearing.loop import BearingSetup, operating_point
from anhyst_rigs.rig.bearing.scenario import ScenarioBuilder
from anhyst_rigs.rig.body import BodyRig, read_bearing
from anhyst_rigs.rig.loop import SimulatedLoop as Running
from anhyst_rigs.rig.plant import current_controller_gains
from anhyst_rigs.rig.recording import Recording
from anhyst_rigs.study.bearing.linear import (
    AnalogueAmplifier,
    Compensation,
    DigitalAmplifier,
    LinearLoop,
    LoopTiming,
)
from anhyst_rigs.study.bearing.operating import find_operating_point
from anhyst_rigs.study.bearing.responses import measure_sensitivity
from tests.repository import ROOT

EXAMPLE = ROOT / "examples" / "bearing"
FREQUENCIES = np.array([20.0, 60.0, 120.0, 200.0, 320.0, 450.0, 700.0])


def soft_rig(folder: Path, mode: str, eddy_time: float) -> BodyRig:
    """Return the example's rig with a soft iron, a fine encoder, and this amplifier."""
    text = (EXAMPLE / "rig.toml").read_text(encoding="utf-8")
    for old, new in (
        ('files = "loops.csv"', f'files = "{(EXAMPLE / "loops.csv").as_posix()}"'),
        ("reversible_fraction = 0.15", "reversible_fraction = 1.0"),
        ("\nstep_m = 50e-9", "\nstep_m = 1e-9"),
        ('mode = "current"', f'mode = "{mode}"'),
        ("leakage_H", f"eddy_time_s = {eddy_time}\nleakage_H"),
    ):
        assert old in text
        text = text.replace(old, new)
    path = folder / "rig.toml"
    path.write_text(text, encoding="utf-8")
    return read_bearing(path)


def linear_loop(rig: BodyRig, controller: Pidd2, drive: Mapping[str, float], eddy_time: float) -> LinearLoop:
    """Make the linear loop from the parameters of the rig."""
    gain, reset = current_controller_gains(rig)
    bandwidth = rig.settings.current_sensor.bandwidth_Hz
    amplifier = (
        AnalogueAmplifier(gain, reset)
        if rig.settings.amplifier.mode == "current"
        else DigitalAmplifier(1.2, gain, reset * rig.dt, bandwidth)
    )
    return LinearLoop(
        replace(find_operating_point(rig).bearing, eddy_time=eddy_time),
        amplifier,
        LoopTiming(controller.rate, 1.0, rig.settings.gap_sensor.bandwidth_Hz),
        controller,
        Compensation(drive["k_i_N_per_A"], drive["k_s_N_per_m"]),
    )


@pytest.mark.parametrize(("mode", "eddy_time"), [("current", 0.0), ("current", 50e-6), ("voltage", 20e-6)])
def test_the_sensitivity_of_both_is_one(tmp_path: Path, mode: str, eddy_time: float) -> None:
    rig = soft_rig(tmp_path, mode, eddy_time)
    controller = read_controller(EXAMPLE / "controller.toml").settings
    loops = read_loops(EXAMPLE / "loops.csv")
    known = operating_point(rig, controller, loops)
    drive = make_compensator("linearised", Sources(known, loops), "f64")
    gap = rig.settings.gap_m
    running = Running(BearingSetup(rig, drive, controller))
    running.run(ScenarioBuilder(rig, gap).lift_off(controller).build())

    def run(inject: FloatArray) -> Recording:
        return running.run(ScenarioBuilder(rig, gap).hold(0.0, inject).build())

    rate = rig.settings.timing.rate_Hz
    found = measure_sensitivity(run, FREQUENCIES, 2e-6, rate)
    linear = linear_loop(rig, controller.pidd2(), drive.parameters.constants, eddy_time)
    expected = np.abs(linear.sensitivity(FREQUENCIES))
    assert np.max(np.abs(found.magnitude / expected - 1.0)) < 0.04
