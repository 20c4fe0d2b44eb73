"""Test the methods from force to current: accuracy, and equal results in all formats."""

from __future__ import annotations

import math
import pickle
from dataclasses import replace
from functools import cache
from typing import get_args

import numpy as np
import pytest
from scipy.signal import cont2discrete

from anhyst.compensate.force_controller import ForceController
from anhyst.compensate.methods import METHODS, make_compensator
from anhyst.compensate.sources import FluxCalibration, OperatingRange, Sources
from anhyst.data import History, Loop, Loops
from anhyst.data.surface import fit_surface
from anhyst.model.actuator import Model
from anhyst.model.schema import ValidRange
from anhyst.support.kinds import MethodName, NumberFormat
from anhyst.support.numeric import FloatArray
from anhyst.support.units import QUANTITIES
from tests.actuators import GAPS, magnet, triangles
from tests.refusals import refused

RATE = 20000.0
RANGE = (0.32e-3, 0.55e-3)
POINT = OperatingRange(0.42e-3, 50.0, RATE, RANGE, 90.0, 2.0)
MAPS: tuple[MethodName, ...] = ("ratio", "secant", "linearised", "single-valued")
VARIANTS: tuple[MethodName, ...] = get_args(MethodName)
FORMATS: tuple[NumberFormat, ...] = get_args(NumberFormat)
WIDTH = 0.1
"""Width of the loops without a model, A."""


def loopset(loops: list[Loop]) -> Loops:
    return Loops(tuple(loops), QUANTITIES["current"], QUANTITIES["force"], QUANTITIES["gap"])


def lines(force: FloatArray, gap: float) -> FloatArray:
    """Return a current proportional to force and gap, A."""
    return np.asarray(0.1 + 0.012 * force + 800.0 * gap)


def roots(force: FloatArray, gap: float) -> FloatArray:
    """Return the current of a magnet without iron, A."""
    return np.asarray(280.0 * (gap + 0.1e-3) * np.sqrt(force))


def around(curve: object, noise: float = 0.0) -> Loops:
    """Return loops of constant width around a curve, up and down, at every gap."""
    assert callable(curve)
    rng = np.random.default_rng(2)
    force = np.concatenate([np.linspace(0.0, 120.0, 400), np.linspace(120.0, 0.0, 400)])
    side = np.repeat([0.5 * WIDTH, -0.5 * WIDTH], 400)
    return loopset(
        [
            Loop(
                f"{gap:g}",
                curve(force, gap) + side,
                force + noise * rng.standard_normal(force.size),
                np.full(force.size, gap),
            )
            for gap in GAPS
        ]
    )


@cache
def known() -> tuple[Loops, Model, FluxCalibration]:
    """Return loops of a magnet with hysteresis, its model, and the calibration of a probe."""
    model = replace(magnet(), valid=ValidRange((0.0, 2.0), (0.0, 140.0), (GAPS[0], GAPS[-1])))
    loops, forces = [], []
    for gap in GAPS:
        for low, high in ((0.0, 2.0), (0.0, 1.2), (0.6, 1.4)):
            drive = np.append(triangles(low, high, 400), low)
            force = model.predict(drive, gap, history="demagnetised").output
            at = np.full(401, gap)
            loops.append(
                Loop(f"{low:g} to {high:g}", drive[-401:], force[-401:], at, history=History("settled"))
            )
        forces.append(force[-401:])
    series = np.concatenate(forces)
    gaps = np.repeat(GAPS, 401)
    calibration = FluxCalibration(gaps, series, density(series), 1.0 / RATE, 0.0)
    return loopset(loops), model, calibration


def density(force: FloatArray) -> FloatArray:
    """Return the flux density of the magnet's model, T."""
    return np.asarray(np.sqrt((force - 0.5) / 60.0))


@cache
def fit(variant: MethodName, number_format: NumberFormat) -> ForceController:
    loops, model, calibration = known()
    return make_compensator(variant, Sources(POINT, loops, model, calibration), number_format)


def fitted(variant: MethodName, number_format: NumberFormat = "f64") -> ForceController:
    return fit(variant, number_format).reset_copy()


# What each knows


