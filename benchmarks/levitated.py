"""Calibrate bearings that differ from their controller's model from recordings of their motion.

Plants, seeds and methods are defined here and in examples/bearing; the plants were fixed before the
first result. The first plant, whose results are in the table, has 20 % more pinning and a gap
reading that is 10 um too large. The other plants have random errors of all kinds at the same time,
as [spread] states. In this benchmark, the standard deviation of the gap zero in the rig file is 5
um.

Each method controls a plant during the steps of the example and is calibrated on this recording. It
is evaluated with other noise seeds, by the overshoot of the highest step and the force error on a
slow triangle. The metrics are given for the nominal bearing, and for the drifted bearing before and
after calibration. For the first plant, they are also given for a controller that knows the drift.
"""

from __future__ import annotations

import tempfile
import tomllib
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from pydantic import TypeAdapter

from anhyst.support.jobs import map_ordered
from anhyst.support.kinds import MethodName
from anhyst.support.numeric import rms
from anhyst_rigs import Calibration, calibrate
from anhyst_rigs.rig.bearing.loop import BearingSetup, fit_bearing_compensators, make_setup
from anhyst_rigs.rig.bearing.scenario import plan_recorded_run
from anhyst_rigs.rig.drift import NO_DRIFT, Drift, change_rig, drifted_plant, sample_plant
from anhyst_rigs.rig.fitting import calibrate_magnet, identify_magnet
from anhyst_rigs.rig.loop import SimulatedLoop
from anhyst_rigs.rig.measuring import measure_loops
from anhyst_rigs.rig.parts.iron import IronEntry, NamedIron
from anhyst_rigs.rig.recording import Recording
from anhyst_rigs.study.bearing.experiments import plan_trajectory
from anhyst_rigs.study.bearing.inputs import BearingInputs, check_inputs, read_files
from anhyst_rigs.study.plants import run_bearing
from rows import ROOT, Row
from tracking import IRONS

RIG = ROOT / "examples" / "bearing" / "rig.toml"
PLANTS, SEED, NOISES = 6, 30, (1, 2, 3)
METHODS: tuple[MethodName, ...] = ("full", "play", "single-valued")
TABLE_DRIFT = Drift(pinning=0.2, gap_offset=10e-6)
MAX_RATIO = 1.2
OTHER_IRONS = ("preisach-usual", "preisach-hard", "duhem-usual")
GAP_ZERO_SIGMA_M = {"spread.gap_zero_m": 5e-6}

BearingMetrics = tuple[float, float]
"""Overshoot of the highest step, %, and rms force error on the triangle, N."""


def evaluate_controller(setup: BearingSetup, drift: Drift) -> BearingMetrics:
    """Return the metrics of one controller on one plant, averaged over the noise seeds."""
    scenario, begin_tick = plan_trajectory(setup, setup.rig.settings.trajectories[0])
    metrics = []
    for noise in NOISES:
        step_results = run_bearing({setup.method: setup}, setup.method, drift, noise)
        plant = drifted_plant(setup.rig, drift, noise)
        run = SimulatedLoop(setup, plant=plant).run(scenario).slice_ticks(begin_tick, scenario.ticks)
        metrics.append((step_results["overshoot_percent"][-1], rms(run["force_N"] - run["demand_N"])))
    overshoot, force = np.mean(metrics, axis=0).tolist()
    return overshoot, force


def record_steps(setup: BearingSetup, drift: Drift) -> Recording:
    """Return the recording of a plant that is lifted off and stepped up and down."""
    return SimulatedLoop(setup, plant=drifted_plant(setup.rig, drift, 0)).run(
        plan_recorded_run(setup.rig, setup.controller)[0]
    )


def calibrate_plant(
    inputs: BearingInputs, method_and_drift: tuple[MethodName, Drift]
) -> tuple[Calibration, BearingMetrics, BearingMetrics]:
    """Return the calibration of a plant, and its metrics before and after."""
    method, drift = method_and_drift
    identified_magnet, table = inputs.identify_magnet(), inputs.controller.settings
    nominal_setup = make_setup(inputs.rig, table, identified_magnet, method, "fixed")
    with tempfile.TemporaryDirectory() as folder:
        calibration = calibrate(
            inputs.rig,
            record_steps(nominal_setup, drift),
            Path(folder) / "calibration.toml",
            magnet=identified_magnet,
            methods=[method],
            controller=inputs.controller,
        )
        calibrated_rig, calibrated_setup = inputs.rig, nominal_setup
        if calibration.has_estimates:
            calibrated_rig = change_rig(calibrated_rig, {"control.calibration": "calibration.toml"})
            calibrated_rig = replace(calibrated_rig, path=Path(folder) / "rig.toml")
            calibrated_setup = make_setup(calibrated_rig, table, identified_magnet, method, "fixed")
    return (
        calibration,
        evaluate_controller(nominal_setup, drift),
        evaluate_controller(calibrated_setup, drift),
    )


def make_known_drift_setup(inputs: BearingInputs, nominal_setup: BearingSetup) -> BearingSetup:
    """Return the controller that knows the drift of the plant in the table."""
    drifted_magnet = calibrate_magnet(
        inputs.identify_magnet(), gap_zero=TABLE_DRIFT.gap_offset, width_change=TABLE_DRIFT.pinning
    )
    table = inputs.controller.settings
    (fitted_compensator,) = fit_bearing_compensators(
        inputs.rig, table, [drifted_magnet], nominal_setup.method, "fixed"
    )
    return replace(nominal_setup, compensator=fitted_compensator)


