"""Simulate random plants of bearings, force rigs, piezo stages and stages with every method.

Force control runs the compiled compensators without firmware and link, which gives the same bits.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from anhyst.compensate.force_controller import ForceController
from anhyst.compensate.methods import make_compensator
from anhyst.compensate.sources import OperatingRange, Sources
from anhyst.control.controller_file import ControllerFile
from anhyst.data import Loops
from anhyst.model.actuator import Model
from anhyst.support.atomic import PathLike
from anhyst.support.jobs import Progress, map_ordered
from anhyst.support.kinds import MethodName
from anhyst.support.numeric import rms
from anhyst_rigs.rig.bearing.held import levitation_loss_time
from anhyst_rigs.rig.bearing.loop import BearingSetup, make_setups
from anhyst_rigs.rig.bearing.scenario import plan_steps
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.drift import Drift, drifted_file, drifted_plant
from anhyst_rigs.rig.file import RigFile
from anhyst_rigs.rig.fitting import IdentifiedMagnet
from anhyst_rigs.rig.force.bench import ActuatorStand, run_open_loop, triangle_demand
from anhyst_rigs.rig.force.file import ForceControlRig, read_rig
from anhyst_rigs.rig.force.programs import identify_force_model, read_rig_loops
from anhyst_rigs.rig.from_loops import complete_rig
from anhyst_rigs.rig.loop import Scenario, SimulatedLoop
from anhyst_rigs.rig.piezo import PiezoRig, read_piezo_rig
from anhyst_rigs.rig.recording import Recording, peak_deviation
from anhyst_rigs.rig.stage.file import read_stage
from anhyst_rigs.rig.stage.fitted import identify_stage_magnet
from anhyst_rigs.rig.stage.loop import Feedforward, StageSetup, track
from anhyst_rigs.rig.stage.setpoint import scan_motion
from anhyst_rigs.rig.tables import SPREADS
from anhyst_rigs.study.bearing.inputs import check_inputs, read_files
from anhyst_rigs.study.bearing.responses import evaluate_step, position_resolution
from anhyst_rigs.study.engine.beneficial_conditions import BENEFICIAL_CONDITIONS
from anhyst_rigs.study.engine.monte_carlo import PlantMetric, Plants
from anhyst_rigs.study.force_trials import ForceTrial, plan_trials
from anhyst_rigs.study.piezo import (
    DEVIATION_METRICS,
    find_inverses,
    first_evaluated_tick,
    follow_reference,
    make_reference,
)
from anhyst_rigs.study.tracking.estimator import calibrate_running_stage
from anhyst_rigs.study.tracking.measures import (
    MOVING_AVERAGE,
    PEAK_ERROR,
    SETTLING_TIME,
    cross_talk,
    cross_talk_metrics,
    measure,
    stationary_axes,
)
from anhyst_rigs.study.tracking.simulate import (
    COMPENSATOR,
    TRAINING_SEED,
    check_calibration,
    make_variants,
    refuse_unstable,
    tune_and_calibrate,
)

STANDSTILL_S = 0.25
BEARING_METHODS: tuple[MethodName, ...] = ("ratio", "single-valued")
"""Methods that are compared with the variant of the controller file."""


def bearing_plants(
    rig: BodyRig,
    controller: ControllerFile,
    methods: Sequence[MethodName] | None = None,
    seed: int | None = None,
) -> Plants:
    """Return the random plants of a bearing; all use the controller of the nominal plant."""
    main_variant = controller.settings.compensation.variant
    names = tuple(dict.fromkeys((*BEARING_METHODS, main_variant))) if methods is None else tuple(methods)
    inputs = check_inputs(rig, controller)
    setups = make_setups(inputs.rig, controller, inputs.identify_magnet(), names)
    height_cases = tuple(rig.settings.step.heights_m), "height_m"
    files = [*rig.measured_loops.files, rig.model_path, rig.flux_table_path, controller.model]
    return Plants(
        file=inputs.rig.settings,
        run=partial(run_bearing, setups),
        methods=names,
        main_method=main_variant if main_variant in names else names[-1],
        figures=(
            PlantMetric("overshoot_percent", "overshoot", "%", 1.0, *height_cases),
            PlantMetric("settling_s", "settling", "ms", 1e3, *height_cases),
            PlantMetric("standstill_rms_m", "standstill, rms", "nm", 1e9),
        ),
        input_files=tuple(path for path in files if path is not None),
        setting_texts={"controller": controller.settings.model_dump_json()},
        seed=rig.settings.seed if seed is None else seed,
        beneficial_condition=BENEFICIAL_CONDITIONS["feedback"],
    )


def run_bearing(
    setups: Mapping[MethodName, BearingSetup], method: MethodName, drift: Drift, noise: int
) -> dict[str, Any]:
    """Simulate a plant of a bearing; return its metrics, or only the time of a loss of levitation."""
    setup = setups[method]
    rig, settings = setup.rig, setup.rig.settings
    scenario = plan_steps(
        rig, setup.controller, settings.gap_m, settings.step.heights_m, final_hold_time=STANDSTILL_S
    )
    loop = SimulatedLoop(setup, plant=drifted_plant(rig, drift, noise))
    recording = loop.run(scenario)
    lost_at_s = levitation_loss_time(rig, recording, scenario.lift_end_tick)
    if lost_at_s is None and len(recording) < scenario.ticks:
        lost_at_s = float(recording["t_s"][-1])
    if lost_at_s is not None:
        return {"lost_s": lost_at_s}
    return _evaluate_steps(rig, drifted_file(settings, drift), scenario, recording)


def _evaluate_steps(
    rig: BodyRig, drifted_settings: RigFile, scenario: Scenario, recording: Recording
) -> dict[str, Any]:
    """Evaluate steps with the drifted sensor's readings, because its offset is not an overshoot."""
    sensor = drifted_settings.gap_sensor
    gap_reading = (1.0 + sensor.gain_error) * recording["gap_m"] + sensor.offset_m
    time, reference = recording["t_s"], recording["reference_m"]
    heights = drifted_settings.step.heights_m
    overshoot, settling = [0.0] * len(heights), [0.0] * len(heights)
    for step_number, step in enumerate(scenario.steps):
        step_rows = slice(step.begin - 1, step.end)
        figures = evaluate_step(
            time[step_rows], reference[step_rows], gap_reading[step_rows], position_resolution(rig)
        )
        index = step_number // 2
        overshoot[index] = max(overshoot[index], figures.overshoot_percent)
        settling[index] = max(settling[index], figures.settling_in_noise_s)
    standstill_gap = recording["gap_m"][-round(STANDSTILL_S / rig.dt) :]
    return {
        "overshoot_percent": overshoot,
        "settling_s": [time_s if math.isfinite(time_s) else None for time_s in settling],
        "standstill_rms_m": float(np.std(standstill_gap)),
    }


