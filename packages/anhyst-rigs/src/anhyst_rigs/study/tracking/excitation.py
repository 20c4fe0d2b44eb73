"""The shortest move that shows what the magnets of a stage are off by, and how much it shows.

A law that is slightly wrong is learnt right where the body worked. So the move has the turnarounds
of the rig file's own set-point, slower and without a cruise, along every coordinate in which the
long stroke goes along. What that shows, the estimator itself says of a flight of the stage as it
should be.
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
from anhyst.support.kinds import UNKNOWN, kind_of
from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.calibration import ParameterName
from anhyst_rigs.rig.fitting import IdentifiedMagnet
from anhyst_rigs.rig.loop import Scenario
from anhyst_rigs.rig.recording import Recording
from anhyst_rigs.rig.stage.drives import usual_allocation, wrench_layout
from anhyst_rigs.rig.stage.file import read_stage
from anhyst_rigs.rig.stage.fitted import identify_stage, make_stage
from anhyst_rigs.rig.stage.geometry import mass_matrix, scan_direction, weight
from anhyst_rigs.rig.stage.loop import Feedforward, StageSetup, follow, track
from anhyst_rigs.rig.stage.setpoint import STRAY_LATE, SetPoint, instants, motion_of, strayed
from anhyst_rigs.study.tracking.bodies import START_S, StageLaw
from anhyst_rigs.study.tracking.learner import Learner
from anhyst_rigs.study.tracking.motion import refuse_uncalibratable
from anhyst_rigs.study.tracking.simulate import OWN, refuse_unstable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SHARES = np.arange(1.0, 0.0, -0.05)
"""Of the accelerations of the set-point: the largest is taken that the magnets can make."""
SPARE = 0.95
"""Of the largest force of a magnet: what a leg may ask for."""
Legs = Mapping[str, SetPoint]
"""By coordinate what it follows, from rest to rest, one after another."""


def legs_of(rig: BodyRig) -> dict[str, list[SetPoint]]:
    """Return what each coordinate may follow: within the set-point's snap, jerk, speed and way."""
    file, legs = rig.settings, dict[str, list[SetPoint]]()
    scan, layout = file.scan, wrench_layout(file, usual_allocation(file), rig.idle)
    lines = zip(file.body.free, scan_direction(file), mass_matrix(file), strict=True)
    for axis, along, mass in lines:
        pushed = max(scan.train_m_per_s2) * np.outer([*SHARES, *-SHARES], mass) - weight(file)
        forces = np.abs([layout.share(one)[0] for one in pushed.tolist()]).max(axis=1)
        able = forces.reshape(2, -1).max(axis=0) <= SPARE * file.tracking.force_max_N
        if not able.any() or (axis not in ("x", "y") and not along):
            continue
        share = float(SHARES[able][0])
        turns = [share * one for one in scan.train_m_per_s2]
        # an odd number, so that they come a second time the other way round
        turns += turns[: 1 - len(turns) % 2]
        phases, rest = (scan.jerk_phase_s, scan.snap_phase_s), turns[0]
        speeds = np.geomspace(max(turns) * phases[0], share * scan.speed_m_per_s, 3).tolist()
        legs[axis] = [
            SetPoint((*turns, *turns, rest), speed, 0.0, *phases, rests=True) for speed in speeds
        ]
    return legs


def fly(setup: StageSetup, legs: Legs, seed: int = 0) -> Recording:
    """Let a stage follow legs from rest, the iron demagnetised, the mass alone fed forward."""
    rig, file = setup.rig, setup.rig.settings
    begin = START_S  # the weight is taken up before
    n = round((begin + sum(leg.duration for leg in legs.values())) / rig.dt)
    time = instants(rig, n + 1)
    place, frame, fed = np.zeros((3, n + 1, len(file.body.free)))
    for at, axis in enumerate(file.body.free):
        if leg := legs.get(axis):
            since = time - begin
            place[:, at], fed[:, at] = leg.at(since)[0], leg.at(since + rig.late)[1]
            late = leg.at(since - STRAY_LATE)[1] / max(leg.peaks)
            frame[:, at] = place[:, at] + strayed(rig, late, time)
            begin += leg.duration
    believed = setup.believed.settings
    wrench = fed[:n] @ mass_matrix(believed).T - weight(believed)
    return follow(setup, Scenario(place[:n], feed=wrench, frame=frame), seed)