def make_table_row(
    calibration: Calibration,
    nominal_metrics: BearingMetrics,
    drifted_metrics: BearingMetrics,
    calibrated_metrics: BearingMetrics,
    known_drift_metrics: BearingMetrics,
) -> Row:
    """Return the row of one method for the plant of the table."""
    (method,) = calibration.file.method
    metrics_text = "; ".join(
        f"{metric_name} {nominal_metrics[metric_index]:.3g} {unit} nominal, "
        f"{drifted_metrics[metric_index]:.3g} drifted, {calibrated_metrics[metric_index]:.3g} calibrated, "
        f"{known_drift_metrics[metric_index]:.3g} with known drift"
        for metric_index, (metric_name, unit) in enumerate((("overshoot", "%"), ("force error", "N")))
    )
    parameter_text = ", ".join(f"{parameter.name} {parameter.value:.3g}" for parameter in method.parameter)
    return Row(
        f"bearing, pinning +20 %, gap zero +10 um: {method.name}",
        f"calibrated <= {MAX_RATIO:g} times nominal",
        f"{metrics_text}; {method.summary}; {parameter_text}",
        all(
            value <= MAX_RATIO * calibrated_value
            for value, calibrated_value in zip(calibrated_metrics, nominal_metrics, strict=True)
        ),
    )


def make_random_plants_row(
    method: MethodName, nominal_metrics: BearingMetrics, forces: Sequence[tuple[float, float]]
) -> Row:
    """Return the row of one method for all random plants."""
    pairs = ", ".join(
        f"{drifted_error:.3g} -> {calibrated_error:.3g}" for drifted_error, calibrated_error in forces
    )
    return Row(
        f"bearing, {PLANTS} random plants: {method}, force error",
        "",
        f"{pairs} N; {nominal_metrics[1]:.3g} N nominal",
        None,
    )


def make_iron_row(inputs: BearingInputs, name: str, drift: Drift) -> Row:
    """Return the row of another iron, with measured loops and an identified model."""
    schema: TypeAdapter[NamedIron] = TypeAdapter(IronEntry)
    families = tomllib.loads(IRONS.read_text(encoding="utf-8"))
    rig = change_rig(inputs.rig, {"iron": schema.validate_python({"name": "own", **families[name]})})
    identified = identify_magnet(measure_loops(rig))
    iron_inputs = replace(inputs, rig=rig, loops=identified.loops, model=identified.model)
    calibration, drifted_metrics, calibrated_metrics = calibrate_plant(iron_inputs, ("full", drift))
    (method,) = calibration.file.method
    return Row(
        f"bearing of {name}, {'drifted' if drift == TABLE_DRIFT else 'nominal'}: full, force error",
        "",
        f"{drifted_metrics[1]:.3g} -> {calibrated_metrics[1]:.3g} N; {method.summary}",
        None,
    )


def make_method_row(inputs: BearingInputs, method: MethodName) -> Row:
    """Return the row of one method for the plant of the table."""
    setup = make_setup(inputs.rig, inputs.controller.settings, inputs.identify_magnet(), method, "fixed")
    calibration, drifted_metrics, calibrated_metrics = calibrate_plant(inputs, (method, TABLE_DRIFT))
    nominal_metrics, known_drift_metrics = (
        evaluate_controller(setup, NO_DRIFT),
        evaluate_controller(make_known_drift_setup(inputs, setup), TABLE_DRIFT),
    )
    return make_table_row(
        calibration, nominal_metrics, drifted_metrics, calibrated_metrics, known_drift_metrics
    )


def prepare_inputs() -> BearingInputs:
    """Return the example with a larger standard deviation of the gap zero than its file states."""
    rig, controller = read_files(RIG, None)
    inputs = check_inputs(change_rig(rig, GAP_ZERO_SIGMA_M), controller)
    return replace(inputs, model=inputs.identify_magnet().model)


def measure_table_plant() -> list[Row]:
    """Calibrate every method on the plant of the table."""
    return map_ordered(partial(make_method_row, prepare_inputs()), METHODS)


def rows() -> list[Row]:
    """Calibrate every method on the plant of the table, on random plants and on other irons."""
    inputs = prepare_inputs()
    random_drifts = [sample_plant(inputs.rig.settings, SEED, number)[0] for number in range(PLANTS)]
    all_outcomes = [(method, drift) for method in METHODS for drift in random_drifts]
    outcomes = dict(
        zip(all_outcomes, map_ordered(partial(calibrate_plant, inputs), all_outcomes), strict=True)
    )
    method_rows = []
    for method, method_row in zip(
        METHODS, map_ordered(partial(make_method_row, inputs), METHODS), strict=True
    ):
        setup = make_setup(inputs.rig, inputs.controller.settings, inputs.identify_magnet(), method, "fixed")
        before_and_after = [outcomes[method, drift][1:] for drift in random_drifts]
        forces = [
            (drifted_metrics[1], calibrated_metrics[1])
            for drifted_metrics, calibrated_metrics in before_and_after
        ]
        method_rows += [
            method_row,
            make_random_plants_row(method, evaluate_controller(setup, NO_DRIFT), forces),
        ]
    return method_rows + [
        make_iron_row(inputs, name, drift) for name in OTHER_IRONS for drift in (NO_DRIFT, TABLE_DRIFT)
    ]
