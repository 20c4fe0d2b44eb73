"""The virtual bench of a stage: its plant and the core's own controller in lock-step, in process.

No firmware runs: the tracking controller is not part of it yet. Its set-point is followed over and
over, there and back in turn, with a rest between two of them. Whatever is changed acts on one tick
while the body rests, so that no law, gain or filter changes under force.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from anhyst.compensate.force_controller import ForceController
from anhyst.control.position import Standing, refusal
from anhyst.rig.bench.protocol import (
    AXES_COMMANDS,
    STAGE_COMMANDS,
    STAGE_OWN,
    STAGE_READ,
    Aim,
    Bench,
    Parameter,
    Signal,
    of_axes_and_magnets,
)
from anhyst.rig.bench.settings import check_values, stage_parameters
from anhyst.rig.drift import NO_DRIFT, draw_plant, drifted_plant
from anhyst.rig.loop import ClosedLoop, Scenario
from anhyst.rig.plant import current_loops
from anhyst.rig.recording import CURRENTS, Loss, Recording, column, of_magnets, peak
from anhyst.rig.stage.file import layout_of, lying, pulls, pushed_with, scan_direction
from anhyst.rig.stage.loop import (
    WRENCH,
    Feedforward,
    StageSetup,
    demand_columns,
    fed_wrench,
    led,
    of_axes,
    pid,
    read_noise,
    recorded,
    stage_loss,
)
from anhyst.rig.stage.setpoint import (
    STRAY_LATE,
    Course,
    SetPoint,
    braking,
    course_of,
    motion_of,
    strayed,
)
from anhyst.support.errors import InputError
from anhyst.support.kinds import MethodName
from anhyst.support.numeric import FloatArray
from anhyst.support.states import Command, Fault, Phase, State

PIECE_S = 0.01
"""After so long at most it is seen whether the loop was lost, s."""
CARRIED_S = 1e-3
"""Over which the force of the integral is taken that another controller goes on with, s."""
REMEMBERED = 4
"""Set-points of which it is kept what flowed, for another law to follow."""
LOAD = 0.5
"""Of what the largest force has left beside the set-point: what the load drive may pull with."""
GAINS = ("acceleration", "jerk", "snap")
"""Of :class:`anhyst.rig.stage.loop.Feedforward`."""
PHASES = 16
"""In the state that a loop records: times the state of the controller."""
LAPS = 100
"""Of which it is known how they were followed."""


@dataclass(frozen=True)
class StageVariant:
    """A method behind the controller of a stage, and the gains that were found with it."""

    setup: StageSetup
    gains: Feedforward


class StageLap(NamedTuple):
    """A set-point that was followed, or is."""

    number: int
    begin: int  # its first tick
    ticks: int
    known: int  # from this tick on it is to be looked at what flowed: before, nothing is remembered
    motion: SetPoint
    under: tuple[object, ...]  # plant, gains and all else in force but what is learnt
    setup: StageSetup  # in force, with what was learnt

    @property
    def end(self) -> int:
        """Its last tick."""
        return self.begin + self.ticks - 1

    @property
    def method(self) -> MethodName:
        """The one that drove it."""
        return self.setup.method


class StageBench(Bench):
    """A stage that follows its set-point over and over.

    The variants are the one without memory and the
    compensator, which its parameter ``compensation`` chooses by 0 and 1.
    """

    signals: tuple[Signal, ...] = (*STAGE_OWN[:4], *STAGE_READ.values(), *STAGE_OWN[4:])
    commands: tuple[Command, ...] = STAGE_COMMANDS
    tick = 0
    lifted = 0  # tick on which it was lifted last from a rest without current
    _between = False  # whether it is lifted or set down

    def __init__(self, variants: Sequence[StageVariant], seed: int = 0) -> None:
        rig = variants[0].setup.rig
        self.rig, self.rate = rig, 1.0 / rig.dt
        self._magnets = len(rig.settings.magnets)
        self.laps: deque[StageLap] = deque(maxlen=LAPS)
        file, self._peak = rig.settings, max(rig.settings.scan.test_m_per_s2)
        left = file.tracking.force_max_N - file.body.mass_kg * self._peak
        self.load_most = LOAD * max(left, 0.0)
        # a step of the target by so much asks for the largest force at once
        most = file.tracking.force_max_N / pid(rig)["b0"]
        self.aim = Aim("position", "reference", "m", -most, most, 0.0)
        self.variants = tuple(variants)  # as the files say
        self._setups = [one.setup for one in variants]
        self._gains = [one.gains for one in variants]
        self._values = {
            "compensation": 1.0,
            "motion": 1.0,
            "crossover": rig.settings.tracking.crossover_Hz,
            "plant": 0.0,
        }
        self._staged: dict[str, float] = {}
        self._corrected: dict[int, StageSetup] = {}
        self._rng = np.random.default_rng([rig.settings.seed, seed])
        self._state, self._fault, self._laps, self._lap = State.READY, Fault.NONE, 0, 0
        self._offset, self._load, self._side = 0.0, 0.0, 1.0
        self._push: dict[str, float] = {}
        self._move(1.0)
        self._renew()

    @property
    def _setup(self) -> StageSetup:
        return self._setups[int(self._values["compensation"])]

    def _move(self, share: float) -> None:
        """Take the accelerations of the file by a share; the set-point comes to rest at its end."""
        scan = self.rig.settings.scan
        peaks = [share * peak for peak in (*scan.test_m_per_s2, scan.test_m_per_s2[0])]
        self._motion = replace(motion_of(scan, peaks), rests=True)
        self._way = course_of(self._motion, self.rig.dt, self.rig.late)

    def _renew(self) -> None:
        """Put the plant in force where it works, at rest, its iron demagnetised."""
        number = int(self._values["plant"])
        settings = self.rig.settings
        drift, noise = draw_plant(settings, settings.seed, number - 1) if number else (NO_DRIFT, 0)
        self._cable = drift.cable
        self._plant = drifted_plant(self.rig, drift, noise)
        self._place_body(float(self._strayed(1, 0.0)[0]))
        self._course: Course | None = None
        self._at, self._place = 0, 0.0
        self._past = np.zeros(round(STRAY_LATE / self.rig.dt))  # accelerations
        self._flowed: deque[FloatArray] = deque()
        free = len(self.rig.settings.body.free)
        self._latest = np.zeros((0, 2 * (self._magnets + free)))
        self._carried = np.zeros(free)
        self._known = self.switched = self.tick + 1  # first tick with demagnetised iron
        self._control()

    def _place_body(self, stray: float) -> None:
        self._plant.place([self.rig.gap - stray], [0.0])

    def _control(self) -> None:
        """Put a controller in force that remembers what flowed; the integral of the loop goes on."""
        rig = self._setup.rig
        settings = rig.settings.changed({"control.crossover_Hz": self._values["crossover"]})
        setup = replace(self._setup, rig=replace(rig, settings=settings))
        # the loop keeps the drives alive
        drives = [self._remembering(setup, k) for k in range(self._magnets)]
        controller = setup.make_controller(drives)
        self._loop = ClosedLoop(self._plant, controller, current_loops(setup.rig))
        if len(self._latest):
            wanted, fed = np.split(self._latest[:, 2 * self._magnets :], 2, axis=1)
            self._carried = np.array([np.mean(one) for one in (wanted - fed).T])

    def _remembering(self, setup: StageSetup, magnet: int) -> ForceController:
        """Return a compensator that has followed what flowed in a magnet."""
        drive = setup.fresh()[magnet]
        path = np.concatenate([*self._flowed, self._latest[-1:]])
        if len(path):
            scale, zero = (1.0, 0.0) if setup.correction is None else setup.correction[magnet, :2]
            drive.follow(scale * path[:, magnet], path[:, self._magnets + magnet] - zero)
        return drive

    def advance(self, ticks: int) -> FloatArray:
        """Compute some ticks, one after the other."""
        parts = []
        piece = max(1, round(PIECE_S * self.rate))
        while ticks > 0:
            if self._state is State.FAULT:
                rows = self._lie(ticks)
            else:
                if self._course is None or self._at == len(self._course):
                    self._rest()
                left = ticks if self._course is None else len(self._course) - self._at
                rows = self._run(min(ticks, left, piece))
            parts.append(rows)
            ticks -= len(rows)
        return np.concatenate(parts)

    def _rest(self) -> None:
        """At rest: put in force what was staged, and begin the next lap."""
        if self._course is not None:
            self._place += float(self._course.place[-1])
            if self._lap:
                self._known = self.laps[-1].begin
            self._course, self._lap = None, 0
        if self._between:
            return
        if self._staged or self._corrected:
            self._take()
        if self._state is State.RUN:
            self._begin(self._way if self._side > 0.0 else self._way.back())
            self._laps += 1
            self._lap, self._side = self._laps, -self._side
            pushed = self._load, *self._push.values()
            under = (*self._values.values(), *self._gains, *pushed)
            begin, ticks = self.tick + 1, len(self._way)
            lap = StageLap(self._lap, begin, ticks, self._known, self._motion, under, self._setup)
            self.laps.append(lap)

    def _begin(self, course: Course) -> None:
        self._course, self._at = course, 0
        # nothing of the small loops at rest is kept: the next lap wipes them out
        self._flowed.append(self._latest[-1:])
        while sum(map(len, self._flowed)) > REMEMBERED * len(self._way):
            self._flowed.popleft()

    def _take(self) -> None:
        staged, self._staged = self._staged, {}
        corrected, self._corrected = self._corrected, {}
        for which, setup in corrected.items():
            self._setups[which] = setup
        self._values |= {name: one for name, one in staged.items() if name in self._values}
        which = int(self._values["compensation"])
        gains = {name: staged[f"gain_{name}"] for name in GAINS if f"gain_{name}" in staged}
        self._gains[which] = replace(self._gains[which], **gains)
        if "motion" in staged:
            self._move(staged["motion"])
        if "plant" in staged:
            self._renew()
        elif which in corrected or not staged.keys().isdisjoint(("compensation", "crossover")):
            self._control()

    def _fed(self, n: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return set-point and accelerations of the next ticks and one more, and what is fed forward."""
        course, at = self._course, self._at
        if course is None:
            place, accelerations, ahead = np.zeros(n + 1), np.zeros(n), np.zeros((n, 4))
        else:
            place, accelerations = course.place[at : at + n + 1], course.acceleration[at : at + n]
            ahead = course.ahead[at : at + n]
        setup, gains = self._setup, self._gains[int(self._values["compensation"])]
        mass = setup.believed.settings.body.mass_kg
        moved = ahead[:, :3] @ [gains.acceleration, gains.jerk, gains.snap]
        forward = mass * moved + setup.cable * (self._place + ahead[:, 3])
        return self._place + place, accelerations, forward

    def _strayed(self, n: int, late: FloatArray | float) -> FloatArray:
        """Return how far the long stroke is off at the next ticks, m, as a simulated one is."""
        ticks = np.arange(self.tick, self.tick + n, dtype=np.float64)
        return strayed(self.rig, late, self.rig.dt * ticks)

    def _run(self, n: int) -> FloatArray:
        place, accelerations, forward = self._fed(n)
        past = np.concatenate([self._past, accelerations])
        stray = self._strayed(n + 1, past[: n + 1] / self._peak)
        of_loop, flowed, loss = self._step(place, stray, forward)
        kept = len(flowed)
        rows = self._rows(kept, *of_loop)
        self._past, self._at = past[kept : kept + self._past.size], self._at + kept
        self._keep(flowed)
        carried = round(CARRIED_S / self.rig.dt)
        self._latest = np.concatenate([self._latest, flowed])[-carried:]
        if loss is not None:
            self._state, self._fault, self._lap = State.FAULT, Fault.POSITION_RANGE, 0
        return rows

    def _keep(self, flowed: FloatArray) -> None:
        """Keep what flowed for another law to follow, but at rest."""
        if self._course is not None:
            self._flowed.append(flowed)

    def _step(
        self, place: FloatArray, stray: FloatArray, forward: FloatArray
    ) -> tuple[list[FloatArray], FloatArray, Loss | None]:
        """Return what is read of some ticks, signal by signal; what flowed; and whether it was lost.

        What flowed: of each magnet the current and the gap as the controller knows it, then what
        was demanded along each coordinate, and what was fed forward.
        """
        rig, free = self.rig, self.rig.settings.body.free
        fed = fed_wrench(self._setup.believed, forward) + (list(self._push.values()) or 0.0)
        scenario = led(rig, place, stray, fed + self._carried, self._offset)
        scenario = self._happening(scenario, place)
        run = self._loop.run(scenario)
        loss = stage_loss(rig, run, len(fed)) if self._is_held() else None
        run = run.part(0, len(fed) if loss is None else loss.tick + 1)
        seen = dict(run.columns) | recorded(rig, run, scenario) | self._beside(run)
        wanted = [run[name] for name in of_axes("demand", free, WRENCH)]
        currents = [run[name] for name in of_magnets(CURRENTS[:1], 1, self._magnets)]
        flowed = [*currents, *self._gaps_read(run), *wanted, fed[: len(run)]]
        of_loop = [seen[column(one.name, one.unit)] for one in self._of_loop]
        return of_loop, np.column_stack(flowed), loss

    def _happening(self, scenario: Scenario, place: FloatArray) -> Scenario:
        """Return a scenario with what happens beside what is led and fed."""
        n = scenario.ticks
        load, noise = self._load - self._cable * place[:n], read_noise(self.rig, n, self._rng)
        return replace(scenario, load=load, inject=noise)

    def _is_held(self) -> bool:
        """Whether a body on a stop is a lost one."""
        return True

    def _gaps_read(self, run: Recording) -> list[FloatArray]:
        """Return the gap of each magnet as the controller knows it."""
        gap = run["gap_read_m"]
        return [gap, (self.rig.settings.gap_total_m or 0.0) - gap]

    def _beside(self, run: Recording) -> dict[str, FloatArray]:
        """Return what is read beside what is recorded."""
        del run
        return {}

    def _rows(self, n: int, *of_loop: FloatArray) -> FloatArray:
        numbers = np.arange(self.tick + 1, self.tick + n + 1, dtype=np.float64)
        states = [np.full(n, float(one)) for one in (self._fault, self._lap)]
        self.tick += n
        return np.column_stack([numbers, *of_loop, self._states(n), *states])

    def _states(self, n: int) -> FloatArray:
        return np.full(n, float(self._state))

    def _lie(self, n: int) -> FloatArray:
        """Let the body lie on a stop without a current: a stage that was lost is not simulated."""
        values = self._lying()
        return self._rows(n, *(np.full(n, values.get(one.name, 0.0)) for one in self._of_loop))

    @property
    def _of_loop(self) -> Sequence[Signal]:
        """The signals that come from the loop; the others are the bench's own."""
        return self.signals[: -len(STAGE_OWN[4:])]

    def _lying(self) -> dict[str, float]:
        """Return what is read of a body that lies on a stop, but for zeros."""
        stop, place = self.rig.settings.body.stop_low_m, self._place
        position = place + stop - self.rig.gap
        values = {"reference": place, "position": position, "position_read": position}
        return values | {"error": place - position, "gap": stop, "gap_read": stop}

    def command(self, command: Command) -> None:
        """Give a command. A stop brakes at once, whatever the state, and the body is held then."""
        if command is Command.STOP:
            self._brake()
            return
        self._permit(command)
        if command is Command.RUN:
            # the first leg leads back to where it all began
            side = -1.0 if self._place > 0.0 else 1.0
            self._state, self._side, self._offset = State.RUN, side, 0.0
        else:
            self._state, self._fault = State.READY, Fault.NONE
            self._renew()

    def _permit(self, command: Command) -> None:
        now = Standing(self._state, False, True, False, True, True)
        name, why = command.name.lower(), refusal(command, now)
        if command not in self.commands:
            why = "a stage has no such command"
        if why:
            raise InputError(f"{name}: {why}", code="wrong-state", key=name)

    def _brake(self) -> None:
        if self._state is not State.RUN:
            return
        self._state, self._lap = State.READY, 0
        course, dt = self._course, self.rig.dt
        if course is not None and self._at < len(course):
            self._place += float(course.place[self._at])
            motion = course.motion_at(self._at, dt)
            scan = self.rig.settings.scan  # its largest acceleration, whatever the lap's is
            hardest = motion_of(scan, scan.test_m_per_s2)
            self._begin(braking(*motion, hardest, dt, self.rig.late))

    def demand(self, value: float) -> None:
        """Demand a place beside the set-point, m."""
        if not self.aim.low <= value <= self.aim.high:
            raise InputError(
                f"demand: is {value:g} m; choose one from {self.aim.low:g} to {self.aim.high:g} m",
                code="out-of-range",
                key="demand",
            )
        self._offset = value

    def load(self, force: float) -> None:
        """Let a force, N, push at the body towards larger positions; the controller is not told."""
        self._load = min(max(force, -self.load_most), self.load_most)

    def parameters(self) -> tuple[Parameter, ...]:
        """Return all that may be changed, with the values that are in force once the body rests."""
        crossover = self.rig.settings.tracking.crossover_Hz
        values = {**self._values, **self._staged}
        gains = self._gains[int(values["compensation"])]
        values = {**{f"gain_{name}": getattr(gains, name) for name in GAINS}, **values}
        off, on = (one.method for one in self._setups)
        return stage_parameters(values, (off, on), crossover)

    def apply(self, values: Mapping[str, float]) -> int:
        """Put parameters in force together, on the tick on which the body next rests."""
        check_values(values, self.parameters(), whole=("compensation", "plant"))
        if self._state is State.FAULT:
            raise InputError("the stage is lost: press clear first", code="wrong-state")
        self._staged |= values
        return self._due

    def correct(self, setup: StageSetup) -> int:
        """Put what was learnt of a method in force, on the tick on which the body next rests."""
        methods = [one.method for one in self._setups]
        self._corrected[methods.index(setup.method)] = setup
        return self._due

    @property
    def _due(self) -> int:
        left = 0 if self._course is None else len(self._course) - self._at
        return self.tick + left + 1

    def close(self) -> None:
        """Nothing runs beside it."""


