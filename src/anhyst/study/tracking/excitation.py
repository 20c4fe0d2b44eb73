"""The shortest move that shows what the magnets of a stage are off by, and how much it shows.

A law that is slightly wrong is learnt right where the body worked. So a leg goes to and fro with
the accelerations of the rig file's own set-point, slower and without a cruise, from rest to rest,
along a coordinate in which the long stroke goes along. What it shows, the estimator itself says of
its flight of the stage as it should be.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from anhyst.data.writing import check_recording
from anhyst.rig.bearing.make_setup import IdentifiedMagnet
from anhyst.rig.calibration import CENTRE, ParameterName
from anhyst.rig.calibration import kind_of as kind_of_number
from anhyst.rig.recording import Recording, column
from anhyst.rig.stage.file import (
    StageRig,
    mass_matrix,
    read_stage,
    scan_direction,
    usual_allocation,
    weight,
    wrench_layout,
)
from anhyst.rig.stage.loop import (
    Feedforward,
    StageSetup,
    identify_stage,
    make_stage,
    track,
    track_axes,
)
from anhyst.rig.stage.setpoint import STRAY_LATE, SetPoint, instants, motion_of, strayed
from anhyst.rig.tables import Axis
from anhyst.study.tracking.bodies import law_of
from anhyst.study.tracking.learner import Learner
from anhyst.study.tracking.motion import refuse_uncalibratable
from anhyst.study.tracking.simulate import OWN, refuse_unstable
from anhyst.support.arrays import FloatArray
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError, NegativeResult
from anhyst.support.kinds import FileKind, kind_of
from anhyst.support.result import Result, columns_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

REST_S = 0.01
"""At rest before the first leg and after each."""
SHARES = np.arange(1.0, 0.0, -0.05)
"""Of the accelerations of the set-point: the largest is taken that the magnets can make."""
SPARE = 0.95
"""Of the largest force of a magnet: what a leg may ask for."""
GAIN = 0.2
"""A leg is flown that takes so much a second of the priors, on average of all numbers."""


@dataclass(frozen=True)
class Leg:
    """To and fro along one coordinate and the same turned round, from rest to rest."""

    axis: Axis
    motion: SetPoint

    @property
    def lasts(self) -> float:
        """Until the next one begins, s."""
        return 2.0 * self.motion.duration + REST_S

    def at(self, time: FloatArray) -> FloatArray:
        """Return place, acceleration, jerk and snap at some times."""
        there, back = (self.motion.at(one) for one in (time, time - self.motion.duration))
        return np.array(there) - np.array(back)


@dataclass(frozen=True)
class Move:
    """Legs one after another, from rest to rest."""

    rig: StageRig
    legs: tuple[Leg, ...]

    @property
    def duration(self) -> float:
        """Until the end, s."""
        return REST_S + sum(leg.lasts for leg in self.legs)

    @property
    def peaks(self) -> tuple[float, ...]:
        """Largest acceleration of each turnaround, m/s2."""
        return tuple(peak for leg in self.legs for peak in leg.motion.peaks)

    def at(self, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return place, acceleration, jerk, snap at some times; several coordinates in columns."""
        free, begin = self.rig.settings.body.free, REST_S
        sums = np.zeros((4, time.size, len(free)))
        for leg in self.legs:
            sums[..., free.index(leg.axis)] += leg.at(time - begin)
            begin += leg.lasts
        several = self.rig.settings.several
        place, acceleration, jerk, snap = sums if several else sums[..., 0]
        return place, acceleration, jerk, snap

    def fly(self, setup: StageSetup, seed: int = 0) -> Recording:
        """Let a stage follow it from rest, the iron demagnetised, the mass alone fed forward."""
        rig = self.rig
        if not rig.settings.several:
            return track(setup, self, Feedforward(), seed)
        time = instants(rig, round(self.duration / rig.dt) + 1)
        ahead = (rig.settings.timing.delay_ticks + 0.5) * rig.dt
        place, late = self.at(time)[0], self.at(time - STRAY_LATE)[1]
        late /= np.maximum(np.abs(late).max(axis=0), 1.0)
        frame = _carried(rig) * (place + strayed(rig, late, time[:, None]))
        file = setup.believed.settings
        wrench = self.at(time[:-1] + ahead)[1] @ mass_matrix(file).T - weight(file)
        return track_axes(setup, seed, place, frame, wrench)


