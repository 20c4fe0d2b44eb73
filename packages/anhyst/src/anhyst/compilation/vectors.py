"""Golden vectors: what goes in and what must come out, code by code.

Golden vectors of a position controller: an armature is lifted, moved and set down.

The magnet is the model in double precision, the armature a mass between two stops, and what the
controller sees of it has steps, as an encoder's.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from anhyst._core import POSITION_MAGNETS, FixedCompensator
from anhyst.compensate.block import core_of
from anhyst.compensate.force_controller import Step, steps_of
from anhyst.compensate.plan import Plan
from anhyst.compilation.controller import ControllerPlan
from anhyst.support.numeric import FloatArray
from anhyst.support.states import Command, Phase, State

COLUMNS = ("demand", "gap", "applied", "current")
ROWS = 1000
SEED = 1

Row = tuple[float, float, float, float]


def golden_vectors(plan: Plan) -> list[Row]:
    """Run a compensator over jumps, moving gaps, codes beyond limits and currents not given."""
    inputs = _inputs(plan)
    lost = np.random.default_rng(SEED + 1).random(ROWS)
    solve, commit = _steps(plan)
    table = []
    for index, (demand, gap) in enumerate(inputs.tolist()):
        current = solve(demand, gap)
        applied = current
        if index % 8 == 7:  # the amplifier gives less than was wanted
            applied = type(current)(current * lost[index])
            applied = float(np.float32(applied)) if isinstance(applied, float) else applied
        commit(applied, gap)
        table.append((demand, gap, applied, current))
    return table


def _steps(plan: Plan) -> tuple[Step, Step]:
    """Return solve and commit of a fresh compensator, in what its interface takes."""
    core = core_of(plan.block)
    if not isinstance(core, FixedCompensator):
        return core.solve, core.commit
    return steps_of(core, plan.request.io)


def _inputs(plan: Plan) -> NDArray[Any]:
    """Return demand and gap as the interface takes them: a walk, jumps, some out of range."""
    low, high = (end / plan.block.scales.demand for end in plan.block.limits.demand)
    if plan.request.io == "f32":
        scales = plan.block.scales
        demand, gap = _walk((low, high))
        numbers = np.stack([demand * scales.demand, scales.gap_at(gap)], axis=1)
        return numbers.astype(np.float32).astype(np.float64)
    return codes_of_inputs((low, high), 2**15 if plan.request.io == "q15" else 2**31)


def codes_of_inputs(ends: tuple[float, float], unit_code: int) -> NDArray[np.int32]:
    """Return demands and gaps as fixed point takes them, shape (ROWS, 2)."""
    codes = np.rint(np.stack(_walk(ends), axis=1) * unit_code)
    return np.asarray(np.clip(codes, -unit_code, unit_code - 1), dtype=np.int32)


def _walk(ends: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
    """Return demands and gaps in parts of their ranges."""
    random = np.random.default_rng(SEED)
    low, high = ends
    walk = np.cumsum(random.normal(0.0, 0.05, ROWS) * 10.0 ** random.uniform(-3.0, 0.0, ROWS))
    demand = low + (high - low) * (0.5 + 0.5 * np.sin(walk * 3.0))
    jump = random.random(ROWS) < 0.05
    demand[jump] = random.choice([low, high], jump.sum())
    beyond = random.random(ROWS) < 0.02
    demand[beyond] = random.uniform(-1.0, 1.0, beyond.sum())
    moving = 0.5 - 0.5 * np.cos(np.arange(ROWS) * 2.0 * np.pi / 250.0)
    gap = np.where(np.arange(ROWS) % 500 < 250, np.round(moving * 4.0) / 4.0, moving)
    return demand, gap


def vectors_csv(columns: Iterable[str], table: Iterable[Sequence[float]]) -> str:
    """Return vectors as a CSV file."""
    rows = (",".join(map(_text, row)) for row in table)
    return "\n".join([",".join(columns), *rows]) + "\n"


def _text(value: float) -> str:
    """Return a code, or the shortest number that comes back in single precision."""
    return str(value) if isinstance(value, int) else str(np.float32(value))


LEVITATION_COLUMNS = (
    "position",
    "target",
    "load",
    *(f"current_{number}" for number in range(1, POSITION_MAGNETS + 1)),
    "dropped",
    "command",
    *(f"drive_{number}" for number in range(1, POSITION_MAGNETS + 1)),
    "reference",
    "demand",
    "state",
    "flags",
)
INPUTS = 5 + POSITION_MAGNETS
"""Of these columns; the others are answers."""

_SUBSTEPS = 4
_SENSOR_STEPS = 4096  # over the gaps that can be
_WAIT_S = 0.01
_RAMP_S = 0.03  # of the force, at lift-off and after landing
_MOST_TICKS = 20_000  # of one run
_Q31 = 2.0**31

LevitationRow = tuple[int, ...]


def code(value: float, full: float) -> int:
    """Return the nearest q31 of a signal; halves go up, what is beyond saturates."""
    return int(max(-_Q31, min(_Q31 - 1.0, math.floor(value / full * _Q31 + 0.5))))


def levitation_vectors(plan: Plan, controller: ControllerPlan) -> list[LevitationRow]:
    """Levitate a simulated armature and write down what the controller was given and answered.

    Power on, lift-off, a step, a sample that is missing and one that cannot be, landing.
    """
    return _LevitationRun(plan, controller).run()


@dataclass
class _LevitationRun:
    plan: Plan
    controller: ControllerPlan
    rows: list[LevitationRow] = field(default_factory=list)

    def __post_init__(self) -> None:
        control = self.controller.control
        limits, levitation = control.limits, control.levitation
        self.native = self.controller.start()
        self.tick = control.pidd2.tick
        self.span = limits.gap_high - limits.gap_low
        self.rest = limits.gap_high - 0.1 * self.span
        self.gap, self.velocity = self.rest, 0.0
        slowest = min(levitation.lift_rate, levitation.set_down_rate)
        self.load = min(0.1 * control.pidd2.high, _RAMP_S * slowest)
        speed = min(levitation.rise_speed, levitation.descend_speed)
        way = max(4.0 * levitation.detect, min(0.25 * self.span, _WAIT_S * speed))
        self.target = self.rest - way
        gains = self.controller.source.table.pidd2_gains()
        damped = gains.K_p**2 / (gains.K_i * gains.K_d) if gains.K_i * gains.K_d else 3.0
        self.mass = gains.K_d**2 / gains.K_p / damped if gains.K_d else 1.0
        self.irons = [
            self.plan.model.stepper(self._gap_of(i), "demagnetised")
            for i in range(self.controller.magnets)
        ]
        self.flows = [0.0, 0.0]

    def run(self) -> list[LevitationRow]:
        wait = max(round(_WAIT_S / self.tick), 20)
        for _ in range(self.controller.control.limits.selftest + 5):
            self._step()
        self._step(Command.DEMAGNETISED)
        self._step(Command.LIFT)
        self._until(Phase.HOVER)
        self._wait(wait)
        self.target -= 0.05 * self.span
        self._wait(wait)
        if self.controller.control.limits.max_missing_samples > 0:
            self._step(read=math.nan)
            self._wait(wait // 4)
            self._step(read=self.gap + self.span)
        self._wait(wait)
        self._step(Command.LAND)
        self._until(Phase.REST)
        self._wait(5)
        return self.rows

    def _wait(self, ticks: int) -> None:
        for _ in range(ticks):
            self._step()

    def _until(self, phase: Phase) -> None:
        while self.rows[-1][-2] % 16 != phase and len(self.rows) < _MOST_TICKS:
            if self.rows[-1][-2] // 16 == State.FAULT and phase != Phase.REST:
                return
            self._step()

    def _step(self, command: Command = Command.NONE, read: float | None = None) -> None:
        """Let the controller answer, then the armature go on; what is driven flows a tick later."""
        seen = self._sensed() if read is None else read
        measured = self.flows[0], self.flows[1]
        answer = self.native.tick(seen, self.target, 0.0, measured, command=int(command))
        self.rows.append((*self._given(seen, measured, command), *self._answered(answer)))
        self._move()
        self.flows = [answer[0], answer[1]]

    def _sensed(self) -> float:
        step = self.span / _SENSOR_STEPS
        return round(self.gap / step) * step

    def _given(self, seen: float, measured: tuple[float, float], command: Command) -> Iterator[int]:
        settings, middle = self.controller.settings, self.controller.control.gap_middle
        position, current = settings["position_full"], settings["current_full"]
        dropped = math.isnan(seen)
        yield 0 if dropped else code(middle - seen, position)
        yield code(middle - self.target, position)
        yield 0
        yield from (code(flowing, current) for flowing in measured)
        yield int(dropped)
        yield int(command)

    def _answered(self, answer: tuple[float, float, float, float, int, int]) -> Iterator[int]:
        settings, middle = self.controller.settings, self.controller.control.gap_middle
        yield from (code(driven, settings["current_full"]) for driven in answer[:2])
        yield code(middle - answer[2], settings["position_full"])
        yield code(answer[3], settings["demand_full"])
        yield answer[4]
        yield answer[5]

    def _gap_of(self, magnet: int) -> float:
        """Return the gap of a magnet, within what its law knows."""
        total = self.controller.control.gap_total
        gap = self.gap if magnet == 0 or total is None else total - self.gap
        scales = self.plan.block.scales
        return max(scales.gap_low, min(scales.gap_high, gap))

    def _move(self) -> None:
        forces = [iron.commit(self.flows[i], self._gap_of(i)) for i, iron in enumerate(self.irons)]
        net = forces[0] - (forces[1] if len(forces) > 1 else 0.0)
        limits, dt = self.controller.control.limits, self.tick / _SUBSTEPS
        for _ in range(_SUBSTEPS):
            self.velocity += dt * (self.load - net) / self.mass
            self.gap += dt * self.velocity
            if not limits.gap_low < self.gap < self.rest:
                self.gap = max(limits.gap_low, min(self.rest, self.gap))
                self.velocity = 0.0
