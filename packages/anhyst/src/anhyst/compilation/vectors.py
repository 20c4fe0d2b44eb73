"""Make golden vectors: inputs of a compensator or a controller, and the expected outputs.

Compensators run over jumps, moving gaps, values beyond the limits and deviating currents. A
position controller lifts, moves and sets down a simulated armature: a magnet in double precision, a
mass between two stops, and a position sensor with finite resolution, such as an encoder.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from anhyst._core import POSITION_MAGNETS, FixedCompensator
from anhyst.compensate.block import make_core
from anhyst.compensate.force_controller import Step, select_steps
from anhyst.compensate.plan import Plan
from anhyst.compilation.controller import ControllerPlan
from anhyst.support.numeric import FloatArray
from anhyst.support.states import Command, Phase, State

COLUMNS = ("demand", "gap", "applied", "current")
VECTOR_ROWS = 1000
SEED = 1

VectorRow = tuple[float, float, float, float]


def make_golden_vectors(plan: Plan) -> list[VectorRow]:
    """Run a compensator over all kinds of inputs, and return inputs and currents."""
    inputs = _make_inputs(plan)
    loss_factors = np.random.default_rng(SEED + 1).random(VECTOR_ROWS)
    solve, commit = _select_steps(plan)
    table = []
    for index, (demand, gap) in enumerate(inputs.tolist()):
        current = solve(demand, gap)
        applied_current = current
        if index % 8 == 7:  # the amplifier delivers less than the solved current
            applied_current = type(current)(current * loss_factors[index])
            applied_current = (
                float(np.float32(applied_current)) if isinstance(applied_current, float) else applied_current
            )
        commit(applied_current, gap)
        table.append((demand, gap, applied_current, current))
    return table


def _select_steps(plan: Plan) -> tuple[Step, Step]:
    """Return the functions solve and commit of a new compensator, in the format of its signals."""
    core = make_core(plan.block)
    if not isinstance(core, FixedCompensator):
        return core.solve, core.commit
    return select_steps(core, plan.request.io)


def _make_inputs(plan: Plan) -> NDArray[Any]:
    """Return demands and gaps in the format of the signals: a walk, jumps, some out of range."""
    low, high = (end / plan.block.scales.demand for end in plan.block.limits.demand)
    if plan.request.io == "f32":
        scales = plan.block.scales
        demand, gap = _make_walk((low, high))
        numbers = np.stack([demand * scales.demand, scales.gap_at(gap)], axis=1)
        return numbers.astype(np.float32).astype(np.float64)
    return make_input_codes((low, high), 2**15 if plan.request.io == "q15" else 2**31)


def make_input_codes(demand_range: tuple[float, float], code_of_one: int) -> NDArray[np.int32]:
    """Return demands and gaps as fixed-point codes, shape (VECTOR_ROWS, 2)."""
    codes = np.rint(np.stack(_make_walk(demand_range), axis=1) * code_of_one)
    return np.asarray(np.clip(codes, -code_of_one, code_of_one - 1), dtype=np.int32)


def _make_walk(demand_range: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
    """Return demands and gaps as fractions of their ranges."""
    random = np.random.default_rng(SEED)
    low, high = demand_range
    walk = np.cumsum(random.normal(0.0, 0.05, VECTOR_ROWS) * 10.0 ** random.uniform(-3.0, 0.0, VECTOR_ROWS))
    demand = low + (high - low) * (0.5 + 0.5 * np.sin(walk * 3.0))
    is_jump_sample = random.random(VECTOR_ROWS) < 0.05
    demand[is_jump_sample] = random.choice([low, high], is_jump_sample.sum())
    is_beyond_range = random.random(VECTOR_ROWS) < 0.02
    demand[is_beyond_range] = random.uniform(-1.0, 1.0, is_beyond_range.sum())
    moving_gap = 0.5 - 0.5 * np.cos(np.arange(VECTOR_ROWS) * 2.0 * np.pi / 250.0)
    gap = np.where(np.arange(VECTOR_ROWS) % 500 < 250, np.round(moving_gap * 4.0) / 4.0, moving_gap)
    return demand, gap


def write_vectors_csv(columns: Iterable[str], table: Iterable[Sequence[float]]) -> str:
    """Return vectors as the text of a CSV file."""
    rows = (",".join(map(_cell_text, row)) for row in table)
    return "\n".join([",".join(columns), *rows]) + "\n"


def _cell_text(value: float) -> str:
    """Return the text of a fixed-point code, or the shortest text of a single-precision number."""
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
LEVITATION_INPUT_COUNT = 5 + POSITION_MAGNETS
"""Number of input columns. All other columns are outputs."""

_SUBSTEPS = 4
_SENSOR_STEPS_PER_RANGE = 4096  # resolution: number of steps over the possible gaps
_WAIT_S = 0.01
_RAMP_S = 0.03  # duration of the force ramps at lift-off and after landing
_MAX_TICKS = 20_000  # time limit of one run
_Q31 = 2.0**31

LevitationRow = tuple[int, ...]


def to_q31(value: float, full_scale: float) -> int:
    """Return the nearest q31 code of a signal; halves are rounded up, and overflow saturates."""
    return int(max(-_Q31, min(_Q31 - 1.0, math.floor(value / full_scale * _Q31 + 0.5))))


def make_levitation_vectors(plan: Plan, controller: ControllerPlan) -> list[LevitationRow]:
    """Levitate a simulated armature, and record inputs and outputs of the controller.

    The run contains start, lift-off, a step, a missing sample, an implausible sample, and landing.
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
        self.native = self.controller.new_position_controller()
        self.tick = control.pidd2.tick
        self.gap_span = limits.gap_high - limits.gap_low
        self.rest_gap = limits.gap_high - 0.1 * self.gap_span
        self.gap, self.velocity = self.rest_gap, 0.0
        slowest_rate = min(levitation.lift_rate, levitation.set_down_rate)
        self.load = min(0.1 * control.pidd2.high, _RAMP_S * slowest_rate)
        speed = min(levitation.rise_speed, levitation.descend_speed)
        travel = max(4.0 * levitation.detect, min(0.25 * self.gap_span, _WAIT_S * speed))
        self.target = self.rest_gap - travel
        gains = self.controller.source.table.pidd2_gains()
        damping_ratio = gains.K_p**2 / (gains.K_i * gains.K_d) if gains.K_i * gains.K_d else 3.0
        self.mass = gains.K_d**2 / gains.K_p / damping_ratio if gains.K_d else 1.0
        self.magnets = [
            self.plan.model.stepper(self._magnet_gap(i), "demagnetised")
            for i in range(self.controller.magnets)
        ]
        self.currents = [0.0, 0.0]

    def run(self) -> list[LevitationRow]:
        wait_ticks = max(round(_WAIT_S / self.tick), 20)
        for _ in range(self.controller.control.limits.selftest + 5):
            self._step()
        self._step(Command.DEMAGNETISED)
        self._step(Command.LIFT)
        self._run_until(Phase.HOVER)
        self._wait(wait_ticks)
        self.target -= 0.05 * self.gap_span
        self._wait(wait_ticks)
        if self.controller.control.limits.max_missing_samples > 0:
            self._step(read_gap=math.nan)
            self._wait(wait_ticks // 4)
            self._step(read_gap=self.gap + self.gap_span)
        self._wait(wait_ticks)
        self._step(Command.LAND)
        self._run_until(Phase.REST)
        self._wait(5)
        return self.rows

    def _wait(self, ticks: int) -> None:
        for _ in range(ticks):
            self._step()

    def _run_until(self, phase: Phase) -> None:
        while self.rows[-1][-2] % 16 != phase and len(self.rows) < _MAX_TICKS:
            if self.rows[-1][-2] // 16 == State.FAULT and phase != Phase.REST:
                return
            self._step()

    def _step(self, command: Command = Command.NONE, read_gap: float | None = None) -> None:
        """Run the controller for a tick, then the armature; new currents flow one tick later."""
        used_gap = self._read_gap() if read_gap is None else read_gap
        measured_currents = self.currents[0], self.currents[1]
        outputs = self.native.tick(used_gap, self.target, 0.0, measured_currents, command=int(command))
        self.rows.append(
            (*self._input_codes(used_gap, measured_currents, command), *self._output_codes(outputs))
        )
        self._move_armature()
        self.currents = [outputs[0], outputs[1]]

    def _read_gap(self) -> float:
        step = self.gap_span / _SENSOR_STEPS_PER_RANGE
        return round(self.gap / step) * step

    def _input_codes(
        self, read_gap: float, measured_currents: tuple[float, float], command: Command
    ) -> Iterator[int]:
        settings, middle_gap = self.controller.settings, self.controller.control.gap_middle
        position, current = settings["position_full"], settings["current_full"]
        is_dropped = math.isnan(read_gap)
        yield 0 if is_dropped else to_q31(middle_gap - read_gap, position)
        yield to_q31(middle_gap - self.target, position)
        yield 0
        yield from (to_q31(measured_current, current) for measured_current in measured_currents)
        yield int(is_dropped)
        yield int(command)

    def _output_codes(self, outputs: tuple[float, float, float, float, int, int]) -> Iterator[int]:
        settings, middle_gap = self.controller.settings, self.controller.control.gap_middle
        yield from (to_q31(driven_currents, settings["current_full"]) for driven_currents in outputs[:2])
        yield to_q31(middle_gap - outputs[2], settings["position_full"])
        yield to_q31(outputs[3], settings["demand_full"])
        yield outputs[4]
        yield outputs[5]

    def _magnet_gap(self, magnet: int) -> float:
        """Return the gap of a magnet, limited to the range of its model."""
        total = self.controller.control.gap_total
        gap = self.gap if magnet == 0 or total is None else total - self.gap
        scales = self.plan.block.scales
        return max(scales.gap_low, min(scales.gap_high, gap))

    def _move_armature(self) -> None:
        forces = [iron.commit(self.currents[i], self._magnet_gap(i)) for i, iron in enumerate(self.magnets)]
        net_force = forces[0] - (forces[1] if len(forces) > 1 else 0.0)
        limits, dt = self.controller.control.limits, self.tick / _SUBSTEPS
        for _ in range(_SUBSTEPS):
            self.velocity += dt * (self.load - net_force) / self.mass
            self.gap += dt * self.velocity
            if not limits.gap_low < self.gap < self.rest_gap:
                self.gap = max(limits.gap_low, min(self.rest_gap, self.gap))
                self.velocity = 0.0