def _carried(rig: StageRig) -> FloatArray:
    """Return 1 for each coordinate in which the long stroke goes along: x, y, and the set-point's."""
    level = np.array([axis in ("x", "y") for axis in rig.settings.body.free])
    return np.asarray(level | (scan_direction(rig.settings) != 0.0), dtype=np.float64)


def legs_of(rig: StageRig) -> list[Leg]:
    """Return the legs that a move may be made of: within the set-point's snap, jerk, speed and way."""
    file, found = rig.settings, list[Leg]()
    scan, masses = file.scan, mass_matrix(file)
    hardest, phases = max(scan.train_m_per_s2), (scan.jerk_phase_s, scan.snap_phase_s)
    layout = wrench_layout(file, usual_allocation(file), rig.idle)

    def makes(wrench: FloatArray) -> bool:
        both = [layout.share((way * wrench - weight(file)).tolist())[0] for way in (1.0, -1.0)]
        return bool(np.abs(both).max() <= SPARE * file.tracking.force_max_N)

    for place in np.flatnonzero(_carried(rig)).tolist():
        able = (one for one in SHARES.tolist() if makes(one * hardest * masses[place]))
        share = next(able, 0.0)
        turns = [share * one for one in scan.train_m_per_s2]
        turns += turns[: len(turns) % 2]
        least, most = share * hardest * phases[0], share * scan.speed_m_per_s
        for speed in sorted({least, math.sqrt(least * most), most}) if share else ():
            motion = SetPoint(tuple(turns), speed, 0.0, *phases, rests=True)
            found.append(Leg(file.body.free[place], motion))
    return found


@dataclass(frozen=True)
class Shown:
    """One number, and what is left of it in parts of the standard deviation that is stated."""

    name: ParameterName
    prior: float
    left: float  # after the move; 1 where nothing is learnt of it
    left_by_work: float  # after the training set-point

    @property
    def kind(self) -> str:
        """What it is, whichever magnet or axis it is of."""
        return "centre" if self.name in CENTRE else kind_of_number(self.name)


@dataclass(frozen=True, repr=False)
class CalibratingMove(Result):
    """A move that shows what a stage is off by, flown.

    Parameters
    ----------
    move : Move
    run : Recording
        Of the virtual stage, as ``anhyst calibrate`` takes it.
    numbers : sequence of Shown
        Predicted from flights of the stage as it should be.
    seen : float
        What has more left of it is hidden.
    condition, condition_of_work : float
        Of the information, scaled by the priors, of all that is not hidden.
    work_s : float
        Duration of the training set-point.
    """

    move: Move
    run: Recording
    numbers: Sequence[Shown]
    seen: float
    condition: float
    condition_of_work: float
    work_s: float

    @property
    def hidden(self) -> list[str]:
        """What stays hidden whatever is moved."""
        return [one.name for one in self.numbers if one.left > self.seen]

    @property
    def hidden_by_work(self) -> list[str]:
        """What the training set-point does not show and the move does."""
        shown = [one for one in self.numbers if one.left <= self.seen]
        return [one.name for one in shown if one.left_by_work > self.seen]

    def facts(self) -> dict[str, str]:
        """Return duration and condition of move and work, and what each does not show."""
        work = f"{self.work_s:.2f} s, condition {self.condition_of_work:.2g}"
        unseen = ", ".join(self.hidden_by_work)
        return {
            "rig": self.move.rig.settings.name,
            "move": f"{self.move.duration:.2f} s, condition {self.condition:.2g}",
            "its own set-point": f"{work}; {'does not show ' + unseen if unseen else 'suffices'}",
            "hidden": ", ".join(self.hidden) or "nothing",
        }

    def to_columns(self) -> dict[str, Any]:
        """Return what is left of every number."""
        return columns_of([vars(one) for one in self.numbers])

    def as_dict(self) -> dict[str, Any]:
        """Return it as what is printed as JSON."""
        count = range(1, len(self.move.rig.settings.placed) + 1)
        flowed = [self.run[column("command", "A", number)] for number in count]
        return {
            "duration_s": self.move.duration,
            "condition": self.condition,
            "largest_A": float(np.max(flowed)),
            "legs": [
                {
                    "axis": leg.axis,
                    "m_per_s2": leg.motion.peaks,
                    "m_per_s": leg.motion.speed,
                    "duration_s": 2.0 * leg.motion.duration,
                }
                for leg in self.move.legs
            ],
            "work": {"duration_s": self.work_s, "condition": self.condition_of_work},
            "hidden": self.hidden,
            "hidden_by_work": self.hidden_by_work,
            "numbers": [vars(one) for one in self.numbers],
        }

    def draw(self, ax: Axes) -> None:
        """Draw the acceleration of every coordinate that is moved."""
        rig = self.move.rig
        time = instants(rig, len(self.run))
        moved = self.move.at(time)[1].reshape(time.size, -1)
        for axis in dict.fromkeys(leg.axis for leg in self.move.legs):
            place = rig.settings.body.free.index(axis)
            ax.plot(time, moved[:, place], lw=0.9, label=axis)
        ax.set_xlabel("time [s]")
        ax.set_ylabel("acceleration [m/s²]")