def test_the_static_curve_is_the_best_of_its_kind() -> None:
    """Both branches pass every force: no curve has an error below half the width."""
    drive = make_compensator("single-valued", Sources(POINT, around(roots)), "f64")
    worst = max(
        abs(drive.solve(force, gap) - float(roots(np.array(force), gap)) - side)
        for gap in (GAPS[1], 0.35e-3, 0.5e-3)
        for force in np.linspace(10.0, 89.0, 60).tolist()
        for side in (0.5 * WIDTH, -0.5 * WIDTH)
    )
    assert 0.5 * WIDTH <= worst < 0.51 * WIDTH


def test_force_noise_does_not_roughen_the_static_curve() -> None:
    quiet = fit_surface(around(roots), (0.0, 100.0), RANGE)
    noisy = fit_surface(around(roots, noise=0.2), (0.0, 100.0), RANGE)
    inside = slice(20, -10)
    slopes = np.diff(noisy.current[8])[inside] / np.diff(quiet.current[8])[inside]
    assert np.abs(slopes - 1.0).max() < 0.1


def test_the_static_curve_is_linear_beyond_the_measured_range() -> None:
    surface = fit_surface(around(roots), (0.0, 150.0), RANGE)  # the loops end at 120 N
    beyond = surface.force > 121.0
    slopes = np.diff(surface.current[:, beyond], axis=1) / np.diff(surface.force[beyond])
    assert np.ptp(slopes, axis=1).max() < 1e-6 * slopes.max()
    last = np.gradient(roots(surface.force, float(surface.gap[0])), surface.force)[~beyond][-1]
    assert slopes[0, 0] == pytest.approx(last, rel=0.1)


def test_a_linear_magnet_gives_its_own_constants() -> None:
    loops = around(lines)
    for force, gap in ((40.0, 0.4e-3), (70.0, 0.5e-3)):
        current = float(lines(np.array(force), gap))
        assert make_compensator("linearised", Sources(POINT, loops), "f64").solve(
            force, gap
        ) == pytest.approx(current, abs=1e-6)
        there = float(lines(np.array(force), POINT.gap))  # a ratio does not depend on the gap
        assert make_compensator("ratio", Sources(POINT, loops), "f64").solve(force, gap) == pytest.approx(
            there, abs=1e-6
        )
    numbers = make_compensator("linearised", Sources(POINT, loops), "f64").parameters.constants
    assert numbers["k_i_N_per_A"] == pytest.approx(1.0 / 0.012, rel=1e-6)
    assert numbers["k_s_N_per_m"] == pytest.approx(800.0 / 0.012, rel=1e-6)


def test_constants_of_a_magnet_are_its_slopes_at_the_operating_point() -> None:
    def current(force: float, gap: float) -> float:
        return float(roots(np.array(force), gap))

    per_force = (current(50.1, POINT.gap) - current(49.9, POINT.gap)) / 0.2
    per_gap = (current(50.0, POINT.gap + 1e-6) - current(50.0, POINT.gap - 1e-6)) / 2e-6
    for variant in MAPS[:3:2]:
        numbers = make_compensator(variant, Sources(POINT, around(roots)), "f64").parameters.constants
        assert numbers["k_i_N_per_A"] == pytest.approx(1.0 / per_force, rel=0.04)
    numbers = make_compensator("linearised", Sources(POINT, around(roots)), "f64").parameters.constants
    assert numbers["k_s_N_per_m"] == pytest.approx(per_gap / per_force, rel=0.04)
    assert per_gap > 0.0  # an opening gap needs more current


def test_the_secant_passes_through_zero_and_the_operating_point() -> None:
    drive = make_compensator("secant", Sources(POINT, around(roots)), "f64")
    assert drive.solve(0.0, POINT.gap) == 0.0
    there = float(roots(np.array(POINT.force), POINT.gap))
    assert drive.solve(POINT.force, POINT.gap) == pytest.approx(there, rel=1e-3)
    assert drive.solve(0.5 * POINT.force, RANGE[1]) == pytest.approx(0.5 * there, rel=1e-3)


