"""What a run of a stage is judged by: servo error, moving average, settling, force error; what is lost in flight.

Each amplifier or head fails in a run of its own. Long stroke and set-point brake to rest from the tick
on at which the controller finds the loss, but where the magnets that are left make all that the rest of
the set-point asks for.
"""

# ruff: noqa: N815 - names carry units

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from anhyst.support.numeric import FloatArray, rms
from anhyst.support.states import Command, Phase, State
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.case_table import LossCase
from anhyst_rigs.rig.file import RigFile
from anhyst_rigs.rig.loop import FAILS, HEAD_FAULTS, SHORT, SimulatedLoop
from anhyst_rigs.rig.recording import Recording, column, moving, peak, settled_from
from anhyst_rigs.rig.stage.drives import spare, usual_allocation, wrench_layout
from anhyst_rigs.rig.stage.geometry import (
    error_columns,
    pull_rows,
    scan_direction,
    stops_of,
    unit_of,
    without,
)
from anhyst_rigs.rig.stage.loop import Feedforward, StageSetup, fed_wrench, feed, scenario_along
from anhyst_rigs.rig.stage.recording import of_axes, recorded
from anhyst_rigs.rig.stage.setpoint import (
    STRAY_LATE,
    SetPoint,
    braking,
    instants,
    motion_of,
    strayed,
    ticks_of,
)
from anhyst_rigs.study.engine.table import Metric

BANDS_M = (50e-9, 10e-9)
"""Into which the settling is measured."""
EXPOSE_AFTER_S = 5e-3
"""After the end of the acceleration, from where on the moving average is judged."""


PEAK = Metric("peak_m", "peak", "nm", 1e9)
AVERAGE = Metric("average_m", "moving average", "nm", 1e9)
SETTLING = Metric("settling_50_s", "settling to 50 nm", "ms", 1e3)
METRICS = (
    PEAK,
    AVERAGE,
    Metric("deviation_m", "deviation over the slit", "nm", 1e9),
    SETTLING,
    Metric("settling_10_s", "settling to 10 nm", "ms", 1e3),
    Metric("force_peak_N", "force error, largest", "N"),
    Metric("force_rms_N", "force error, rms", "N"),
)
"""By which a motion is judged, in the order of every table."""


@dataclass(frozen=True)
class Measures:
    """Figures of one run; the first scan, into which the iron comes demagnetised, is left out."""

    peak_m: float  # largest error
    rms_m: float  # of the error
    # largest moving average and standard deviation over the slit, in windows that begin 5 ms or
    # more after the acceleration and end with the cruise
    average_m: float
    deviation_m: float
    # from the end of the acceleration until the error stays within 50 and 10 nm, mean of the scans;
    # a scan that never does counts with the whole cruise
    settling_50_s: float
    settling_10_s: float
    force_peak_N: float  # force less what was demanded a delay earlier
    force_rms_N: float

    @property
    def lost(self) -> bool:
        """Whether the loop was lost in the run."""
        return math.isinf(self.peak_m)


LOST = Measures(*[float("inf")] * 8)
"""Of a run in which the loop was lost."""


def cross_metrics(file: RigFile) -> list[Metric]:
    """Return the figures of :func:`cross_talk`."""
    units = {axis: unit_of(axis) for axis in still_axes(file)}
    return [Metric(f"{axis}_{u}", f"{axis}, largest", f"n{u}", 1e9) for axis, u in units.items()]


def still_axes(file: RigFile) -> list[str]:
    """Return the coordinates that the set-point does not move."""
    parts = zip(file.body.free, scan_direction(file).tolist(), strict=True)
    return [axis for axis, part in parts if part == 0.0]