def design(learner: Learner, setup: StageSetup) -> Move:
    """Put legs together as long as one takes a part of some prior, the best for its time first.

    What the ones after it make needless is dropped.
    """
    rig, tried = setup.rig, list[tuple[Leg, FloatArray]]()
    for leg in legs_of(rig):
        run = Move(rig, (leg,)).fly(setup)
        if run.loss is None:
            tried.append((leg, learner.told(learner.law.motion(run.columns))))
    chosen: list[tuple[Leg, FloatArray]] = []

    def left(legs: Sequence[tuple[Leg, FloatArray]]) -> float:
        return float(np.mean([*learner.left(*(rows for _, rows in legs)).values()]))

    def worth(one: tuple[Leg, FloatArray]) -> float:
        return (left(chosen) - left([*chosen, one])) / one[0].lasts

    while tried and worth(best := max(tried, key=worth)) > GAIN:
        chosen.append(best)
    for leg in [leg for leg, _ in chosen]:
        places = [place for place, one in enumerate(chosen) if one[0] is leg]
        rest = [one for place, one in enumerate(chosen) if place not in places[:1]]
        if left(rest) - left(chosen) < GAIN * leg.lasts:
            chosen = rest
    return Move(rig, tuple(leg for leg, _ in chosen))


def find_move(rig: StageRig, magnet: IdentifiedMagnet | None = None) -> CalibratingMove:
    """Design the move of a stage, fly it, and say what is left of each number after it."""
    refuse_uncalibratable(rig)
    known = magnet or identify_stage(rig)
    setup, learner = make_stage(rig, known, OWN), Learner(law_of(rig, known, OWN))
    if not any(learner.priors.values()):
        raise InputError(
            f"{rig.path}: spread: says of nothing how far it may be off, so nothing is learnt; "
            "give current_percent and its likes",
            code="nothing-to-learn",
            key="spread",
        )
    refuse_unstable(setup)
    move = design(learner, setup)
    run = move.fly(setup, seed=1)
    if run.loss is not None or not move.legs:
        raise NegativeResult(
            f"{rig.path}: no move shows anything: the loop was lost {run.lost or 'in each'}",
            code="loop-lost",
        )
    work = motion_of(rig.settings.scan, rig.settings.scan.train_m_per_s2)
    flown = track(setup, work, Feedforward(), seed=1)
    by_move, by_work = (
        [learner.told(learner.law.motion(one.columns))] if one.loss is None else []
        for one in (run, flown)
    )
    left, left_by_work = learner.left(*by_move), learner.left(*by_work)
    return CalibratingMove(
        move=move,
        run=run,
        numbers=[
            Shown(name, prior, left.get(name, 1.0), left_by_work.get(name, 1.0))
            for name, prior in learner.priors.items()
            if prior > 0.0
        ],
        seen=learner.law.seen,
        condition=learner.condition(*by_move),
        condition_of_work=learner.condition(*by_work),
        work_s=work.duration,
    )


def excite_stage(
    path: PathLike, out: PathLike, magnet: IdentifiedMagnet | None = None
) -> CalibratingMove:
    """Read the rig file of a stage, fly the move that calibrates it best, write the recording."""
    if kind_of(path) not in (FileKind.STAGE, FileKind.UNKNOWN):
        raise InputError(
            f"{path}: --calibrate is for stages; a bearing learns from any recording in which its "
            "reference moves, a rig of force control is not calibrated",
            code="option-not-for-this",
            key="--calibrate",
        )
    rig = read_stage(path)
    check_recording(out, [rig.path, *rig.measured.files])
    found = find_move(rig, magnet)
    found.run.save(out)
    return found
