"""Identification of the rate dependence of solid iron from loops at several speeds."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from anhyst.data import Loop, Loops
from anhyst.data.initial_history import propose_histories
from anhyst.data.path import DEMAGNETISED, SETTLED, History
from anhyst.data.reading import read_loops
from anhyst.data.speeds import describe_rate, group_by_speed, spread_equal_times
from anhyst.identification import identify
from anhyst.identification.rate import fit_rate
from anhyst.identification.run import IdentifyResult
from anhyst.model.actuator import Model
from anhyst.model.dynamics import EddyCircuit, Layers
from anhyst.model.parameters import Parameter
from anhyst.model.schema import ValidRange
from anhyst.support.numeric import FloatArray
from anhyst.support.units import QUANTITIES

GAPS = (3e-4, 5e-4)
SPEEDS = (0.5, 5.0, 50.0)
TOP = 4.0
SAMPLES = 200

IRON = {"M_0": 4e4, "a_0": 400.0, "M_1": 9e5, "a_1": 90.0, "k_1": 60.0, "s_1": 2.0}
AROUND: dict[str, Parameter] = {"c_H": 1250.0, "rho": (2.7e-3, 4.4e-3), "c_out": 170.0}


def truth(gamma: float = 5.0) -> Model:
    """Return a magnet of solid iron or, with gamma = 0, of sheets."""
    return Model(
        name="magnet",
        input=QUANTITIES["current"],
        output=QUANTITIES["force"],
        parameters={**IRON, **AROUND, "gamma": gamma},
        law="play-cells",
        gap_map="reluctance",
        schedule=QUANTITIES["gap"],
        nodes=GAPS,
        valid=ValidRange((0.0, TOP), (0.0, 300.0), GAPS),
        layers=Layers(3, 0.1, 0.15) if gamma else None,
    )


def triangle(samples: int) -> FloatArray:
    return TOP * (1.0 - np.abs(2.0 * np.arange(samples) / samples - 1.0))


@cache
def measured(gamma: float = 5.0, noise: float = 3e-4) -> Loops:
    """Return steady-state triangles at every speed and gap."""
    rng, model, loops = np.random.default_rng(3), truth(gamma), []
    for gap in GAPS:
        for rate in SPEEDS:
            drive, time = triangle(SAMPLES), np.arange(SAMPLES) / (SAMPLES * rate)
            force = model.predict(drive, gap, time, "settled").output
            force = force + noise * 300.0 * rng.normal(size=SAMPLES)
            loops.append(Loop(f"{rate:g} Hz", drive, force, np.full(SAMPLES, gap), time))
    return Loops(tuple(loops), QUANTITIES["current"], QUANTITIES["force"], QUANTITIES["gap"])


def found(loops: Loops, *, rate: bool = True) -> IdentifyResult:
    return identify(loops, law="play-cells", gap_map="reluctance", rate=rate)


def missed(model: Model, rate: float, gap: float) -> float:
    """Return the largest error over a triangle, relative to the largest force."""
    drive, time = triangle(400), np.arange(400) / (400 * rate)
    force = [one.predict(drive, gap, time, "settled").output for one in (truth(), model)]
    return float(np.abs(force[0] - force[1]).max() / force[0].max())


def test_loops_are_fast_that_are_faster_in_cycles_and_in_the_input() -> None:
    speeds = group_by_speed(measured())
    assert speeds is not None
    assert {loop.label for loop in speeds.slow.loops} == {"0.5 Hz"}
    assert [len(group) for group in speeds.fast] == [2, 2]
    assert 45.0 < speeds.fastest_rate < 55.0


def test_smaller_or_untimed_loops_are_not_classified_as_fast() -> None:
    loops = measured()
    slow = [loop for loop in loops.loops if loop.label == "0.5 Hz"]
    inner = [replace(one, label="inner", input=0.2 * one.input, output=0.04 * one.output)
             for one in slow]  # fmt: skip
    steady = [replace(one, time=0.2 * one.time) for one in inner if one.time is not None]
    assert group_by_speed(loops.with_loops([*slow, *inner])) is None
    assert group_by_speed(loops.with_loops([*slow, *steady])) is None
    assert group_by_speed(loops.with_loops(replace(loop, time=None) for loop in loops.loops)) is None


CARRIED = History.parse("conditioned:4,0")


@cache
def session(rate: float) -> Loops:
    """Return three cycles from rest at every gap, slow then fast, not demagnetised."""
    rng, loops = np.random.default_rng(3), []
    model = replace(truth(2.0), parameters=dict(truth(2.0).parameters) | {"k_1": 300.0})
    for gap, speed in product(GAPS, (0.5, rate)):
        drive = np.append(np.tile(triangle(SAMPLES), 3), 0.0)
        time = np.arange(drive.size) / (SAMPLES * speed)
        force = model.predict(drive, gap, time, CARRIED).output
        force = force + 3e-4 * 300.0 * rng.normal(size=drive.size)
        loops.append(Loop(f"{speed:g} Hz", drive, force, np.full(drive.size, gap), time))
    return Loops(tuple(loops), QUANTITIES["current"], QUANTITIES["force"], QUANTITIES["gap"])


def file_of(loops: Loops, folder: Path) -> Path:
    path = folder / "loops.csv"
    lines = ["t_s,I_A,F_N,gap_m,loop"]
    for one in loops.loops:
        assert one.time is not None
        rows = zip(one.time, one.input, one.output, strict=True)
        lines += [f"{t:.9g},{i:.9g},{f:.9g},{one.schedule_value},{one.label}" for t, i, f in rows]
    path.write_text("\n".join(lines) + "\n")
    return path


def test_fast_loops_carry_the_history_of_slow_ones(tmp_path: Path) -> None:
    """Eddy currents make the first fast cycle look like the initial curve."""
    alone = [loop for loop in session(20.0).loops if loop.label == "20 Hz"]
    assert {str(one) for one, _ in propose_histories(alone, is_even=True)} == {"demagnetised"}
    read = read_loops(file_of(session(20.0), tmp_path))
    histories = {loop.label: loop.history for loop in read.loops}
    assert histories == {"0.5 Hz": SETTLED, "20 Hz": CARRIED}
    assert sum("eddy currents" in note for note in read.notes) == len(GAPS)


def test_a_given_history_is_not_replaced_by_that_of_slow_loops(tmp_path: Path) -> None:
    read = read_loops(file_of(session(20.0), tmp_path), history="demagnetised")
    assert {loop.history for loop in read.loops} == {DEMAGNETISED}


def test_fast_loops_that_began_demagnetised_stay_so(tmp_path: Path) -> None:
    """The slow loops then begin on the initial curve as well."""
    virgin = replace(truth(2.0), parameters=dict(truth(2.0).parameters) | {"k_1": 300.0})
    loops = session(20.0).with_loops(
        replace(loop, output=virgin.predict(loop.input, loop.schedule_value, loop.time,
                                           DEMAGNETISED).output)
        for loop in session(20.0).loops
    )  # fmt: skip
    read = read_loops(file_of(loops, tmp_path))
    assert {loop.history for loop in read.loops} == {DEMAGNETISED}


@pytest.mark.slow
def test_carried_history_halves_the_error_of_fast_loops(tmp_path: Path) -> None:
    read = read_loops(file_of(session(20.0), tmp_path))
    blamed = read.with_loops(
        replace(loop, history=DEMAGNETISED) if loop.label == "20 Hz" else loop for loop in read.loops
    )
    errors = []
    for loops in (read, blamed):
        result = found(loops)
        error = [np.sqrt(np.mean((made - loop.output) ** 2))
               for made, loop in zip(result.fitted, loops.loops, strict=True)
               if loop.label == "20 Hz"]  # fmt: skip
        errors.append(max(error))
    assert errors[0] < 0.5 * errors[1]


@pytest.mark.slow
@pytest.mark.parametrize("digits", [4, 3])
def test_a_clock_of_few_digits_will_do(digits: int) -> None:
    """With a resolution of 1 ms, a cycle of 20 ms has twenty different times for two hundred
    samples."""
    coarse = measured().with_loops(
        replace(loop, time=np.floor(loop.time * 10.0**digits) / 10.0**digits)
        for loop in measured().loops
        if loop.time is not None
    )
    loops = spread_equal_times(coarse)
    assert loops.repairs
    assert spread_equal_times(loops) is loops
    for one, true in zip(loops.loops, measured().loops, strict=True):
        assert one.time is not None
        assert true.time is not None
        assert np.diff(one.time).min() > 0.0
        assert np.abs(one.time - true.time).max() < 10.0**-digits
    speeds = group_by_speed(loops)
    assert speeds is not None
    end = fit_rate(truth().at_rest, loops, speeds)
    assert missed(end.model, 20.0, 3.9e-4) < 0.02


def test_inspect_reports_the_rate_above_which_eddy_currents_matter() -> None:
    assert describe_rate(measured()).startswith("rate matters")
    assert describe_rate(measured(gamma=0.0)).startswith("rate does not matter")
    slow = measured().with_loops(loop for loop in measured().loops if loop.label == "5 Hz")
    assert describe_rate(slow) == ""


@pytest.mark.slow
def test_a_fit_at_three_speeds_predicts_other_speeds_and_gaps() -> None:
    result = found(measured())
    model, gap = result.model, 3.9e-4
    assert model.layers is not None
    static = model.at_rest
    assert missed(model, 20.0, gap) < 0.01
    assert missed(static, 20.0, gap) > 0.03
    assert missed(model, 1.0, gap) < 0.01
    assert model.fit is not None
    assert model.fit.worst < 0.015 * model.fit.largest_output
    assert not any("compiled" in text for text in result.warnings)


@pytest.mark.slow
def test_cells_of_each_gap_are_fitted_to_its_slow_loops_by_themselves() -> None:
    loops = measured()
    slow = loops.with_loops(loop for loop in loops.loops if loop.label == "0.5 Hz")
    model = identify(slow, law="play-cells", gap_map="free").model
    assert len(model.nodes) == len(GAPS)
    assert model.fit is not None
    assert model.fit.rms < 0.01 * model.fit.largest_output


def test_sheets_measured_at_three_speeds_get_no_layers() -> None:
    loops = measured(gamma=0.0)
    speeds = group_by_speed(loops)
    assert speeds is not None
    still = truth(gamma=0.0)
    end = fit_rate(still, loops, speeds)
    assert not end.model.has_eddy_currents
    assert end.model is still


def test_layers_are_selected_from_one_fast_speed_by_withheld_gaps() -> None:
    loops = measured()
    some = loops.with_loops(loop for loop in loops.loops if loop.label != "5 Hz")
    speeds = group_by_speed(some)
    assert speeds is not None
    end = fit_rate(truth().at_rest, some, speeds)
    assert end.model.has_eddy_currents
    assert 0.0 < end.log_gamma_std < 0.2
    assert missed(end.model, 20.0, 3.9e-4) < 0.01


@pytest.mark.slow
@pytest.mark.parametrize("rate", [20.0, 100.0])
def test_the_truth_itself_is_matched_from_its_static_part(rate: float) -> None:
    loops = measured()
    speeds = group_by_speed(loops)
    assert speeds is not None
    end = fit_rate(truth().at_rest, loops, speeds)
    assert missed(end.model, rate, 3.9e-4) < 0.02


def test_a_coupling_that_would_jump_becomes_an_equivalent_reluctance() -> None:
    loops, still = measured(), truth(gamma=0.0)
    by = 0.998  # the iron alone would jump
    iron = {name: IRON[name] / by for name in ("M_0", "M_1")}
    rho = tuple((1.0 + one) / by - 1.0 for one in (2.7e-3, 4.4e-3))
    coupled: dict[str, Parameter] = {**iron, "alpha": 1.0 - by, "rho": rho, "c_H": 1250.0 / by}
    still = replace(still, parameters={**still.parameters, **coupled})
    speeds = group_by_speed(loops)
    assert speeds is not None
    end = fit_rate(still, loops, speeds)
    assert end.model.has_eddy_currents
    assert end.model.parameters["alpha"] == 0.0
    assert end.model.parameters["rho"] == pytest.approx((2.7e-3, 4.4e-3))
    drive = triangle(100)
    expected, made = (one.predict(drive, GAPS[0]).output for one in (still, end.model.at_rest))
    assert made == pytest.approx(expected, abs=1e-9 * expected.max())


CIRCUITS = {"leakage": EddyCircuit(0.7, 3e-3), "excess": EddyCircuit(excess=60.0), "lag": EddyCircuit()}


def loops_of_circuit(circuit: EddyCircuit) -> tuple[Model, Loops]:
    """Return a magnet with an eddy circuit, and its noisy loops."""
    model = replace(truth(6.0), layers=None, eddy_circuit=circuit)
    rng, loops = np.random.default_rng(8), []
    for gap, rate in product(GAPS, SPEEDS):
        drive, time = triangle(SAMPLES), np.arange(SAMPLES) / (SAMPLES * rate)
        force = model.predict(drive, gap, time, "settled").output + 0.1 * rng.normal(size=SAMPLES)
        loops.append(Loop(f"{rate:g} Hz", drive, force, np.full(SAMPLES, gap), time))
    return model, Loops(tuple(loops), QUANTITIES["current"], QUANTITIES["force"], QUANTITIES["gap"])


@pytest.mark.parametrize("name", CIRCUITS)
def test_the_form_of_the_rate_dependence_is_found(name: str) -> None:
    true_model, loops = loops_of_circuit(CIRCUITS[name])
    model = found(loops).model
    circuit = model.eddy_circuit or EddyCircuit()
    assert (circuit.leaky > 0.0, circuit.excess > 0.0) == (name == "leakage", name == "excess")
    assert model.layers is None
    drive, time = triangle(400), np.arange(400) / (400 * 100.0)
    expected, predicted, still = (
        one.predict(drive, GAPS[0], time, "settled").output for one in (true_model, model, model.at_rest)
    )
    error, static_error = (np.abs(force - expected).max() for force in (predicted, still))
    assert error < 0.02 * expected.max()
    assert error < 0.2 * static_error


def test_a_form_that_extrapolates_worse_than_a_lag_is_not_used() -> None:
    """A leakage flux fits diffusion well at the fitted rates, but not beyond."""
    model = found(measured()).model
    assert model.eddy_circuit is None
    assert model.layers is not None


def with_gain(loops: Loops, gain: float) -> Loops:
    """Return loops whose fast files were measured with another gain of the sensor."""
    return loops.with_loops(
        replace(loop, output=(1.0 if loop.label == "0.5 Hz" else gain) * loop.output) for loop in loops.loops
    )


@pytest.mark.parametrize("gain", [0.95, 0.99, 1.01])
@pytest.mark.parametrize("rates", [(0.5, 50.0), SPEEDS])
def test_a_gain_error_of_the_fast_files_gives_a_model_that_predicts(
    gain: float, rates: tuple[float, ...]
) -> None:
    """Layers whose middle is frozen at all rates describe a gain error, but their cycles do not close."""
    loops = measured(0.0)
    one_gap = [
        loop for loop in loops.loops
        if loop.schedule_value == GAPS[0] and float(loop.label.split()[0]) in rates
    ]  # fmt: skip
    for given in (loops.with_loops(one_gap), loops):
        model = identify(with_gain(given, gain), law="play-cells").model
        drive, time = triangle(400), np.arange(400) / (400 * 100.0)
        force = model.predict(drive, GAPS[0], time, "settled").output
        expected = truth(0.0).predict(drive, GAPS[0], time, "settled").output
        assert np.abs(force - expected).max() < 0.15 * expected.max()


def test_loops_of_several_speeds_without_a_rate_fit_are_reported() -> None:
    loops = measured()
    without_time = [replace(loop, time=None) if loop.label == "0.5 Hz" else loop for loop in loops.loops]
    assert any("have no times" in text for text in found(loops.with_loops(without_time)).warnings)
    apart = [
        loop
        for loop in loops.loops
        if loop.label == ("0.5 Hz" if loop.schedule_value == GAPS[0] else "50 Hz")
    ]
    assert any("several speeds" in text for text in found(loops.with_loops(apart)).warnings)
    assert not any("rate dependence" in text for text in found(loops).warnings)


def test_gaps_that_differ_by_the_error_of_their_sensor_are_compared() -> None:
    loops = measured()
    shifted = [
        replace(loop, schedule=loop.schedule + 5e-7)
        if loop.label == "50 Hz" and loop.schedule is not None
        else loop
        for loop in loops.loops
    ]
    speeds = group_by_speed(loops.with_loops(shifted))
    assert speeds is not None
    assert [len(group) for group in speeds.fast] == [2, 2]
