"""Test faults while levitated, and the recovery or landing of the armature."""

from __future__ import annotations

import numpy as np
import pytest

from anhyst.support.kinds import MethodName
from anhyst.support.states import Command, Phase, State
from anhyst_rigs.rig.bearing.held import levitation_loss_time
from anhyst_rigs.rig.drift import change_rig
from anhyst_rigs.rig.loop import DROP_SAMPLE_BIT, SimulatedLoop
from anhyst_rigs.rig.recording import BREAKAWAY_CODE, FAULT_CODE, HOVER_CODE, state_code
from anhyst_rigs.study.bearing import experiments
from anhyst_rigs.study.bearing.experiments import (
    MIN_EXCESS_BAND_M,
    RECOVERY_BAND_M,
    Event,
    ExperimentTrial,
    excess_band,
    run_event,
)
from tests.study import bearings
from tests.study.bearings import GAP

PATIENCE = 3
FAULT_FALL = state_code(State.FAULT, Phase.FALL)
VARIANTS: tuple[MethodName, ...] = ("full", "single-valued")


SHOWN: tuple[Event, ...] = ("wrong initial state", "dropped sample")


@pytest.mark.parametrize("variant", VARIANTS)
def test_it_recovers_from_an_overload(variant: MethodName) -> None:
    found = run_event(ExperimentTrial(bearings.single(variant), 0, "overload"))
    assert found is not None
    assert set(found.figures) == {"recovery_s"}
    assert 0.005 < found.figures["recovery_s"] < 0.03


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("event", SHOWN)
def test_an_event_shows_and_passes(event: Event, variant: MethodName) -> None:
    """The deviation exceeds the uncertainty of a reading, and it ends."""
    found = run_event(ExperimentTrial(bearings.single(variant), 0, event))
    assert found is not None
    assert set(found.figures) == {"excess_peak_m", "excess_s"}
    # Play cells keep a wrong state until the field has passed over it again. With a good model, the
    # armature moves little.
    remembered = event == "wrong initial state" and variant == "full"
    assert (0.0 if remembered else MIN_EXCESS_BAND_M) < found.figures["excess_peak_m"] < RECOVERY_BAND_M
    smallest, largest = (0.0, 0.1) if remembered else (0.002, 0.03)
    assert smallest <= found.figures["excess_s"] < largest