def worst_force(variant: MethodName) -> float:
    """Largest force error of slow triangles, N, with fixed armature and one tick of delay."""
    drive, plant = fitted(variant), known()[1].stepper(POINT.gap, "demagnetised")
    inner = triangles(25.0, 75.0, 2000)
    lead = np.linspace(1.0, 25.0, 500)
    force, applied, errors = 0.5, 0.0, []
    for tick, demand in enumerate(np.concatenate([lead, inner]).tolist()):
        force = plant.commit(applied, POINT.gap)
        errors.append(abs(force - demand) if tick > 1000 else 0.0)
        applied = drive.solve(demand, POINT.gap, float(density(np.array(force))))
        drive.commit(applied, POINT.gap)
    return max(errors)


@pytest.mark.slow
def test_variants_with_more_information_have_smaller_errors() -> None:
    """On a magnet with wide loops, each additional information reduces the error; the flux needs no
    model."""
    errors = {variant: worst_force(variant) for variant in VARIANTS}
    assert errors["single-valued"] < errors["linearised"] < 0.5 * errors["secant"]
    assert errors["play"] < 0.6 * errors["single-valued"]
    assert errors["simplified"] < 0.4 * errors["single-valued"]
    assert errors["full"] < 0.05 * errors["single-valued"]
    assert errors["flux"] < 0.2 * errors["single-valued"]


# One law, three formats


@pytest.mark.first(1)
@pytest.mark.parametrize("variant", VARIANTS)
def test_the_three_formats_are_one_law(variant: MethodName) -> None:
    drives = [fitted(variant, number_format) for number_format in FORMATS]
    scales = drives[0].scales
    assert all(drive.scales == scales for drive in drives)
    # An entry of a map is rounded to 16 bits; so are tables and arms of a compensator, in several
    # places.
    fixed = {"play": 1.5 * 2.0**-15}.get(variant, 0.51 * 2.0**-15 if variant in MAPS else 2e-4)
    bounds = np.array([0.0, 4e-5, fixed]) * scales.current
    rng = np.random.default_rng(8)
    ticks = np.arange(600)
    forces = 50.0 + 25.0 * np.sin(0.05 * ticks) + 3.0 * rng.standard_normal(ticks.size)
    gaps = POINT.gap + 0.05e-3 * np.sin(0.11 * ticks)
    currents = np.zeros(3)
    for force, gap in zip(forces.tolist(), gaps.tolist(), strict=True):
        fluxes = (1.6 * currents).tolist()  # each probe sees its own current
        currents = np.array(
            [drive.solve(force, gap, flux) for drive, flux in zip(drives, fluxes, strict=True)]
        )
        assert (np.abs(currents - currents[0]) <= bounds).all()
        applied = round(currents[0] / 1e-4) * 1e-4
        expected = np.array([drive.commit(applied, gap) for drive in drives])
        assert np.abs(expected - expected[0]).max() < 2e-4 * scales.demand


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("number_format", FORMATS)
def test_committing_the_solved_current_gives_the_demand(
    variant: MethodName, number_format: NumberFormat
) -> None:
    drive = fitted(variant, number_format)
    for force in (20.0, 50.0, 35.5, 80.25):
        expected = drive.commit(drive.solve(force, POINT.gap), POINT.gap)
        assert expected == pytest.approx(force, rel=0.0, abs=2.0**-30 * drive.scales.demand)


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("number_format", FORMATS)
def test_a_fresh_drive_and_one_in_another_process_remember_nothing(
    variant: MethodName, number_format: NumberFormat
) -> None:
    drive = fitted(variant, number_format)
    first = drive.solve(60.0, POINT.gap, 0.5)
    for force in (20.0, 80.0, 60.0):
        drive.commit(drive.solve(force, POINT.gap, 0.5), POINT.gap)
    assert drive.reset_copy().solve(60.0, POINT.gap, 0.5) == first
    assert pickle.loads(pickle.dumps(drive)).solve(60.0, POINT.gap, 0.5) == first
    if variant not in MAPS:
        assert drive.solve(60.0, POINT.gap, 0.5) != first


def test_every_method_has_a_row() -> None:
    assert tuple(METHODS) == VARIANTS


# The flux loop