def read_bearing_plants(rig: PathLike, controller: PathLike | None, progress: Progress | None) -> Plants:
    """Read the files of a bearing, and return its random plants."""
    return bearing_plants(*read_files(rig, controller))


FORCE_METHODS: tuple[MethodName, ...] = ("ratio", "single-valued", "full")


def force_plants(rig: ForceControlRig, model: Model | None = None, loops: Loops | None = None) -> Plants:
    """Return the random plants of a force rig: at every held position, and with a moving armature.

    The compensators are identified from the loops of the rig file, unless other loops are given.
    """
    loops = loops or read_rig_loops(rig)
    rig = complete_rig(rig, loops)
    model, settings = model or identify_force_model(rig, loops), rig.settings
    gaps = sorted(gap for gap in loops.by_schedule() if gap is not None)
    force_max = settings.force.force_max_N
    operating = OperatingRange(
        gap=0.5 * (gaps[0] + gaps[-1]),
        force=0.5 * force_max,
        rate=settings.timing.rate_Hz,
        gap_range=(gaps[0], gaps[-1]),
        force_max=force_max,
        current_max=settings.amplifier.current_high_A,
    )
    sources = Sources(operating, loops, model)
    compensators = {name: make_compensator(name, sources, "fixed") for name in FORCE_METHODS}
    trial_cases = tuple(trial.name for trial in _plan_trials(rig)), "trial"
    files = [*rig.measured_loops.files]
    if settings.solenoid is not None:
        files.append(rig.path.parent / settings.solenoid.file)
    return Plants(
        file=settings,
        run=partial(run_force, rig, compensators),
        methods=FORCE_METHODS,
        main_method="full",
        figures=(
            PlantMetric("rms_N", "force error, rms", "N", 1.0, *trial_cases),
            PlantMetric("worst_N", "force error, worst", "N", 1.0, *trial_cases),
        ),
        input_files=tuple(files),
        setting_texts={},
        seed=settings.seed,
        beneficial_condition=BENEFICIAL_CONDITIONS["force"],
    )


