"""Design the shortest move that makes the calibration errors of a stage's magnets identifiable.

The move has the turnarounds of the rig file's set-point, without phases of constant speed, along
each coordinate that the long stroke follows. It must resemble the set-point, because the
calibration also absorbs errors of the hysteresis model. The parameter estimator computes the
information in a simulated motion of the nominal stage.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from anhyst.data.table import check_recording
from anhyst.support.atomic import PathLike, check_path, check_picture, write_figure
from anhyst.support.errors import InputError, NegativeResult
from anhyst.support.kinds import UNKNOWN_FILE, file_kind
from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.calibration import CalibratedMethod, ParameterName
from anhyst_rigs.rig.fitting import IdentifiedMagnet
from anhyst_rigs.rig.loop import Scenario
from anhyst_rigs.rig.recording import Recording
from anhyst_rigs.rig.stage.drives import usual_allocation, wrench_layout
from anhyst_rigs.rig.stage.file import read_stage
from anhyst_rigs.rig.stage.fitted import identify_stage_magnet, make_stage
from anhyst_rigs.rig.stage.geometry import mass_matrix, scan_direction, weight_wrench
from anhyst_rigs.rig.stage.loop import Feedforward, StageSetup, run_scenario, track
from anhyst_rigs.rig.stage.setpoint import (
    STROKE_ERROR_DELAY_S,
    SetPoint,
    scan_motion,
    stroke_error_from_acceleration,
    tick_times,
)
from anhyst_rigs.study.tracking.bodies import COMPARISON_START_S, StageLaw
from anhyst_rigs.study.tracking.estimator import ParameterEstimator, calibrate_from_motions
from anhyst_rigs.study.tracking.motion import MotionLaw, refuse_slow_amplifier
from anhyst_rigs.study.tracking.simulate import COMPENSATOR, refuse_unstable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TESTED_ACCELERATION_FRACTIONS = np.arange(1.0, 0.0, -0.05)
"""Tested fractions of the set-point's accelerations; the largest feasible fraction is used."""
MAX_LEG_FORCE_TO_MAX_FORCE = 0.95
"""Largest force that a leg of the move may demand, as a fraction of a magnet's largest force."""
Legs = Mapping[str, SetPoint]
"""Legs by coordinate. A leg is a motion from rest to rest; the legs follow one after another."""


def candidate_legs(rig: BodyRig) -> dict[str, list[SetPoint]]:
    """Return candidate legs for each axis, within the set-point's snap, jerk, speed and travel."""
    file, legs = rig.settings, dict[str, list[SetPoint]]()
    scan, layout = file.scan, wrench_layout(file, usual_allocation(file), rig.idle_force)
    axis_rows = zip(file.body.free, scan_direction(file), mass_matrix(file), strict=True)
    for axis, scan_component, mass_row in axis_rows:
        wrenches = max(scan.train_m_per_s2) * np.outer(
            [*TESTED_ACCELERATION_FRACTIONS, *-TESTED_ACCELERATION_FRACTIONS], mass_row
        ) - weight_wrench(file)
        forces = np.abs([layout.share(wrench)[0] for wrench in wrenches.tolist()]).max(axis=1)
        is_feasible = (
            forces.reshape(2, -1).max(axis=0) <= MAX_LEG_FORCE_TO_MAX_FORCE * file.tracking.force_max_N
        )
        if not is_feasible.any() or (axis not in ("x", "y") and not scan_component):
            continue
        acceleration_fraction = float(TESTED_ACCELERATION_FRACTIONS[is_feasible][0])
        accelerations = [acceleration_fraction * acceleration for acceleration in scan.train_m_per_s2]
        # The number must be odd, so that the second repetition is reversed.
        accelerations += accelerations[: 1 - len(accelerations) % 2]
        phases, last_acceleration = (scan.jerk_phase_s, scan.snap_phase_s), accelerations[0]
        speeds = np.geomspace(
            max(accelerations) * phases[0], acceleration_fraction * scan.speed_m_per_s, 3
        ).tolist()
        legs[axis] = [
            SetPoint(
                (*accelerations, *accelerations, last_acceleration), speed, 0.0, *phases, has_final_rest=True
            )
            for speed in speeds
        ]
    return legs