class AxesBench(StageBench):
    """The same of a body of several coordinates.

    There is no load drive: its parameters `push_` add to what is demanded of the magnets, at once.
    Its controller lifts it and sets it down: idle it lies without a current, ready it is held.
    """

    commands = AXES_COMMANDS
    _order = Command.NONE  # to the controller, at the next tick

    def __init__(self, variants: Sequence[StageVariant], seed: int = 0) -> None:
        file = variants[0].setup.rig.settings
        each = of_axes_and_magnets(file.body.free, [one.name for one in file.placed])
        forces = [
            Signal("demand", "N", "force that the controller wants along the set-point"),
            Signal("force", "N", "true force of the magnets"),
        ]
        along = [STAGE_OWN[0], STAGE_OWN[1], STAGE_OWN[3]]
        flight = Signal("flight", "", "what its controller does: Phase of anhyst.support.states")
        self.signals = (*along, *forces, *each, flight, *STAGE_OWN[4:])
        most = [LOAD * one for one in pushed_with(file)]
        self._pushes = dict(zip([f"push_{axis}" for axis in file.body.free], most, strict=True))
        self._flights = np.zeros(0)  # of the last ticks
        super().__init__(variants, seed)
        self._push = dict.fromkeys(self._pushes, 0.0)
        self.load_most = 0.0

    @property
    def body(self) -> Mapping[str, Any]:
        """What a picture of the body is drawn from, SI."""
        return {**layout_of(self.rig.settings), "way": peak(self._way.place)}

    def parameters(self) -> tuple[Parameter, ...]:
        """Return all that may be changed, with the values that are in force once the body rests."""
        pushes = [
            Parameter(name, WRENCH["_r" in name], -most, most, "at once, asked of the magnets", now)
            for (name, most), now in zip(self._pushes.items(), self._push.values(), strict=True)
        ]
        return (*super().parameters(), *pushes)

    def apply(self, values: Mapping[str, float]) -> int:
        """Put parameters in force, on the tick on which the body next rests, or pushes on the next."""
        others = {name: one for name, one in values.items() if name not in self._pushes}
        check_values(values, self.parameters())
        if others and self._between:
            raise InputError("the stage is lifted or set down: wait", code="wrong-state")
        due = super().apply(others) if others else self.tick + 1
        self._push |= {name: one for name, one in values.items() if name in self._pushes}
        return due

    def command(self, command: Command) -> None:
        """Give a command; a stop of a body that is lifted sets it down again."""
        if command is Command.STOP and self._between:
            self._order = Command.LAND
        elif command in (Command.LIFT, Command.LAND, Command.IDLE):
            self._permit(command)
            if not self._between:
                self._brake()
            self._order, self._between = command, command is not Command.IDLE
            self._state = State.RUN if self._between else State.IDLE
            if command is Command.LIFT:
                self._known = self.lifted = self.tick + 1
        else:
            super().command(command)

    def _control(self) -> None:
        super()._control()
        # it begins in flight
        self._order = Command.IDLE if self._state is State.IDLE else Command.NONE

    def _keep(self, flowed: FloatArray) -> None:
        driven = bool(self._flowed) and self._flowed[-1][-1:, : self._magnets].any()
        if self._course is not None or self._between:
            self._flowed.append(flowed)
        elif self._state is State.IDLE and driven:
            self._flowed.append(flowed[-1:])

    def _states(self, n: int) -> FloatArray:
        if self._state is State.FAULT:
            return super()._states(n)
        found = np.full(n, float(State.RUN))
        found[self._flights == Phase.REST] = State.IDLE
        found[self._flights == Phase.HOVER] = self._state
        return found

    def _place_body(self, stray: float) -> None:
        along = scan_direction(self.rig.settings)
        self._plant.place((-stray * along).tolist(), [0.0] * along.size)

    def _happening(self, scenario: Scenario, place: FloatArray) -> Scenario:
        del place
        scenario.command[0], self._order = self._order, Command.NONE
        return scenario

    def _is_held(self) -> bool:
        return self._state is not State.IDLE and not self._between

    def _gaps_read(self, run: Recording) -> list[FloatArray]:
        return [run[name] for name in of_magnets([("gap_read", "m")], 1, self._magnets)]

    def _beside(self, run: Recording) -> dict[str, FloatArray]:
        """Return what each magnet pulls with, what all do along each coordinate, and the flight."""
        free = self.rig.settings.body.free
        own = of_axes("wrench", free, WRENCH)
        read = dict(zip(demand_columns(free, "wrench"), (run[name] for name in own), strict=True))
        self._flights = run["state"] % PHASES
        if self._between and self._flights[-1] in (Phase.HOVER, Phase.REST):
            self._between = False
            self._state = State.READY if self._flights[-1] == Phase.HOVER else State.IDLE
        return read | pulls(self.rig.settings, run) | {"flight": self._flights}

    def _lying(self) -> dict[str, float]:
        """Return the same where weight pulls the body down, or at the low end of its way."""
        return lying(self.rig.settings, self._place)


def bench_of(variants: Sequence[StageVariant]) -> StageBench:
    """Return the bench of a body of one or several coordinates."""
    several = variants[0].setup.rig.settings.several
    return AxesBench(variants) if several else StageBench(variants)