def read_force_plants(rig: PathLike, controller: PathLike | None, progress: Progress | None) -> Plants:
    """Read a force rig, and return its random plants."""
    return force_plants(read_rig(rig))


def _plan_trials(rig: ForceControlRig) -> list[ForceTrial]:
    force_max, rate = rig.settings.force.force_max_N, rig.settings.timing.rate_Hz
    demands = [triangle_demand(shape, force_max, rate) for shape in rig.settings.force_triangles]
    return [trial for trial in plan_trials(rig, demands) if trial.trial_stage != "end"]


def run_force(
    rig: ForceControlRig,
    compensators: Mapping[MethodName, ForceController],
    method: MethodName,
    drift: Drift,
    noise: int,
) -> dict[str, Any]:
    """Control the force of a plant in every trial; the iron is demagnetised before."""
    plant = drifted_rig(rig, drift)
    figures: dict[str, list[float]] = {"rms_N": [], "worst_N": []}
    for trial in _plan_trials(rig):
        gap, seed = trial.gap(rig), [noise, trial.number]
        gap_reading = rig.make_sensors(seed)["gap"].read(gap) + drift.gap_offset
        command_A = compensators[method].reset_copy().run(trial.demand.force, gap_reading)
        current = (1.0 + drift.first_scale) * command_A
        force = run_open_loop(ActuatorStand(plant, seed), gap, current)["force_N"]
        error = (force - trial.demand.force)[trial.demand.lead_in :]
        figures["rms_N"].append(rms(error))
        figures["worst_N"].append(peak_deviation(error))
    return figures


def drifted_rig(rig: ForceControlRig, drift: Drift) -> ForceControlRig:
    """Return a rig with drifted iron. The rig file or its solenoid file contains this iron."""
    file = rig.solenoid_file
    if file is None:
        return replace(rig, settings=drifted_file(rig.settings, drift))
    iron = file.iron
    keys = iron.drifted_keys(drift.pinning, drift.reversible, drift.saturation)
    return replace(rig, solenoid_file=file.model_copy(update={"iron": iron.model_copy(update=keys)}))


PIEZO_METHODS: Mapping[MethodName, str] = {"ratio": "none", "single-valued": "single-valued", "full": "full"}
"""Names of a piezo stage's inverses, by method."""


def piezo_plants(rig: PiezoRig, loops: Loops | None = None) -> Plants:
    """Return the random plants of a piezo stage; loops of the nominal stage give the compensators."""
    inverses = find_inverses(rig, loops)
    return Plants(
        file=rig.settings,
        run=partial(
            run_piezo, rig, {name: inverses[inverse_name] for name, inverse_name in PIEZO_METHODS.items()}
        ),
        methods=tuple(PIEZO_METHODS),
        main_method="full",
        figures=(
            *(
                PlantMetric(metric.key, metric.title, metric.unit, metric.factor)
                for metric in reversed(DEVIATION_METRICS)
            ),
        ),
        input_files=(),
        setting_texts={},
        seed=rig.settings.seed,
        beneficial_condition=BENEFICIAL_CONDITIONS["piezo"],
        single_case="triangle",
    )


def read_piezo_plants(rig: PathLike, controller: PathLike | None, progress: Progress | None) -> Plants:
    """Read a piezo stage, and return its random plants."""
    return piezo_plants(read_piezo_rig(rig))


def run_piezo(
    rig: PiezoRig,
    inverses: Mapping[MethodName, ForceController],
    method: MethodName,
    drift: Drift,
    noise: int,
) -> dict[str, Any]:
    """Follow the triangle with a plant; the controller is that of the nominal stage."""
    plant = replace(rig, settings=drifted_file(rig.settings, drift))
    run = follow_reference(rig, make_reference(rig), inverses[method], plant, noise)
    if run.loss is not None:
        return {"lost_s": run.dt * run.loss.tick}
    error = run["error_m"][first_evaluated_tick(rig) :]
    return {"rms_m": rms(error), "worst_m": peak_deviation(error)}