@pytest.mark.parametrize("event", SHOWN)
def test_without_an_event_the_runs_are_equal(event: Event, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the event both runs are equal bit for bit, so that only the event is counted."""
    monkeypatch.setattr(experiments, "DROP_SAMPLE_BIT", 0)
    monkeypatch.setattr(experiments, "SimulatedLoop", lambda setup, seed, _: SimulatedLoop(setup, seed))
    found = run_event(ExperimentTrial(bearings.single("full"), 0, event))
    assert found is not None
    assert found.figures == {"excess_peak_m": 0.0, "excess_s": 0.0}


@pytest.mark.parametrize("event", SHOWN)
def test_an_armature_that_falls_counts_as_lost(event: Event, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(experiments, "levitation_loss_time", lambda *_: 0.5)
    assert run_event(ExperimentTrial(bearings.single("single-valued"), 0, event)) is None


def test_the_band_follows_sensor_noise_and_standstill() -> None:
    rig = bearings.example()
    still = np.zeros(300)
    assert excess_band(rig, still) == MIN_EXCESS_BAND_M
    coarse = change_rig(rig, {"gap_sensor": bearings.sensor("encoder", step_m=1e-6, noise_m=0.0)})
    assert excess_band(coarse, still) == pytest.approx(3e-6 / np.sqrt(12.0))
    still[-100:] = np.tile([1e-6, -1e-6], 50)
    assert excess_band(rig, still) == pytest.approx(4e-6)


def test_an_overload_saturates_force_and_current_and_reaches_the_stop() -> None:
    setup = bearings.single("full")
    rig = setup.rig
    script = bearings.lifted(setup)
    begin = script.ticks
    script.set_load(1.2 * setup.controller.limits.force_high_N).hold(0.1)
    end = script.ticks
    recording = bearings.run_plant(setup, script.set_load(150.0).hold(0.3))
    during, after = recording.slice_ticks(begin, end), recording.slice_ticks(end, len(recording))
    assert during["gap_m"].max() >= rig.settings.body.stop_high_m
    assert during["command_A"].max() == pytest.approx(4.5, abs=1e-4)
    assert during["demand_N"].max() == pytest.approx(300.0, rel=1e-6)
    assert set(after["state"]) == {HOVER_CODE}
    assert np.abs(after["gap_m"] - GAP)[-4000:].max() < RECOVERY_BAND_M
    assert levitation_loss_time(rig, recording, script.build().lift_end_tick) == pytest.approx(
        begin * rig.dt, abs=0.05
    )
    assert after["gap_m"].min() > rig.settings.body.stop_low_m, "threw it to the other stop"


def test_a_wrong_initial_state_is_one() -> None:
    """Iron after the largest current pulls more than the controller assumes."""
    setup = bearings.single("full")
    script = bearings.lifted(setup)
    known, unknown = (
        SimulatedLoop(setup, 0, is_magnetised_first=first).run(script.build()) for first in (False, True)
    )
    resting = known["state"] <= BREAKAWAY_CODE
    assert not np.array_equal(known["force_N"], unknown["force_N"])
    assert np.ptp((unknown["force_N"] - known["force_N"])[: np.argmin(resting)]) > 1.0
    assert known["force_N"][0] == 0.0
    assert unknown["force_N"][0] > 0.1
    assert unknown["state"][-1] == known["state"][-1] == HOVER_CODE


@pytest.mark.parametrize("count", [1, PATIENCE])
def test_few_dropped_samples_do_not_matter(count: int) -> None:
    setup = bearings.single("full")
    assert setup.controller.safety.max_missing_samples == PATIENCE
    script = bearings.lifted(setup)
    begin = script.ticks
    script.command(DROP_SAMPLE_BIT, count).step(GAP - 50e-6, 0.2)
    recording = bearings.run_plant(setup, script)
    assert np.isnan(recording["gap_read_m"]).sum() == count
    assert set(recording["flags"][begin : begin + count]) == {8}
    assert set(recording["state"][begin:]) == {HOVER_CODE}
    assert np.abs(recording["gap_m"] - (GAP - 50e-6))[-1000:].max() < RECOVERY_BAND_M
    assert levitation_loss_time(setup.rig, recording, begin) is None


@pytest.mark.parametrize("count", [PATIENCE + 1, 5000])
def test_too_many_dropped_samples_end_in_a_fault_on_the_ground(count: int) -> None:
    """Four dropped samples cause a controlled landing; 5000 never return."""
    setup = bearings.single("full")
    rig = setup.rig
    script = bearings.lifted(setup)
    begin = script.ticks
    script.command(DROP_SAMPLE_BIT, count).hold(max(count * rig.dt, 0.1) + 0.5)
    recording = bearings.run_plant(setup, script)
    assert set(recording["state"][begin : begin + PATIENCE]) == {HOVER_CODE}
    assert recording["state"][begin + PATIENCE] == FAULT_FALL
    before, after = recording["command_A"][begin + PATIENCE - 1 : begin + PATIENCE + 1]
    assert after == pytest.approx(0.875 * before, abs=5e-3)
    assert recording["state"][-1] == FAULT_CODE
    assert recording["command_A"][-1] == 0.0
    assert abs(recording["current_A"][-1]) < 1e-4
    assert recording["gap_m"][-1] >= rig.settings.body.stop_high_m
    lost = levitation_loss_time(rig, recording, begin)
    assert lost == pytest.approx((begin + PATIENCE) * rig.dt)


def test_a_cleared_fault_allows_lifting() -> None:
    setup = bearings.single("single-valued")
    script = bearings.lifted(setup).command(DROP_SAMPLE_BIT, 10).hold(0.6)
    script.command(Command.CLEAR).hold(0.05)
    cleared = script.ticks
    script.lift_off(setup.controller)
    recording = bearings.run_plant(setup, script)
    assert recording["state"][cleared - 1] == state_code(State.IDLE)
    again = recording.slice_ticks(cleared, len(recording))
    assert bearings.hovers_from(again) is not None
    assert np.abs(again["gap_m"] - GAP)[-1000:].max() < RECOVERY_BAND_M