def fly_legs(setup: StageSetup, legs: Legs, seed: int = 0) -> Recording:
    """Simulate a stage that follows legs from rest, with demagnetised iron and mass feedforward."""
    rig, file = setup.rig, setup.rig.settings
    start_s = COMPARISON_START_S  # The magnets take up the weight before this time.
    n = round((start_s + sum(leg.duration for leg in legs.values())) / rig.dt)
    time = tick_times(rig, n + 1)
    position, frame, acceleration = np.zeros((3, n + 1, len(file.body.free)))
    for column, axis in enumerate(file.body.free):
        if leg := legs.get(axis):
            leg_time = time - start_s
            position[:, column] = leg.derivatives_at(leg_time)[0]
            acceleration[:, column] = leg.derivatives_at(leg_time + rig.loop_delay)[1]
            delayed_acceleration = leg.derivatives_at(leg_time - STROKE_ERROR_DELAY_S)[1] / max(leg.peaks)
            frame[:, column] = position[:, column] + stroke_error_from_acceleration(
                rig, delayed_acceleration, time
            )
            start_s += leg.duration
    assumed_file = setup.assumed_rig.settings
    wrench = acceleration[:n] @ mass_matrix(assumed_file).T - weight_wrench(assumed_file)
    return run_scenario(setup, Scenario(position[:n], feed=wrench, frame=frame), seed)


def select_legs(estimator: ParameterEstimator, setup: StageSetup) -> Legs:
    """Return the shortest of those legs that identify the largest number of parameters."""
    candidates = list[list[tuple[str, SetPoint, FloatArray] | None]]()
    for axis, motions in candidate_legs(setup.rig).items():
        rows = [estimator.information_rows(fly_legs(setup, {axis: leg})) for leg in motions]
        candidates.append([None, *((axis, *candidate) for candidate in zip(motions, rows, strict=True))])

    def rank(legs: Sequence[tuple[str, SetPoint, FloatArray]]) -> tuple[int, float]:
        relative_sigmas = np.array([*estimator.relative_sigma(*(rows for _, _, rows in legs)).values()])
        return -int((relative_sigmas <= estimator.law.max_sigma_ratio).sum()), sum(
            leg.duration for _, leg, _ in legs
        )

    best_legs = min(([leg for leg in legs if leg] for legs in product(*candidates)), key=rank)
    return {axis: leg for axis, leg, _ in best_legs}


@dataclass(frozen=True)
class Information:
    """The information about the parameters from a simulated motion of the nominal stage."""

    duration_s: float
    condition: float  # condition number of the information matrix, scaled by the priors
    left: Mapping[ParameterName, float]  # ratio of posterior to prior standard deviation
    hidden: Sequence[ParameterName]


@dataclass(frozen=True)
class CalibratingMove:
    """A calibration move and its simulation.

    Parameters
    ----------
    legs : mapping of str to SetPoint
        The motion of each coordinate, one after another.
    run : Recording
        Recording of the virtual stage, an input of ``anhyst calibrate``.
    move, work : Information
        Information from the move, and from the training set-point of the rig file.
    rejection : str or None
        Why ``calibrate`` would reject the recording for the hysteresis model, and a remedy.
    """

    legs: Legs
    run: Recording
    move: Information
    work: Information
    rejection: str | None = None

    def as_dict(self) -> dict[str, Any]:
        """Return the content of the JSON output."""
        legs = {axis: asdict(leg) for axis, leg in self.legs.items()}
        return {
            "legs": legs,
            "move": asdict(self.move),
            "work": asdict(self.work),
            "rejection": self.rejection,
        }

    def figure(self) -> Figure:
        """Draw the accelerations of all coordinates, one after another."""
        from matplotlib.figure import Figure

        figure, begin = Figure(figsize=(8.0, 3.6), layout="constrained"), 0.0
        ax = figure.subplots()
        for axis, leg in self.legs.items():
            time = np.linspace(0.0, leg.duration, 2000)
            ax.plot(begin + time, leg.derivatives_at(time)[1], lw=0.9, label=axis)
            begin += leg.duration
        ax.set(xlabel="time [s]", ylabel="acceleration [m/s²]")
        ax.legend(frameon=False)
        return figure