def cross_talk(run: Recording, motion: SetPoint, still: Sequence[str]) -> dict[str, float]:
    """Return the largest error of each coordinate that stands still, by axis and unit, m or rad.

    The first scan is left out.
    """
    names = [f"{axis}_{unit_of(axis)}" for axis in still]
    if run.loss is not None:
        return dict.fromkeys(names, math.inf)
    since = round(motion.pulses[1][0] / run.dt)
    columns = zip(names, error_columns(still), strict=True)
    return {name: peak(run[column][since:]) for name, column in columns}


def cruises(motion: SetPoint, dt: float) -> list[slice]:
    """Return the ticks of each cruise, that after the first acceleration left out."""
    pulses = motion.pulses
    ends = [begin for begin, _, _ in pulses[1:]] + [motion.duration]
    whole = [
        slice(round((begin + length) / dt), round(end / dt))
        for (begin, length, _), end in zip(pulses, ends, strict=True)
    ]
    return whole[1:]


def settling(run: Recording, motion: SetPoint, band: float) -> list[float]:
    """Return for each scan how long it takes until the error stays within a band, s."""
    error, dt = run["error_m"], run.dt
    return [dt * settled_from(error[cruise], band) for cruise in cruises(motion, dt)]


def exposures(
    error: FloatArray, motion: SetPoint, slit: float, dt: float
) -> list[tuple[FloatArray, FloatArray]]:
    """Return the moving average and deviation of an error over a slit, s, in each cruise."""
    late, ticks = round(EXPOSE_AFTER_S / dt), round(slit / dt)
    return [
        moving(error[cruise.start + late : cruise.stop], ticks) for cruise in cruises(motion, dt)
    ]


def measure(run: Recording, motion: SetPoint, slit: float) -> Measures:
    """Judge a run with a slit of so many seconds."""
    if run.loss is not None:
        return LOST
    windows = exposures(run["error_m"], motion, slit, run.dt)
    since = round(motion.pulses[1][0] / run.dt)
    error, force = run["error_m"][since:], run["force_error_N"][since:]
    return Measures(
        peak_m=peak(error),
        rms_m=rms(error),
        average_m=max(peak(mean) for mean, _ in windows),
        deviation_m=max(float(deviation.max()) for _, deviation in windows),
        settling_50_s=float(np.mean(settling(run, motion, BANDS_M[0]))),
        settling_10_s=float(np.mean(settling(run, motion, BANDS_M[1]))),
        force_peak_N=peak(force),
        force_rms_N=rms(force),
    )


LIFTED_S = 0.01
"""From when on a magnet is lost: the weight is taken up in one step before."""
HELD_S = 0.1
"""For which a body that braked is still watched."""
END_S = 0.02
"""Of it, or of the whole set-point, the end that is judged."""
LIFT_S, LAND_S = 0.2, 0.45
"""When a body that was let go first is lifted, and when it is told to land."""
LIES_S = 0.02
"""After it came down, a body lies: what slides later, it does without friction here."""
PARTS = (1.0, 0.5, 0.25, 0.1)
"""Of the largest acceleration, at which it may brake."""
_LOST = 256
"""In the state that a loop records: times the highest number of a magnet that is lost."""
LOSS_TITLE = "a magnet lost in flight, each when it pulls most, or a head"
LOSS_HEAD = (
    "lost",
    "the stage",
    "at ms",
    "A",
    "can be spared",
    "found after ms",
    "largest error",
    "at the end",
    "down mm/s",
    "let go",
    "onto any stop mm/s",
    "let go",
)
LOSS_NOTES = (
    "errors in nm and nrad, the largest of all coordinates;",
    "let go: all currents end when the loss is found; speeds until it lies",
)


