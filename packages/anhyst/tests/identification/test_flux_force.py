"""The force that is derived from loops of flux linkage, against a magnet whose force is known."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import anhyst
from anhyst.data import History, Loop, Loops
from anhyst.data.path import find_turning_points
from anhyst.data.plausibility import check_plausible
from anhyst.identification import IdentifyResult
from anhyst.identification.flux_circuit import ForceReading, PoleArea, fit_circuit
from anhyst.identification.flux_force import ForceCalibration, derive_force
from anhyst.identification.flux_records import prepare_records
from anhyst.model.flux_map import FluxMap
from anhyst.support.errors import InputError
from anhyst.support.units import QUANTITIES
from tests.identification import flux_truth
from tests.refusals import refused

UNSEEN_GAPS = (0.35e-3, 0.5e-3, 0.7e-3)


@lru_cache
def identified() -> IdentifyResult:
    return anhyst.identify(flux_truth.flux_loops())


def flux_map_of(result: IdentifyResult) -> FluxMap:
    assert result.model.flux is not None
    return result.model.flux


circuits = st.builds(
    FluxMap,
    pole=st.floats(0.2, 3.0),
    fringe=st.floats(0.0, 2.0),
    gap_zero=st.floats(-0.05, 0.05),
    leakage=st.floats(0.06, 0.3),
    leakage_slope=st.floats(-0.05, 0.05),
    leakage_gap=st.just(1.0),
    armature_knots=st.just((0.4, 0.7)),
    armature_weights=st.tuples(st.floats(0.0, 20.0), st.floats(0.0, 50.0)),
    largest_flux=st.just(1.0),
)


@given(circuits, st.floats(0.4, 2.0))
def test_the_force_is_the_change_of_the_energy_over_the_gap(circuit: FluxMap, gap: float) -> None:
    flux, step = np.linspace(0.0, 1.0, 4001), 1e-5

    def energy(width: float) -> float:
        gaps = np.full(flux.size, width)
        # The leakage path and the gap are parallel: their common magnetomotive force is that of the coil.
        return float(np.trapezoid(circuit.magnetomotive_force(flux, gaps), flux))

    derivative = (energy(gap + step) - energy(gap - step)) / (2.0 * step)
    force = float(circuit.force(np.ones(1), np.array([gap]))[0])
    assert force == pytest.approx(derivative, rel=1e-4, abs=1e-5)


@given(circuits, st.floats(0.4, 2.0))
def test_the_flux_linkage_of_a_force_has_this_force(circuit: FluxMap, gap: float) -> None:
    psi = np.linspace(0.05, 1.0, 20)
    gaps = np.full(psi.size, gap)
    force = circuit.force(psi, gaps)
    is_rising = bool((np.diff(force) > 0.0).all()) and force[0] > 0.0
    if is_rising:
        found = circuit.flux_linkage(force, gaps)
        assert circuit.force(found, gaps) == pytest.approx(force, rel=1e-6)


def test_the_derived_force_at_unseen_gaps_is_that_of_the_magnet() -> None:
    result = identified()
    assert result.model.output.name == "force"
    errors, largest = [], 0.0
    for gap in UNSEEN_GAPS:
        path = flux_truth.flux_path((0.0, 0.95, 0.1, 0.8, 0.3, 0.95, 0.1))
        current, _, force = flux_truth.run(path, gap)
        is_measured = current <= result.model.valid_range.input[1]
        predicted = result.model.predict(current, gap, history="demagnetised").output
        errors.append(np.abs(predicted - force)[is_measured])
        largest = max(largest, float(force.max()))
    assert max(error.max() for error in errors) < 0.02 * largest
    assert np.mean(np.concatenate(errors)) < 0.004 * largest


def test_the_drift_of_the_flux_is_found_and_stated() -> None:
    flux = flux_map_of(identified())
    assert np.array(flux.drifts) == pytest.approx(5e-3 * flux.largest_flux, rel=0.25)
    assert any("drift of up to 0." in text for text in flux.assumptions)


def test_the_model_file_keeps_the_flux_map(tmp_path: Path) -> None:
    model = identified().model
    path = model.save(tmp_path / "model.toml")
    assert anhyst.read_model(path).flux == model.flux


def test_predict_writes_the_flux_linkage_and_invert_takes_it(tmp_path: Path) -> None:
    model = identified().model
    current = np.linspace(0.2, 3.0, 40)
    predicted = anhyst.predict(
        model, {"I_A": current, "gap_m": np.full(40, 0.5e-3)}, history="demagnetised"
    ).to_columns()
    demand = {name: predicted[name] for name in ("psi_Wb", "gap_m")}
    inverted = anhyst.invert(model, demand, history="demagnetised").to_columns()
    assert inverted["I_A"] == pytest.approx(current, abs=1e-4)


def test_a_reading_calibrates_and_a_wrong_one_is_refused() -> None:
    loops = flux_truth.flux_loops()
    current, _, force = flux_truth.run(flux_truth.flux_path((0.0, 1.0)), 0.3e-3)
    reading = {"I_A": current[-1:], "gap_m": [0.3e-3], "F_N": force[-1:]}
    calibrated = anhyst.identify(loops, force_at=reading)
    assert any("1 force reading" in text for text in flux_map_of(calibrated).assumptions)
    with refused("reading-contradicts force_at: 9.81"):
        anhyst.identify(loops, force_at=reading | {"F_N": [9.81]})


def test_two_gaps_do_not_give_a_force() -> None:
    loops = flux_truth.flux_loops(flux_truth.GAPS[:2])
    result = anhyst.identify(loops)
    assert result.model.output.name == "flux_linkage"
    assert any(text.startswith("no force: 2 gaps") for text in result.warnings)
    with refused("force-not-derived output: 2 gaps"):
        anhyst.identify(loops, output="force")


def test_an_unknown_zero_of_the_flux_is_found_and_warned_of() -> None:
    loops = flux_truth.flux_loops(drift=0.0)
    cut = []
    for loop in loops.loops:
        rest = int(find_turning_points(loop.input)[2])  # after the first tip
        columns = {name: getattr(loop, name)[rest:] for name in ("input", "output", "schedule")}
        columns["output"] = columns["output"] - columns["output"][0]
        points = (float(loop.input.max()), float(loop.input[rest]))
        history = History("conditioned", (0.0, *points))
        cut.append(replace(loop, **columns, history=history))
    derived = derive_force(loops.with_loops(cut), ForceCalibration(), 1)
    assert any("was not demagnetised" in text for text in derived.warnings)
    assert min(derived.flux.zeros) > 0.0


def test_wrong_calibrations_are_refused() -> None:
    loops = flux_truth.flux_loops()
    with refused("options-missing pole_area: turns"):
        anhyst.identify(loops, pole_area=4e-4)
    with refused("not-above-zero turns: 0"):
        anhyst.identify(loops, pole_area=4e-4, turns=0)
    with pytest.raises(InputError):
        anhyst.identify(loops, force_at={"I_A": [1.0]})


def test_a_pole_area_that_contradicts_the_flux_is_refused() -> None:
    loops = flux_truth.flux_loops()
    for factor in (0.5, 2.0):
        pole = PoleArea(factor * 0.5 * flux_truth.AREA, flux_truth.TURNS)
        with refused("area-contradicts pole_area: the flux linkage gives"):
            derive_force(loops, ForceCalibration((), pole), 1)
    derive_force(loops, ForceCalibration((), PoleArea(0.5 * flux_truth.AREA, flux_truth.TURNS)), 1)


def test_a_reading_without_current_is_no_contradiction() -> None:
    loops = flux_truth.flux_loops()
    derive_force(loops, ForceCalibration((ForceReading(0.0, 0.3e-3, 0.0),)), 1)


def test_the_uncertainty_covers_the_force_in_saturation() -> None:
    derived = derive_force(flux_truth.flux_loops(), ForceCalibration(), 1)
    _, psi, force = flux_truth.run(flux_truth.flux_path((0.0, 1.0)), 0.3e-3)
    error = np.abs(derived.flux.force(psi, np.full(psi.size, 0.3e-3)) - force).max() / force.max()
    assert derived.flux.worst_uncertainty is not None
    assert error < 1.5 * derived.flux.worst_uncertainty
    assert derived.flux.worst_uncertainty > 0.013


def test_a_negative_flux_linkage_is_not_inverted_to_a_positive_current() -> None:
    model = identified().model
    psi = 0.5 * flux_map_of(identified()).largest_flux
    demand = {"psi_Wb": np.array([psi, -psi]), "gap_m": np.full(2, 0.4e-3)}
    inverted = anhyst.invert(model, demand, history="demagnetised").to_columns()
    assert inverted["valid"].tolist() == [True, False]


def test_zeros_and_drifts_have_equal_length() -> None:
    with refused("wrong-size zeros: 1 zeros"):
        replace(flux_map_of(identified()), zeros=(0.0,))


@pytest.mark.parametrize("share", [0.5, 1.0])
def test_a_reading_has_the_flux_linkage_of_the_rising_current(share: float) -> None:
    fit = fit_circuit(prepare_records(flux_truth.flux_loops()))
    current, psi, _ = flux_truth.run(flux_truth.flux_path((0.0, share)), 0.3e-3)
    current_scale, flux_scale, gap_scale = fit.records.scales
    found = flux_scale * fit.flux_at(float(current[-1]) / current_scale, 0.3e-3 / gap_scale)
    assert found == pytest.approx(psi[-1], rel=0.006)


def test_a_reading_beyond_the_currents_of_the_loops_is_refused() -> None:
    calibration = ForceCalibration((ForceReading(100.0, 0.3e-3, 400.0),))
    with refused("reading-outside force_at: 100 A"):
        derive_force(flux_truth.flux_loops(), calibration, 1)


def test_a_flux_linkage_in_other_units_is_implausible() -> None:
    loops = flux_truth.flux_loops()
    loops = loops.with_loops(replace(loop, output=1e3 * loop.output) for loop in loops.loops)
    assert any("are the numbers in mWb, not Wb?" in text for text in check_plausible(loops))


def test_ramps_of_few_samples_keep_their_knee() -> None:
    loops = flux_truth.flux_loops(noise=0.0, drift=0.0)
    few = []
    for loop in loops.loops:
        reversals = find_turning_points(loop.input)[:4]  # two rises and a fall
        ramps = [np.linspace(start, stop, 13).round().astype(int) for start, stop in pairwise(reversals)]
        rows = np.unique(np.concatenate(ramps))
        columns = {name: getattr(loop, name)[rows] for name in ("input", "output", "schedule")}
        few.append(replace(loop, **columns))
    assert fit_circuit(prepare_records(loops.with_loops(few))).flux_rms < 3e-3


def test_the_slope_over_few_currents_is_finite() -> None:
    levels = np.concatenate([np.linspace(0.0, 1.0, 13), np.linspace(1.0, 0.0, 13)[1:]])
    current = levels + 1e-4 * np.random.default_rng(1).standard_normal(levels.size)
    flux = current + 0.02 * np.sign(np.arange(levels.size) - 12.5)
    loop = Loop("1", current, flux, np.full(levels.size, 0.3e-3), history=History("demagnetised"))
    loops = Loops((loop,), QUANTITIES["current"], QUANTITIES["flux_linkage"], QUANTITIES["gap"])
    weight = prepare_records(loops).weight
    assert weight.min() > 0.5
    assert weight.max() < 2.0