def find_move(rig: BodyRig, magnet: IdentifiedMagnet | None = None) -> CalibratingMove:
    """Design the move of a stage, simulate it, and compute its information about each parameter."""
    refuse_slow_amplifier(rig)
    identified_magnet, scan = magnet or identify_stage_magnet(rig), rig.settings.scan
    setup = make_stage(rig, identified_magnet, COMPENSATOR)
    estimator = ParameterEstimator(StageLaw(rig, identified_magnet, COMPENSATOR))
    refuse_unstable(setup)
    legs = select_legs(estimator, setup)
    run = fly_legs(setup, legs, 1) if legs else None
    if run is None or run.loss is not None:
        reason = "[spread] states no errors, or control is lost" if run is None else f"lost {run.loss_text}"
        raise NegativeResult(f"{rig.path}: no move identifies a parameter: {reason}", code="nothing-shown")

    def information(run: Recording) -> Information:
        rows = estimator.information_rows(run)
        relative_sigmas = dict.fromkeys(
            (name for name, relative_sigma in estimator.prior_sigma.items() if relative_sigma), 1.0
        )
        relative_sigmas |= estimator.relative_sigma(rows)
        hidden_names = [
            name for name, sigma in relative_sigmas.items() if sigma > estimator.law.max_sigma_ratio
        ]
        return Information(
            float(run["t_s"][-1]), estimator.condition_number(rows), relative_sigmas, hidden_names
        )

    training_run = track(setup, scan_motion(scan, scan.train_m_per_s2), Feedforward(), 1)
    rejection = _find_rejection(estimator.law, run, training_run)
    if rejection is not None and rig.settings.flux_sensor is None:
        raise NegativeResult(f"{rig.path}: {rejection}", code="move-rejected")
    return CalibratingMove(legs, run, information(run), information(training_run), rejection)


def _find_rejection(law: MotionLaw, run: Recording, training_run: Recording) -> str | None:
    """Return why ``calibrate`` would reject the recording of a move, and a remedy; None if not."""

    def calibrate(tested: Recording) -> CalibratedMethod:
        return calibrate_from_motions(law, [law.make_motion(tested.columns)])

    move = calibrate(run)
    if move.is_applied:
        return None
    is_training_accepted = calibrate(training_run).is_applied
    remedy = "record its own set-point" if is_training_accepted else "its own set-point is rejected too"
    return f"calibrate would reject '{law.method}' on this motion: {move.summary}; {remedy}"


def excite_to_calibrate(rig: PathLike, out: PathLike, *, plot: PathLike | None = None) -> CalibratingMove:
    """Simulate and record the shortest move that identifies the calibration errors of a stage.

    Parameters
    ----------
    rig, out : path-like
        Rig file of a stage, and recording to write, which is an input of ``anhyst calibrate``.
    plot : path-like, optional
        Picture of the move to write, ``.png``, ``.svg`` or ``.pdf``.

    Returns
    -------
    CalibratingMove
    """
    check_path(rig, "excite_to_calibrate: rig", "the path of a rig file")
    check_path(out, "excite_to_calibrate: out")
    kind = file_kind(rig)
    if kind is not UNKNOWN_FILE and not kind.has_option("excite", "--calibrate"):
        raise InputError(
            f"{rig}: --calibrate is for stages; calibrate a bearing with any recording in which "
            "its reference moves; force rigs are not calibrated",
            code="option-not-for-this",
            key="--calibrate",
        )
    stage_rig = read_stage(rig)
    check_recording(out, [stage_rig.path, *stage_rig.measured_loops.files])
    if plot is not None:
        check_picture(plot)
    calibrating_move = find_move(stage_rig)
    calibrating_move.run.save(out)
    if plot is not None:
        write_figure(calibrating_move.figure(), plot)
    return calibrating_move