@dataclass(frozen=True, kw_only=True)
class LostMagnet:
    """What became of a body one of whose magnets or heads was lost; none where it was lifted."""

    magnet: str
    at_s: float
    current_A: float | None = None
    spare: bool = (
        False  # whether the others hold every coordinate, by linear programme; or tell the pose
    )
    noticed_s: float | None = None  # so much later
    # "unnoticed", "flies on", "brakes", "lands", "let go", "falls" where it hit a stop in the air,
    # or "lifts off", "stays"
    outcome: str
    # of each coordinate the largest error from the loss on, and at the end; none of one that is down
    error: dict[str, float]
    error_end: dict[str, float]
    # how fast it comes onto stops, relative to the long stroke: downwards, and anywhere at a magnet;
    # 0 where it never does
    down_m_per_s: float
    touch_m_per_s: float
    # the same where all currents end when the loss is found, and where it is not looked for
    let_go: tuple[float, float]
    unaware: tuple[float, float]

    def cells(self) -> list[str]:
        """Return what a table says of it, in the columns of :data:`LOSS_HEAD`."""

        def most(error: Mapping[str, float]) -> str:
            sizes = [
                1e9 * max((v for k, v in error.items() if k.endswith(u)), default=0.0)
                for u in ("_m", "_rad")
            ]
            return ", ".join(f"{size:.3g}" for size in sizes) if error else ""

        speeds = [self.down_m_per_s, self.let_go[0], self.touch_m_per_s, self.let_go[1]]
        return [
            self.magnet,
            self.outcome,
            f"{1e3 * self.at_s:.1f}",
            "" if self.current_A is None else f"{self.current_A:.2f}",
            "yes" if self.spare else "no",
            "" if self.noticed_s is None else f"{1e3 * self.noticed_s:.2f}",
            most(self.error),
            most(self.error_end),
            *(f"{1e3 * one:.1f}" for one in speeds),
        ]