_STAGE_SPREADS = SPREADS["tracking"]
_SPREAD_KEYS = {
    **_STAGE_SPREADS.rig_wide,
    **_STAGE_SPREADS.magnet,
    "heads": next(iter(_STAGE_SPREADS.head.values())),
}
ERROR_CASES: Mapping[str, tuple[str, ...]] = {
    "none": (),
    "gap zero": ("gap_offset",),
    "current scale": ("first_scale",),
    "pinning": ("pinning",),
    "Hall gain": ("flux_gain",),
    "eddy lag": ("eddy",),
    "conductivity": ("conductivity",),
    "centre of mass": tuple(f"place_{axis}" for axis in "xyz"),
    "payload": ("mass",),
    "cable": ("cable",),
    "head positions": ("heads",),
    "all": tuple(_SPREAD_KEYS),
}
"""Errors in the plants of a stage, by case. Each error applies to all magnets at the same time."""


def varied_errors(file: RigFile) -> Mapping[str, tuple[str, ...]]:
    """Return the error cases of a stage: each varied error alone, and all together."""
    varied_names = {name for name, key in _SPREAD_KEYS.items() if getattr(file.spread, key) > 0.0}
    if file.magnet.solid is None:
        varied_names.discard("conductivity")
    return {
        title: names
        for title, names in ERROR_CASES.items()
        if title in ("none", "all") or varied_names.intersection(names)
    }


def stage_plants(
    rig: BodyRig,
    magnet: IdentifiedMagnet | None = None,
    names: Sequence[MethodName] = (),
    progress: Progress | None = None,
    *,
    errors: Mapping[str, tuple[str, ...]] | None = None,
    jobs: int | None = None,
) -> Plants:
    """Return the random plants of a stage; all variants use the gains of the calibrated stage.

    The default error cases are those of :func:`varied_errors`.
    """
    check_calibration(rig)
    knowledge = magnet or identify_stage_magnet(rig)
    setups, _ = make_variants(rig, knowledge, names)
    refuse_unstable(setups[COMPENSATOR])
    gains = map_ordered(partial(_find_gains, knowledge), list(setups.values()), progress, jobs)
    variants = dict(zip(setups, zip(setups.values(), gains, strict=True), strict=True))
    errors = errors or varied_errors(rig.settings)
    error_cases = tuple(errors), "error"
    return Plants(
        file=rig.settings,
        run=partial(run_stage, knowledge, variants, errors),
        methods=tuple(setups),
        main_method=COMPENSATOR,
        figures=tuple(
            PlantMetric(metric.key, metric.title, metric.unit, metric.factor, *error_cases)
            for metric in (MOVING_AVERAGE, PEAK_ERROR, SETTLING_TIME, *cross_talk_metrics(rig.settings))
        ),
        input_files=tuple(rig.measured_loops.files),
        setting_texts={},
        seed=rig.settings.seed,
        beneficial_condition=BENEFICIAL_CONDITIONS["stage"],
        single_case="test set-point",
    )


def read_stage_plants(rig: PathLike, controller: PathLike | None, progress: Progress | None) -> Plants:
    """Read a stage, and return its random plants."""
    return stage_plants(read_stage(rig), progress=progress)


def _find_gains(magnet: IdentifiedMagnet, setup: StageSetup) -> Feedforward:
    return tune_and_calibrate(setup, magnet)[0]


def run_stage(
    magnet: IdentifiedMagnet,
    variants: Mapping[MethodName, tuple[StageSetup, Feedforward]],
    errors: Mapping[str, tuple[str, ...]],
    method: MethodName,
    drift: Drift,
    noise: int,
) -> dict[str, Any]:
    """Follow the test set-point with each error alone, and with all errors together.

    A stage with online calibration follows the training set-point before.
    """
    setup, gains = variants[method]
    scan_case = setup.rig.settings.scan
    set_point = scan_motion(scan_case, scan_case.test_m_per_s2)
    figures: dict[str, list[float]] = {}
    for names in errors.values():
        plant = replace(setup, drift=drift.select(names))
        learner = calibrate_running_stage(plant, magnet, gains, noise + TRAINING_SEED)
        run = track(learner.corrected_stage(plant.drift) if learner else plant, set_point, gains, noise)
        if run.loss is not None:
            return {"lost_s": run.dt * run.loss.tick}
        measures = measure(run, set_point, scan_case.slit_s)
        for metric in (MOVING_AVERAGE, PEAK_ERROR, SETTLING_TIME):
            figures.setdefault(metric.key, []).append(getattr(measures, metric.key))
        for key, largest_error in cross_talk(run, set_point, stationary_axes(setup.rig.settings)).items():
            figures.setdefault(key, []).append(largest_error)
    return figures
