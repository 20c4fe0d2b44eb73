"""The virtual bench of a stage: its plant and the core's own controller in lock-step, in process.

No firmware runs: it has no controller of a stage yet. Its set-point is followed over and
over, there and back in turn, with a rest between two of them. Whatever is changed acts on one tick
while the body rests, so that no law, gain or filter changes under force.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from anhyst.compensate.force_controller import ForceController
from anhyst.support.errors import InputError
from anhyst.support.kinds import MethodName
from anhyst.support.numeric import FloatArray
from anhyst.support.states import Command, Fault, Phase, State
from anhyst_rigs.rig.bench.body import layout_of, lying, pulls
from anhyst_rigs.rig.bench.laps import LapBench
from anhyst_rigs.rig.bench.protocol import (
    ALONG,
    STAGE_COMMANDS,
    STAGE_OWN,
    Aim,
    Parameter,
    Signal,
    of_axes_and_magnets,
    permit_stage,
)
from anhyst_rigs.rig.bench.settings import check_values, stage_parameters
from anhyst_rigs.rig.drift import NO_DRIFT, draw_plant, drifted_plant
from anhyst_rigs.rig.loop import ClosedLoop
from anhyst_rigs.rig.plant import current_loops
from anhyst_rigs.rig.recording import CURRENTS, Loss, Recording, column, of_magnets, peak
from anhyst_rigs.rig.stage.drives import largest_push
from anhyst_rigs.rig.stage.geometry import along_scan, scan_direction
from anhyst_rigs.rig.stage.loop import Feedforward, StageSetup, fed_wrench, pid, scenario_along
from anhyst_rigs.rig.stage.recording import WRENCH, demand_columns, of_axes, recorded, stage_loss
from anhyst_rigs.rig.stage.setpoint import (
    STRAY_LATE,
    Course,
    SetPoint,
    braking,
    course_of,
    motion_of,
    strayed,
)

CARRIED_S = 1e-3
"""Over which the force of the integral is taken that another controller goes on with, s."""
REMEMBERED = 4
"""Set-points of which it is kept what flowed, for another law to follow."""
LOAD = 0.5
"""Of what the largest force has left beside the set-point: what the load drive may pull with."""
GAINS = ("acceleration", "jerk", "snap")
"""Of :class:`anhyst_rigs.rig.stage.loop.Feedforward`."""
PHASES = 16
"""In the state that a loop records: times the state of the controller."""
LAPS = 100
"""Of which it is known how they were followed."""


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


class StageBench(LapBench):
    """A stage that follows its set-point over and over.

    The setups are the one without memory and the compensator, which its parameter
    ``compensation`` chooses by 0 and 1. A load pushes along the set-point, unknown to the
    controller; the parameters `push_` add to what is demanded of the magnets, at once. The
    controller lifts the body and sets it down: idle it lies without a current, ready it is held.
    """

    lifted = 0  # tick on which it was lifted last from a rest without current
    _between = False  # whether it is lifted or set down
    _order = Command.NONE  # to the controller, at the next tick
    commands = STAGE_COMMANDS

    def __init__(
        self,
        setups: Sequence[StageSetup],
        gains: Sequence[Feedforward] = (Feedforward(), Feedforward()),
    ) -> None:
        rig = setups[0].rig
        self.rig, self.rate = rig, 1.0 / rig.dt
        file, self._magnets = rig.settings, len(rig.settings.magnets)
        each = of_axes_and_magnets(file.body.free, [magnet.name for magnet in file.placed])
        flight = Signal("flight", "", "what its controller does: Phase of anhyst.support.states")
        self.signals = (*ALONG, *each, flight, *STAGE_OWN)
        self.laps: deque[StageLap] = deque(maxlen=LAPS)
        self._peak = max(file.scan.test_m_per_s2)
        left = largest_push(file, along_scan(file)) - file.body.mass_kg * self._peak
        self.load_most = LOAD * max(left, 0.0)
        ways = zip(file.body.free, np.eye(len(file.body.free)), strict=True)
        self._push_most = {f"push_{axis}": LOAD * largest_push(file, way) for axis, way in ways}
        self._push = dict.fromkeys(self._push_most, 0.0)  # in force
        # a step of the target by so much asks for the largest force at once
        most = file.tracking.force_max_N / pid(rig)["b0"]
        self.aim = Aim("position", "reference", "m", -most, most, 0.0)
        self.setups = tuple(setups)  # as the files say
        self._setups, self._gains = list(setups), list(gains)
        self._values = {
            "compensation": 1.0,
            "motion": 1.0,
            "crossover": rig.settings.tracking.crossover_Hz,
            "plant": 0.0,
        }
        self._staged: dict[str, float] = {}
        self._corrected: dict[int, StageSetup] = {}
        self._laps, self._lap = 0, 0
        self._offset, self._load, self._side = 0.0, 0.0, 1.0
        # what the controller did at the last ticks
        self._flights = np.zeros(0)
        self._move(1.0)
        self._renew()

    @property
    def body(self) -> Mapping[str, Any]:
        """What a picture of the body is drawn from, SI."""
        return {**layout_of(self.rig.settings), "way": peak(self._way.position)}

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
        drift, noise = NO_DRIFT, 0
        if number:
            drift, noise = draw_plant(settings, settings.seed, number - 1)
        self._cable = drift.cable
        self._plant = drifted_plant(self.rig, drift, noise)
        along, stray = scan_direction(settings), float(self._strayed(1, 0.0)[0])
        self._plant.place((-stray * along).tolist(), [0.0] * along.size)
        self._course: Course | None = None
        self._at, self._place = 0, 0.0
        self._past = np.zeros(round(STRAY_LATE / self.rig.dt))  # accelerations
        self._flowed: deque[FloatArray] = deque()
        free = len(self.rig.settings.body.free)
        self._latest = np.zeros((0, 2 * (self._magnets + free)))
        self._carried = np.zeros(free)
        self._known = self.switched = self.tick + 1  # first tick with demagnetised iron
        self._control()

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
        # a controller begins in flight
        self._order = Command.IDLE if self._state is State.IDLE else Command.NONE

    def _remembering(self, setup: StageSetup, magnet: int) -> ForceController:
        """Return a compensator that has followed what flowed in a magnet."""
        drive = setup.fresh()[magnet]
        path = np.concatenate([*self._flowed, self._latest[-1:]])
        if len(path):
            scale, zero = (1.0, 0.0) if setup.correction is None else setup.correction[magnet, :2]
            drive.follow(scale * path[:, magnet], path[:, self._magnets + magnet] - zero)
        return drive

    def _turn(self) -> None:
        if self._course is not None:
            if self._at < len(self._course):
                return
            self._place += float(self._course.position[-1])
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
            place = course.position[at : at + n + 1]
            accelerations, ahead = course.acceleration[at : at + n], course.ahead[at : at + n]
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
        if self._course is not None:
            n = min(n, len(self._course) - self._at)
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
        driven = bool(self._flowed) and self._flowed[-1][-1:, : self._magnets].any()
        if self._course is not None or self._between:
            self._flowed.append(flowed)
        elif self._state is State.IDLE and driven:
            self._flowed.append(flowed[-1:])

    def _step(
        self, place: FloatArray, stray: FloatArray, forward: FloatArray
    ) -> tuple[list[FloatArray], FloatArray, Loss | None]:
        """Return what is read of some ticks, signal by signal; what flowed; and whether it was lost.

        What flowed: of each magnet the current and the gap as the controller knows it, then what
        was demanded along each coordinate, and what was fed forward.
        """
        rig, free = self.rig, self.rig.settings.body.free
        fed = fed_wrench(self._setup.believed, forward) + list(self._push.values())
        scenario = scenario_along(rig, place, stray, fed + self._carried, self._offset)
        scenario.command[0], self._order = self._order, Command.NONE
        load = self._load - self._cable * place[:-1]
        run = self._loop.run(replace(scenario, load=load))
        held = self._state is not State.IDLE and not self._between  # else it may lie on a stop
        loss = stage_loss(rig, run, len(fed)) if held else None
        run = run.part(0, len(fed) if loss is None else loss.tick + 1)
        seen = dict(run.columns) | recorded(rig, run, scenario) | self._beside(run)
        wanted = [run[name] for name in of_axes("demand", free, WRENCH)]
        currents = [run[name] for name in of_magnets(CURRENTS[:1], 1, self._magnets)]
        gaps = [run[name] for name in of_magnets([("gap_read", "m")], 1, self._magnets)]
        flowed = [*currents, *gaps, *wanted, fed[: len(run)]]
        of_loop = [seen[column(one.name, one.unit)] for one in self._of_loop]
        return of_loop, np.column_stack(flowed), loss

    def _beside(self, run: Recording) -> dict[str, FloatArray]:
        """Return the flight, what each magnet pulls with, and what all do along each coordinate."""
        settings = self.rig.settings
        free = settings.body.free
        wrench = [run[name] for name in of_axes("wrench", free, WRENCH)]
        read = dict(zip(demand_columns(free, "wrench"), wrench, strict=True))
        self._flights = run["state"] % PHASES
        if self._between and self._flights[-1] in (Phase.HOVER, Phase.REST):
            self._between = False
            self._state = State.READY if self._flights[-1] == Phase.HOVER else State.IDLE
        return read | pulls(settings, run) | {"flight": self._flights}

    def _rows(self, n: int, *of_loop: FloatArray) -> FloatArray:
        numbers = np.arange(self.tick + 1, self.tick + n + 1, dtype=np.float64)
        own = [np.full(n, float(one)) for one in (self._fault, self._lap)]
        state = np.full(n, float(self._state))
        if self._state is not State.FAULT:
            state[self._flights != Phase.HOVER] = State.RUN
            state[self._flights == Phase.REST] = State.IDLE
        self.tick += n
        return np.column_stack([numbers, *of_loop, state, *own])

    def _lie(self, n: int) -> FloatArray:  # on a stop without a current
        values = lying(self.rig.settings, self._place)
        return self._rows(n, *(np.full(n, values.get(one.name, 0.0)) for one in self._of_loop))

    @property
    def _of_loop(self) -> Sequence[Signal]:
        """The signals that come from the loop; the others are the bench's own."""
        return self.signals[: -len(STAGE_OWN)]

    def command(self, command: Command) -> None:
        """Give a command.

        A stop brakes at once, whatever the state, and the body is held then; one that is lifted is
        set down again.
        """
        if command is Command.STOP and self._between:
            self._order = Command.LAND
        elif command is Command.STOP:
            self._brake()
        else:
            permit_stage(command, self.commands, self._state)
            self._obey(command)

    def _obey(self, command: Command) -> None:
        """Do what a command says that the state permits."""
        if command is Command.RUN:
            # the first leg leads back to where it all began
            side = -1.0 if self._place > 0.0 else 1.0
            self._state, self._side, self._offset = State.RUN, side, 0.0
        elif command is Command.CLEAR:
            self._state, self._fault = State.READY, Fault.NONE
            self._renew()
        else:
            if not self._between:
                self._brake()
            self._order, self._between = command, command is not Command.IDLE
            self._state = State.RUN if self._between else State.IDLE
            if command is Command.LIFT:
                self._known = self.lifted = self.tick + 1

    def _brake(self) -> None:
        if self._state is not State.RUN:
            return
        self._state, self._lap = State.READY, 0
        course, dt = self._course, self.rig.dt
        if course is not None and self._at < len(course):
            self._place += float(course.position[self._at])
            motion = course.motion_at(self._at, dt)
            scan = self.rig.settings.scan  # its largest acceleration, whatever the lap's is
            hardest = motion_of(scan, scan.test_m_per_s2)
            self._begin(braking(*motion, hardest, dt, self.rig.late))

    def demand(self, value: float) -> None:
        """Demand a place beside the set-point, m."""
        self.aim.check(value)
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
        pushes = (
            Parameter(name, WRENCH["_r" in name], -most, most, "at once, asked of the magnets", now)
            for (name, most), now in zip(self._push_most.items(), self._push.values(), strict=True)
        )
        return (*stage_parameters(values, (off, on), crossover), *pushes)

    def apply(self, values: Mapping[str, float]) -> int:
        """Put parameters in force, on the tick on which the body next rests, or pushes on the next."""
        check_values(values, self.parameters(), whole=("compensation", "plant"))
        pushed = {name: force for name, force in values.items() if name in self._push}
        staged = {name: value for name, value in values.items() if name not in self._push}
        due = self.tick + 1
        if staged or not pushed:
            if self._between:
                raise InputError("the stage is lifted or set down: wait", code="wrong-state")
            if self._state is State.FAULT:
                raise InputError("the stage is lost: press clear first", code="wrong-state")
            self._staged |= staged
            due = self._due
        self._push |= pushed
        return due

    def correct(self, setup: StageSetup) -> int:
        """Put what was learnt of a method in force, on the tick on which the body next rests."""
        methods = [one.method for one in self._setups]
        self._corrected[methods.index(setup.method)] = setup
        return self._due

    @property
    def _due(self) -> int:
        left = 0 if self._course is None else len(self._course) - self._at
        return self.tick + left + 1