def _state(run: Recording) -> FloatArray:
    return np.asarray(run["state"] % _LOST // 16)


@dataclass(frozen=True)
class _Plan:
    """A set-point as it is flown: a value a tick, of place and acceleration one more."""

    place: FloatArray  # m
    acceleration: FloatArray  # m/s2
    forward: FloatArray  # N


@dataclass(frozen=True)
class Losses:
    """Flights over the test set-point in which magnets are lost."""

    setup: StageSetup
    gains: Feedforward
    case: LossCase
    seed: int = 1

    def all(self) -> list[LostMagnet]:
        """Lose every magnet that the case names in a flight of its own, then every head; then lift."""
        file, whole, case = self._rig.settings, self._whole(), self.case
        placed = [one.name for one in file.placed]
        calm = self._flown(whole, {})
        losses = [self._lose(placed.index(name), whole, calm) for name in case.magnets or placed]
        count = len(file.position_sensors)
        heads = [(number, way) for way in case.heads or [] for number in range(count)]
        losses += [self._lose_head(number, way, whole) for number, way in heads]
        return [*losses, self._lifted(whole)] if case.lift else losses

    @property
    def _rig(self) -> BodyRig:
        return self.setup.rig

    def _lose(self, magnet: int, whole: _Plan, calm: Recording) -> LostMagnet:
        file, since = self._rig.settings, round(LIFTED_S / self._rig.dt)
        density = np.abs(calm[column("flux_density", "T", magnet + 1)])
        at = since + int(np.argmax(density[since:]))
        word = 1 << magnet + FAILS | (SHORT if self.case.circuit == "short" else 0)
        loss = self._failed(file.placed[magnet].name, at, word, magnet, whole)
        then = calm[column("current", "A", magnet + 1)][round(loss.at_s / self._rig.dt)]
        return replace(loss, current_A=float(then), spare=bool(spare(file) >> magnet & 1))

    def _lose_head(self, number: int, way: str, whole: _Plan) -> LostMagnet:
        at = int(np.argmax(np.abs(whole.acceleration)))
        word = 1 << number + FAILS | HEAD_FAULTS[way]
        loss = self._failed(f"head {number + 1} {way}", at, word, -1, whole)
        return replace(loss, spare=bool(without(self._rig.settings)[number].any()))

    def _failed(self, name: str, at: int, word: int, magnet: int, whole: _Plan) -> LostMagnet:
        """Return what becomes of a body for which something fails at a tick, or when the case says."""
        dt, file = self._rig.dt, self._rig.settings
        if self.case.at_s is not None:
            at = min(round(self.case.at_s / dt), len(whole.forward) - 1)
        fails = {at: word}
        run = self._flown(whole, fails)
        plan, outcome, now = whole, "unnoticed", at
        noticed = np.flatnonzero((run["state"] >= _LOST) | (_state(run) == State.FAULT))
        if noticed.size:
            now, outcome = int(noticed[0]), "flies on"
            if _state(run)[-1] == State.FAULT or not self._makes(magnet, whole.forward[now:]):
                plan, outcome = self._braked(magnet, whole, now), "brakes"
                run = self._flown(plan, fails)
        down, touch = self._touches(run)
        if _state(run)[-1] == State.FAULT:
            outcome = "lands" if (run["state"] % 16 == Phase.DESCEND).any() else "let go"
        elif touch > 0.0:
            outcome = "falls"
        names = [] if outcome in ("lands", "let go", "falls") else error_columns(file.body.free)
        blind = {"control.lost_A": None, "control.head_m_per_s": None}
        unaware = replace(self._rig, settings=file.changed(blind))
        other = replace(self, setup=replace(self.setup, rig=unaware))
        every = (1 << len(file.placed)) - 1 << FAILS
        return LostMagnet(
            magnet=name,
            at_s=at * dt,
            noticed_s=(now - at) * dt if noticed.size else None,
            outcome=outcome,
            error={name: peak(run[name][at:]) for name in names},
            error_end={name: peak(run[name][-round(END_S / dt) :]) for name in names},
            down_m_per_s=down,
            touch_m_per_s=touch,
            let_go=self._touches(self._flown(plan, fails | {now: every})),
            unaware=self._touches(other._flown(plan, fails)),
        )

    def _lifted(self, whole: _Plan) -> LostMagnet:
        """Return how a body that was let go is lifted from its stops, and set down again."""
        dt, names = self._rig.dt, error_columns(self._rig.settings.body.free)
        up, land = round(LIFT_S / dt), round(LAND_S / dt)
        still = np.zeros(2 * land)
        plan = _Plan(np.zeros(still.size + 1), np.zeros(still.size + 1), still)
        commands = {0: Command.IDLE, up: Command.LIFT, land: Command.LAND}
        run = self._flown(plan, {}, commands)
        flies = np.flatnonzero(run["state"][up:land] % 16 == Phase.HOVER) + up
        fall, down = self._touches(run.part(0, up)), self._touches(run.part(up, len(run)))
        return LostMagnet(
            magnet="none: lift-off",
            at_s=up * dt,
            spare=True,
            outcome="lifts off" if flies.size and _state(run)[-1] == State.READY else "stays",
            error={name: peak(run[name][flies]) for name in names if flies.size},
            error_end={name: peak(run[name][land - round(END_S / dt) : land]) for name in names},
            down_m_per_s=down[0],
            touch_m_per_s=down[1],
            let_go=fall,
            unaware=fall,
        )

    def _whole(self) -> _Plan:
        rig = self._rig
        motion = motion_of(rig.settings.scan, rig.settings.scan.test_m_per_s2)
        time = instants(rig, ticks_of(rig, motion) + 1)
        place, acceleration, _, _ = motion.at(time)
        return _Plan(place, acceleration, feed(self.setup, motion, self.gains))

    def _braked(self, magnet: int, whole: _Plan, now: int) -> _Plan:
        """Return the plan that brakes to rest from a tick on, and is held there.

        The acceleration goes to zero along a line first, in a jerk phase of the set-point.
        """
        rig, file, mass = self._rig, self._rig.settings, self.setup.believed.settings.body.mass_kg
        motion = motion_of(file.scan, file.scan.test_m_per_s2)
        a, lasts = float(whole.acceleration[now]), motion.jerk_phase
        around = whole.place[max(now - 1, 0) : now + 2]
        v = float((around[-1] - around[0]) / ((around.size - 1) * rig.dt))
        time = instants(rig, round(lasts / rig.dt) + 1)
        eased = whole.place[now] + v * time + a * (time**2 / 2.0 - time**3 / (6.0 * lasts))
        later = time[:-1] + rig.late
        falls = a * np.maximum(1.0 - later / lasts, 0.0)
        easing = np.column_stack([falls, -a / lasts * (later < lasts), 0.0 * later])
        v += 0.5 * a * lasts
        able = [part * max(motion.peaks) for part in PARTS]
        made = (one for one in able if self._makes(magnet, np.array([-mass * one * np.sign(v)])))
        most = next(made, able[-1])
        course = braking(v, 0.0, replace(motion, peaks=(most,)), rig.dt, rig.late)
        gains = np.array([self.gains.acceleration, self.gains.jerk, self.gains.snap])
        still = np.zeros(round(HELD_S / rig.dt))
        place, slows = eased[-1] + course.position, a * (1.0 - time[:-1] / lasts)
        fed = mass * (np.vstack([easing, course.ahead[:, :3]]) @ gains)
        return _Plan(
            np.concatenate([whole.place[:now], eased[:-1], place, place[-1] + still]),
            np.concatenate([whole.acceleration[:now], slows, course.acceleration, [0.0], still]),
            np.concatenate([whole.forward[:now], fed, still]),
        )

    def _makes(self, magnet: int, forward: FloatArray) -> bool:
        """Whether forces fed forward are made without a magnet."""
        file = self._rig.settings
        layout = wrench_layout(file, usual_allocation(file), self._rig.idle)
        layout.lose(magnet)
        wrenches = fed_wrench(self.setup.believed, forward).tolist()
        return all(layout.share(one)[1] for one in wrenches)

    def _flown(
        self, plan: _Plan, fails: Mapping[int, int], commands: Mapping[int, Command] | None = None
    ) -> Recording:
        """Return a flight with what fails from some ticks on, and with commands at ticks."""
        rig, n = self._rig, plan.forward.size
        delay = round(STRAY_LATE / rig.dt)
        late = np.concatenate([np.zeros(delay), plan.acceleration[:-delay]])
        stray = strayed(rig, late / max(rig.settings.scan.test_m_per_s2), instants(rig, n + 1))
        wrench = fed_wrench(self.setup.believed, plan.forward)
        scenario = scenario_along(rig, plan.place, stray, wrench)
        for at, which in fails.items():
            scenario.command[at:] = which
        for at, which in (commands or {}).items():
            scenario.command[at] |= which
        run = SimulatedLoop(self.setup, self.seed).run(scenario)
        return Recording(dict(run.columns) | recorded(rig, run, scenario))

    def _touches(self, run: Recording) -> tuple[float, float]:
        """Return how fast the body comes onto stops at most, downwards and anywhere at a magnet."""
        file, free = self._rig.settings, self._rig.settings.body.free
        poses = np.column_stack([run[name] for name in of_axes("pose", free)])
        speeds = np.diff(poses, axis=0) / self._rig.dt
        onto = np.diff((np.abs(poses) > np.array(stops_of(file))).astype(int), axis=0) > 0
        at_magnets = np.abs(speeds @ pull_rows(file).T).max(axis=1)
        down = np.zeros(len(speeds))
        if "z" in free:
            z = free.index("z")
            below = onto[:, z] & (poses[1:, z] < 0.0)
            lies = int(np.argmax(below)) + round(LIES_S / self._rig.dt)
            down = -speeds[:, z] * below
            onto[lies:] &= not below.any()
            down[lies:] = 0.0
        touch = (at_magnets * onto.any(axis=1)).max(initial=0.0)
        return max(0.0, float(down.max(initial=0.0))), float(touch)