def design(learner: Learner, setup: StageSetup) -> Legs:
    """Return the legs that show as many numbers as any do, and of these the shortest."""
    shown = list[list[tuple[str, SetPoint, FloatArray] | None]]()
    for axis, motions in legs_of(setup.rig).items():
        rows = [learner.information(fly(setup, {axis: leg})) for leg in motions]
        shown.append([None, *((axis, *one) for one in zip(motions, rows, strict=True))])

    def order(legs: Sequence[tuple[str, SetPoint, FloatArray]]) -> tuple[int, float]:
        left = np.array([*learner.left(*(rows for _, _, rows in legs)).values()])
        return -int((left <= learner.law.seen).sum()), sum(leg.duration for _, leg, _ in legs)

    best = min(([leg for leg in legs if leg] for legs in product(*shown)), key=order)
    return {axis: leg for axis, leg, _ in best}


@dataclass(frozen=True)
class Information:
    """What a flight of the stage as it should be shows of its numbers."""

    duration_s: float
    condition: float  # number of the information on what it shows, scaled by the priors
    left: Mapping[ParameterName, float]  # of each number, in parts of its standard deviation
    hidden: Sequence[ParameterName]


@dataclass(frozen=True)
class CalibratingMove:
    """A move that shows what a stage is off by, flown.

    Parameters
    ----------
    legs : mapping of str to SetPoint
        What each coordinate follows, one after another.
    run : Recording
        Of the virtual stage, as ``anhyst calibrate`` takes it.
    move, work : Information
        What is left of each number after it and after the rig file's own training set-point.
    """

    legs: Legs
    run: Recording
    move: Information
    work: Information

    def as_dict(self) -> dict[str, Any]:
        """Return it as what is printed as JSON."""
        legs = {axis: asdict(leg) for axis, leg in self.legs.items()}
        return {"legs": legs, "move": asdict(self.move), "work": asdict(self.work)}

    def figure(self) -> Figure:
        """Draw the acceleration of every coordinate, one after another."""
        from matplotlib.figure import Figure

        figure, begin = Figure(figsize=(8.0, 3.6), layout="constrained"), 0.0
        ax = figure.subplots()
        for axis, leg in self.legs.items():
            time = np.linspace(0.0, leg.duration, 2000)
            ax.plot(begin + time, leg.at(time)[1], lw=0.9, label=axis)
            begin += leg.duration
        ax.set(xlabel="time [s]", ylabel="acceleration [m/s²]")
        ax.legend(frameon=False)
        return figure


def find_move(rig: BodyRig, magnet: IdentifiedMagnet | None = None) -> CalibratingMove:
    """Design the move of a stage, fly it, and say what is left of each number after it."""
    refuse_uncalibratable(rig)
    known, scan = magnet or identify_stage(rig), rig.settings.scan
    setup, learner = make_stage(rig, known, OWN), Learner(StageLaw(rig, known, OWN))
    refuse_unstable(setup)
    legs = design(learner, setup)
    run = fly(setup, legs, 1) if legs else None
    if run is None or run.loss is not None:
        why = "[spread] states nothing, or the loop is lost" if run is None else f"lost {run.lost}"
        raise NegativeResult(f"{rig.path}: no move shows anything: {why}", code="nothing-shown")

    def information(run: Recording) -> Information:
        rows = learner.information(run)
        left = dict.fromkeys((name for name, one in learner.priors.items() if one), 1.0)
        left |= learner.left(rows)
        hidden = [name for name, one in left.items() if one > learner.law.seen]
        return Information(float(run["t_s"][-1]), learner.condition(rows), left, hidden)

    work = track(setup, motion_of(scan, scan.train_m_per_s2), Feedforward(), 1)
    return CalibratingMove(legs, run, information(run), information(work))


def excite_to_calibrate(
    rig: PathLike, out: PathLike, *, plot: PathLike | None = None
) -> CalibratingMove:
    """Fly the shortest move that shows what the magnets of a stage are off by, and record it.

    Parameters
    ----------
    rig, out : path-like
        Rig file of a stage, and recording to write, which ``anhyst calibrate`` takes.
    plot : path-like, optional
        Picture of the move to write, ``.png``, ``.svg`` or ``.pdf``.

    Returns
    -------
    CalibratingMove
    """
    check_path(rig, "excite_to_calibrate: rig", "the path of a rig file")
    check_path(out, "excite_to_calibrate: out")
    kind = kind_of(rig)
    if kind is not UNKNOWN and not kind.has_option("excite", "--calibrate"):
        raise InputError(
            f"{rig}: --calibrate is for stages; a bearing learns from any recording in which its "
            "reference moves, a rig of force control is not calibrated",
            code="option-not-for-this",
            key="--calibrate",
        )
    stage = read_stage(rig)
    check_recording(out, [stage.path, *stage.measured.files])
    if plot is not None:
        check_picture(plot)
    found = find_move(stage)
    found.run.save(out)
    if plot is not None:
        write_figure(found.figure(), plot)
    return found
