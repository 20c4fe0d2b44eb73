"""Leakage flux and excess loss of eddy currents in iron with a uniform field."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anhyst.model.actuator import Model, read_model
from anhyst.model.diff import diff
from anhyst.model.dynamics import EddyCircuit, Layers
from anhyst.model.writer import write_model
from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0
from tests.model.test_layers import DRIVE, FAST, PLAIN, SLOW
from tests.refusals import refused

GAMMA = 3.0
CIRCUITS = {
    "leakage": EddyCircuit(0.7, 2e-3),
    "excess": EddyCircuit(excess=40.0),
    "both": EddyCircuit(0.5, 1e-3, 20.0),
}


def magnet(circuit: EddyCircuit, gamma: float = GAMMA) -> Model:
    return replace(PLAIN, parameters={**PLAIN.parameters, "gamma": gamma}, eddy_circuit=circuit)


def drive_from_definition(
    circuit: EddyCircuit, flux: FloatArray, field: FloatArray, step: float
) -> FloatArray:
    """Return the drive in A for a flux density and a field of the iron, by the written equations."""
    rise = np.diff(flux, prepend=flux[0]) / step
    inside = np.empty(flux.size)
    inside[0] = flux[0]
    for sample in range(1, flux.size):
        inside[sample] = (step * flux[sample] + circuit.delay * inside[sample - 1]) / (step + circuit.delay)
    ring = circuit.leaky * np.diff(inside, prepend=inside[0]) / step
    eddy = GAMMA * ((1.0 - circuit.leaky) * rise + ring)
    eddy += circuit.excess * np.sign(rise) * np.sqrt(np.abs(rise))
    parameters = PLAIN.parameters_at()
    return np.asarray((field + parameters["rho"] * flux / MU_0 + eddy) / parameters["c_H"])


@pytest.mark.parametrize("circuit", CIRCUITS.values(), ids=list(CIRCUITS))
def test_predictions_obey_the_written_equations(circuit: EddyCircuit) -> None:
    run = magnet(circuit).predict(DRIVE, time=FAST)
    drive = drive_from_definition(circuit, run.flux_density, run.field, float(FAST[1]))
    assert drive == pytest.approx(DRIVE, abs=1e-6)


@pytest.mark.parametrize("circuit", CIRCUITS.values(), ids=list(CIRCUITS))
def test_the_inverse_returns_the_drive(circuit: EddyCircuit) -> None:
    force = magnet(circuit).predict(DRIVE, time=FAST).output
    assert magnet(circuit).invert(force, time=FAST).drive == pytest.approx(DRIVE, abs=1e-6)


@pytest.mark.parametrize("circuit", CIRCUITS.values(), ids=list(CIRCUITS))
def test_a_stepper_follows_the_prediction_of_a_record(circuit: EddyCircuit) -> None:
    model = magnet(circuit)
    stepper = model.stepper(history="demagnetised")
    forces = [stepper.commit(float(amperes), dt=float(FAST[1])) for amperes in DRIVE]
    predicted = model.predict(DRIVE, time=FAST, history="demagnetised").output
    assert forces[1:] == pytest.approx(predicted[1:], abs=1e-6 * predicted.max())


@pytest.mark.parametrize("circuit", CIRCUITS.values(), ids=list(CIRCUITS))
def test_slow_drives_give_the_quasi_static_force_and_fast_ones_do_not(circuit: EddyCircuit) -> None:
    model, still = magnet(circuit), PLAIN.predict(DRIVE).output
    assert np.abs(model.predict(DRIVE, time=1e3 * SLOW).output - still).max() < 1e-3 * still.max()
    assert np.abs(model.predict(DRIVE, time=FAST).output - still).max() > 0.02 * still.max()


@pytest.mark.parametrize("circuit", CIRCUITS.values(), ids=list(CIRCUITS))
def test_a_settled_cycle_is_that_which_it_becomes_when_repeated(circuit: EddyCircuit) -> None:
    model, cycle, time = magnet(circuit), DRIVE[:199], FAST[:199]
    settled = model.predict(cycle, time=time, history="settled").output
    repeated = model.predict(np.tile(cycle, 12), time=time[1] * np.arange(12 * 199.0)).output
    assert repeated[-199:] == pytest.approx(settled, abs=1e-4 * settled.max())


@settings(deadline=None, max_examples=60)
@given(
    leaky=st.floats(0.0, 1.0),
    delay=st.floats(0.0, 0.1),
    excess=st.floats(0.0, 200.0),
    gamma=st.floats(1e-3, 100.0),
    turns=st.lists(st.floats(0.0, 4.0), min_size=2, max_size=6),
    seconds=st.floats(1e-3, 10.0),
)
def test_prediction_and_inverse_agree_and_a_closed_path_loses_energy(
    leaky: float, delay: float, excess: float, gamma: float, turns: list[float], seconds: float
) -> None:
    model = magnet(EddyCircuit(leaky, delay, excess), gamma)
    drive = np.interp(np.linspace(0.0, 1.0, 120), np.linspace(0.0, 1.0, len(turns) + 2), [0.0, *turns, 0.0])
    time = seconds * np.arange(drive.size)
    run = model.predict(drive, time=time, history="demagnetised")
    found = model.invert(run.output, time=time, history="demagnetised").drive
    # The output is a square of the flux, so a small force determines the flux only roughly.
    is_large = run.flux_density > 0.02
    assert found[is_large] == pytest.approx(drive[is_large], abs=1e-4)
    cycle = model.predict(drive, time=time, history="settled")
    energy = float(np.sum(drive * np.diff(cycle.flux_density, prepend=cycle.flux_density[-1])))
    assert energy > -1e-9


def test_a_written_model_predicts_as_before_bit_for_bit(tmp_path: Path) -> None:
    model = magnet(CIRCUITS["both"])
    write_model(model, tmp_path / "m.toml")
    again = read_model(tmp_path / "m.toml")
    assert again == model
    assert np.array_equal(model.predict(DRIVE, time=FAST).output, again.predict(DRIVE, time=FAST).output)


def test_a_difference_in_the_eddy_circuit_is_a_difference() -> None:
    model = magnet(CIRCUITS["leakage"])
    assert diff(model, model).same
    other = replace(model, eddy_circuit=CIRCUITS["excess"])
    assert [setting.name for setting in diff(model, other).settings] == ["eddy_circuit"]


@pytest.mark.parametrize(("key", "value"), [("leaky", 1.5), ("delay", -1.0), ("excess", float("inf"))])
def test_an_eddy_circuit_out_of_range_is_refused(key: str, value: float) -> None:
    with refused(f"out-of-range {key}"):
        EddyCircuit(**{key: value})


def test_an_eddy_circuit_needs_one_gamma_and_no_layers() -> None:
    for model in (
        magnet(CIRCUITS["leakage"], 0.0),
        replace(magnet(CIRCUITS["leakage"]), layers=Layers(2, 0.3)),
    ):
        with refused("out-of-range eddy_circuit"):
            model.iron_at()