def test_the_flux_loop_is_as_fast_as_its_delay_allows() -> None:
    loops, _, calibration = known()
    delayed = replace(calibration, delay=2.0 / RATE)
    lagging = replace(delayed, lag=1.0 / RATE)
    drives = [
        make_compensator("flux", Sources(POINT, loops, None, given), "f64")
        for given in (calibration, delayed, lagging)
    ]
    crossovers = [2.0 * np.pi * drive.parameters.constants["crossover_Hz"] for drive in drives]
    # The proportional part cancels the lag, so that it does not count twice.
    assert crossovers == pytest.approx([0.5 * RATE / 1.5, 0.5 * RATE / 2.5, 0.5 * RATE / 2.5])
    first, _, third = (drive.parameters.constants for drive in drives)
    assert first["k_p_A_per_T"] == 0.0
    assert third["k_p_A_per_T"] == pytest.approx(third["k_i_A_per_T_s"] / RATE)


@pytest.mark.parametrize(
    ("lags", "least"),
    [
        pytest.param([], 60.0, id="none"),
        pytest.param([64e-6, 32e-6], 51.0, id="amplifier and probe of the example"),
        pytest.param([64e-6, 32e-6, 100e-6], 33.0, id="eddy currents on top"),
    ],
)
def test_the_flux_loop_keeps_its_phase_margin(lags: list[float], least: float) -> None:
    """For an iron of constant slope, with zero-order hold for its low-passes."""
    loops, _, calibration = known()
    tick = 1.0 / RATE
    numbers = make_compensator(
        "flux", Sources(POINT, loops, None, replace(calibration, delay=tick, lag=sum(lags))), "f64"
    ).parameters.constants
    above = below = np.ones(1)
    if lags:
        slow = np.poly([-1.0 / lag for lag in lags])
        above, below, _ = cont2discrete((slow[-1:], slow), tick)
    omega = 2.0 * np.pi * np.linspace(50.0, 0.45 * RATE, 20000)
    z = np.exp(1j * omega * tick)
    slope = 2.0 * np.pi * numbers["crossover_Hz"] / numbers["k_i_A_per_T_s"]
    controller = numbers["k_p_A_per_T"] + numbers["k_i_A_per_T_s"] * tick / (z - 1.0)
    loop = slope * controller * np.polyval(np.ravel(above), z) / np.polyval(below, z) / z
    last = int(np.flatnonzero(np.abs(loop) > 1.0)[-1])
    assert 180.0 + np.degrees(np.unwrap(np.angle(loop))[last]) > least


def test_the_calibration_is_the_best_constant_over_the_root_of_the_force() -> None:
    force = np.array([10.0, 40.0, 90.0, 10.0, 40.0, 90.0])
    gap = np.repeat([0.3e-3, 0.6e-3], 3)
    series = FluxCalibration(gap, force, np.sqrt(force) * np.repeat([0.1, 0.12], 3), 5e-5, 0.0)
    found = series.density_at(np.array([0.0, 100.0]), np.array([0.3e-3, 0.45e-3, 0.6e-3]))
    assert found == pytest.approx(np.array([[0.0, 1.0], [0.0, 1.1], [0.0, 1.2]]))


# Refusals


def test_inputs_that_do_not_fit_are_refused() -> None:
    loops, model, _ = known()
    wide = replace(POINT, gap_range=(0.2e-3, 0.55e-3))
    with refused("gaps-not-covered loops"):
        make_compensator("single-valued", Sources(wide, loops), "f64")
    with refused("gaps-not-covered model"):
        make_compensator("full", Sources(wide, loops, model), "f64")
    with refused("no-model"):
        make_compensator("full", Sources(POINT, loops), "f64")
    with refused("no-loops"):
        make_compensator("ratio", Sources(POINT, None, model), "f64")
    with refused("no-hall-probe flux"):
        make_compensator("flux", Sources(POINT, loops, model), "f64")
    with refused("force-not-reached loops: 1000 N"):
        fit_surface(loops, (0.0, 1000.0), RANGE)
    bare = Loops((replace(loops.loops[0], schedule=None),), loops.input, loops.output)
    with refused("columns-missing loops"):
        fit_surface(bare, (0.0, 90.0), RANGE)
    with refused("no-valid-range valid"):
        make_compensator("simplified", Sources(POINT, loops, replace(model, valid=None)), "f64")


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"gap": 0.6e-3}, "out-of-range gap"),
        ({"force": 95.0}, "out-of-range force"),
        ({"current_max": 0.0}, "not-above-zero"),
    ],
)
def test_an_operating_point_beyond_its_limits_is_refused(changes: dict[str, float], match: str) -> None:
    with refused(match):
        replace(POINT, **changes)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"force": [1.0, 2.0]}, "length-differs gap"),
        ({"flux_density": [np.nan]}, "not-finite flux_density"),
        ({"delay": 0.0}, "delay-not-above-zero"),
        ({"lag": -1e-6}, "delay-not-above-zero"),
    ],
)
def test_a_calibration_that_does_not_hold_together_is_refused(changes: dict[str, object], match: str) -> None:
    one = np.array([1.0])
    given: dict[str, object] = {"gap": one, "force": one, "flux_density": one}
    given |= {"delay": 5e-5, "lag": 0.0}
    with refused(match):
        FluxCalibration(**(given | changes))  # type: ignore[arg-type]


def test_a_calibration_without_force_is_refused() -> None:
    zeros = np.zeros(3)
    series = FluxCalibration(np.full(3, 1e-3), zeros, zeros, 5e-5, 0.0)
    with refused("not-monotone"):
        series.density_at(zeros, zeros)


# What pushes as well as it pulls


BOTH = OperatingRange(0.42e-3, 0.0, RATE, RANGE, 36.0, 2.0, is_bipolar=True)


@cache
def thrusts() -> tuple[Loops, Model]:
    """Return loops of a thrust proportional to the flux, in both directions, and their model."""
    whole = magnet()
    model = replace(
        whole,
        output=QUANTITIES["thrust"],
        parameters={**whole.parameters, "c_out": 30.0, "out_0": (1.0, 0.0, -1.5)},
        valid=ValidRange((-2.0, 2.0), (-50.0, 50.0), (GAPS[0], GAPS[-1])),
    )
    loops = []
    for gap in GAPS:
        for low, high in ((-2.0, 2.0), (-0.8, 1.5)):
            drive = np.append(triangles(low, high, 400), low)
            thrust = model.predict(drive, gap, history="demagnetised").output[-401:]
            at, name = np.full(401, gap), f"{low:g} to {high:g}"
            loops.append(Loop(name, drive[-401:], thrust, at, history=History("settled")))
    names = QUANTITIES["current"], QUANTITIES["thrust"], QUANTITIES["gap"]
    return Loops(tuple(loops), *names), model


@cache
def thrust_error(variant: MethodName, number_format: NumberFormat) -> float:
    """Return the largest error of a decaying thrust in both directions, N."""
    loops, model = thrusts()
    drive = make_compensator(variant, Sources(BOTH, loops, model), number_format)
    true, worst = model.stepper(BOTH.gap, "demagnetised"), 0.0
    swing = 33.0 * np.exp(-np.arange(2000) / 1500.0) * np.sin(np.arange(2000) / 60.0)
    for place, wanted in enumerate(swing.tolist()):
        current = drive.solve(wanted, BOTH.gap)
        thrust = true.commit(current)
        drive.commit(current, BOTH.gap)
        if place > 400:  # the first cycles leave the demagnetised state
            worst = max(worst, abs(thrust - wanted))
    return worst


@pytest.mark.parametrize("number_format", ["f64", "f32"])
def test_bipolar_thrust_is_followed_through_zero(number_format: NumberFormat) -> None:
    errors = [thrust_error(name, number_format) for name in ("single-valued", "play", "full")]
    assert errors[2] < 0.1
    assert errors[2] < 0.3 * errors[1] < 0.6 * errors[0]
    assert errors[0] < 6.0


@pytest.mark.parametrize("variant", ["single-valued", "play"])
def test_a_map_of_both_signs_ends_at_its_limits(variant: MethodName) -> None:
    drive = make_compensator(variant, Sources(BOTH, *thrusts()), "f64")
    for demand in (-math.inf, -1e3, 1e3, math.inf):
        assert -2.0 <= drive.solve(demand, BOTH.gap) <= 2.0
    assert drive.solve(math.nan, BOTH.gap) == drive.solve(0.0, BOTH.gap)
    assert drive.solve(-1e3, BOTH.gap) < -0.5
    assert drive.solve(1e3, BOTH.gap) > 0.5
    assert drive.commit(drive.solve(-20.0, BOTH.gap), BOTH.gap) == -20.0
