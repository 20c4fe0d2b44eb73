"""Measure loops with a running force controller: it drives the current, and its sensors measure.

The controller uses a constant ratio instead of the compensation, so that a demand sets a current.
The demand moves from reversal point to reversal point at the controller's slew rate.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from anhyst.data.loops import Loop, Loops
from anhyst.support.errors import InputError
from anhyst.support.jobs import Progress
from anhyst.support.numeric import FloatArray
from anhyst.support.states import Command, Fault, State
from anhyst.support.units import QUANTITIES
from anhyst_rigs.link.client import RequestRefusedError
from anhyst_rigs.rig.bench.protocol import DemandRange, Parameter, Signal
from anhyst_rigs.rig.measuring import sweep_path
from anhyst_rigs.study.excite.design import (
    Bound,
    Record,
    Specimen,
    current_step,
    design_records,
    find_thermal_peak,
)
from anhyst_rigs.study.excite.excite import (
    PROBE_FORCE_TO_LIMIT,
    DriveHistory,
    Excitation,
    ProbedGap,
    check_operating_force,
    describe_restrictions,
    evaluate_probe,
)

_DWELL_S = 0.02
"""Time at each reversal point, s: the amplifier settles in one half; the other is one sample."""
_READ_INTERVAL_S = 0.01
"""Time from one read of the bench to the next, s."""
_STATE_TIMEOUT_S = 30.0
"""Timeout for a change of state, in which the controller reduces a current along its ramp, s."""
_START_TIMEOUT_S = 2.0
"""Timeout for the start of a run, s. Somebody may have stopped it already."""
_GAP_TOLERANCE_TO_MAX_GAP = 0.01
"""Largest deviation of the held gap from one in the rig file, as a fraction of the largest gap."""
_DEMAND_TOLERANCE_TO_FULL_DEMAND = 1e-7
"""Difference below which two demands count as equal, as a fraction of the full demand."""
_REQUIRED_SIGNALS = ("force", "current", "demand", "gap", "state", "fault")


class DrivenBoard(Protocol):
    """The members of :class:`anhyst_rigs.rig.bench.protocol.Bench` that a measurement uses."""

    @property
    def rate(self) -> float:
        """Tick rate, Hz."""

    @property
    def demand_range(self) -> DemandRange:
        """The demanded quantity and its range."""

    @property
    def signals(self) -> tuple[Signal, ...]:
        """Columns of the rows, after the tick number."""

    @property
    def ticks_per_row(self) -> int:
        """Number of ticks from one row to the next."""

    @property
    def loss_reason(self) -> str:
        """Why the connection is lost; empty while the controller answers."""

    def advance(self, ticks: int) -> FloatArray:
        """Wait for some ticks, and return all new rows."""

    def command(self, command: Command) -> None:
        """Send a command."""

    def demand(self, value: float) -> None:
        """Demand a force, N."""

    def parameters(self) -> tuple[Parameter, ...]:
        """Return the settings with their present values."""

    def apply(self, values: Mapping[str, float]) -> int:
        """Write settings."""


def measure_on_board(specimen: Specimen, bench: DrivenBoard, progress: Progress | None = None) -> Excitation:
    """Measure loops within the limits, at the gap at which the armature is held.

    Finally, the controller is stopped and its previous settings are restored. If it was idle
    before, it becomes idle again.
    """
    drive = BoardDrive(specimen, bench)
    # Boards are read too slowly for fast cycles.
    board_specimen = replace(specimen, gaps=(drive.gap,), max_current=drive.max_current, fast_rates=())
    thermal_peak = find_thermal_peak(board_specimen)
    loops: list[Loop] = []
    try:
        drive.begin(current_step(board_specimen) / board_specimen.sample_s)
        probed_gap = _probe_gap(board_specimen, drive, thermal_peak)
        check_operating_force(board_specimen, [probed_gap])
        records = design_records(board_specimen, probed_gap.peak.value, probed_gap.operating_current)
        for count, record in enumerate(records):
            loops.append(_record_loop(drive, record))
            if progress is not None:
                progress(count + 1, len(records))
    finally:
        drive.end()
    names = QUANTITIES["current"], QUANTITIES["force"], QUANTITIES["gap"]
    return Excitation(
        Loops(tuple(loops), *names),
        board_specimen,
        (probed_gap,),
        drive.drive_history(),
        tuple(describe_restrictions(board_specimen, [probed_gap])),
    )


class BoardDrive:
    """A drive that sets currents through the constant ratio of a force controller."""

    def __init__(self, specimen: Specimen, bench: DrivenBoard) -> None:
        self._specimen, self._bench = specimen, bench
        names = [signal.name for signal in bench.signals]
        missing_names = [name for name in _REQUIRED_SIGNALS if name not in names]
        if bench.demand_range.unit != "N" or missing_names:
            reason = (
                f"has no signal {', '.join(missing_names)}" if missing_names else "does not control a force"
            )
            raise InputError(
                f"measure: the controller {reason}; measure with a force controller",
                code="controller-without-force",
                key="measure",
            )
        self._column_indices = {name: 1 + names.index(name) for name in _REQUIRED_SIGNALS}
        self._chunk_ticks = max(1, round(_READ_INTERVAL_S * bench.rate))
        self._read_indices = [self._column_indices["current"], self._column_indices["force"]]
        self._rows_per_sample = max(1, round(specimen.sample_s * bench.rate / bench.ticks_per_row))
        self._warmth, self._was_idle, self._drive_timeout_s = 0.0, False, 0.0
        self._samples: list[tuple[float, float, float]] = []
        self._initial_values = {parameter.name: parameter.value for parameter in bench.parameters()}
        self.gap = self._read_held_gap()
        (ratio_parameter,) = (parameter for parameter in bench.parameters() if parameter.name == "ratio")
        limits = [
            specimen.max_current,
            Bound(ratio_parameter.high * bench.demand_range.high, "the controller's ratio"),
        ]
        self.max_current = min(limits, key=lambda parameter: parameter.value)
        self._current_per_demand = self.max_current.value / bench.demand_range.high

    def _read_held_gap(self) -> float:
        """Return the gap of the rig file at which the armature is held, m."""
        gap_read = float(np.mean(self._read_rows()[:, self._column_indices["gap"]]))
        nearest_gap = min(self._specimen.gaps, key=lambda gap: abs(gap - gap_read))
        if abs(nearest_gap - gap_read) > _GAP_TOLERANCE_TO_MAX_GAP * max(self._specimen.gaps):
            gaps = ", ".join(f"{1e3 * gap:g}" for gap in self._specimen.gaps)
            raise InputError(
                f"measure: the armature is at {1e3 * gap_read:.4g} mm; hold it at a gap of the rig "
                f"file: {gaps} mm",
                code="gap-not-of-rig",
                key="measure",
            )
        return nearest_gap

    def begin(self, rate: float) -> None:
        """Prepare to drive currents from zero on, with a rate in A/s."""
        if self._state() is State.RUN:
            self._bench.command(Command.STOP)
            self._wait_for_state(State.READY)
        self._was_idle = self._state() is State.IDLE
        if self._was_idle:
            # Conditioning would use the compiled range instead. The hysteresis state that the
            # controller assumes does not matter, because the controller becomes idle again.
            self._bench.command(Command.DEMAGNETISED)
            self._wait_for_state(State.READY)
        slew = rate / self._current_per_demand
        self._drive_timeout_s = self.max_current.value / rate + _STATE_TIMEOUT_S
        self._bench.apply({"compensation": 0.0, "ratio": self._current_per_demand, "demand_slew": slew})
        self._bench.command(Command.RUN)
        self._wait_for_state(State.RUN, _START_TIMEOUT_S)

    def end(self) -> None:
        """Reduce the current to zero, and restore the settings; ignore a lost controller."""
        with suppress(InputError):
            if self._state() is State.RUN:
                with suppress(RequestRefusedError):  # Somebody else has just stopped it.
                    self._bench.command(Command.STOP)
                self._wait_for_state(State.READY)
            names = ("compensation", "ratio", "demand_slew")
            self._bench.apply({name: self._initial_values[name] for name in names})
            if self._was_idle and self._state() is State.READY:
                self._bench.command(Command.IDLE)

    def drive_to(self, current: float) -> tuple[FloatArray, FloatArray]:
        """Drive the current to a value, A, and dwell; return samples of current and force."""
        force = min(current / self._current_per_demand, self._bench.demand_range.high)
        self._bench.demand(force)
        row_blocks = [self._read_running_rows(self._chunk_ticks)]
        end = self._elapsed_s() + self._drive_timeout_s
        while self._is_driving(row_blocks[-1][-1:], force).any():
            if self._elapsed_s() > end:
                raise InputError(
                    f"measure: the controller does not reach a demand of {force:g} N",
                    code="demand-not-reached",
                    key="measure",
                )
            row_blocks.append(self._read_running_rows(self._chunk_ticks))
        driven_rows = np.concatenate(row_blocks)
        driven_rows = driven_rows[self._is_driving(driven_rows, force)]
        sample_blocks = [
            driven_rows[first_row : first_row + self._rows_per_sample]
            for first_row in range(0, len(driven_rows), self._rows_per_sample)
        ]
        dwell = self._read_running_rows(max(4, round(_DWELL_S * self._bench.rate)))
        row_blocks = [
            *(block for block in sample_blocks if len(block) == self._rows_per_sample),
            dwell[len(dwell) // 2 :],
        ]
        samples = np.array([sample_rows[:, self._read_indices].mean(axis=0) for sample_rows in row_blocks])
        return samples[:, 0], samples[:, 1]

    def _is_driving(self, rows: FloatArray, force: float) -> NDArray[np.bool_]:
        """Return, for each row, whether the demand has not reached its target yet."""
        is_different: NDArray[np.bool_] = (
            np.abs(rows[:, self._column_indices["demand"]] - force)
            > _DEMAND_TOLERANCE_TO_FULL_DEMAND * self._bench.demand_range.high
        )
        return is_different

    def wait_until_cool(self, path: FloatArray) -> None:
        """Wait without current until the winding can stay cool enough during a path, A."""
        winding, sample = self._specimen.winding, self._specimen.sample_s
        if winding is None:
            return
        end = self._elapsed_s() + winding.rest_time(self._warmth, winding.max_start_warmth(path, sample))
        while self._elapsed_s() < end:
            self._read_running_rows(self._chunk_ticks)

    def drive_history(self) -> DriveHistory:
        """Return the measured current, averaged over 10 ms."""
        time, current, warmth = np.array(self._samples).T
        return DriveHistory(time - time[0], current, np.full(time.size, self.gap), warmth)

    def _elapsed_s(self) -> float:
        return float(self._samples[-1][0]) if self._samples else 0.0

    def _read_rows(self) -> FloatArray:
        """Wait for the next rows and return them."""
        rows = self._bench.advance(self._chunk_ticks)
        while not len(rows):
            if self._bench.loss_reason:
                raise InputError(f"measure: {self._bench.loss_reason}", code="port-gone", key="measure")
            rows = self._bench.advance(self._chunk_ticks)
        time = float(rows[-1, 0]) / self._bench.rate
        current = float(rows[:, self._column_indices["current"]].mean())
        winding = self._specimen.winding
        if winding is None:
            self._warmth = np.nan
        elif self._samples:
            interval = time - self._elapsed_s()
            self._warmth = float(winding.warmth_along(np.array([current]), interval, self._warmth)[-1])
        self._samples.append((time, current, self._warmth))
        return rows

    def _read_running_rows(self, ticks: int) -> FloatArray:
        """Return the rows of a number of ticks of a run; stop at the force limit."""
        row_blocks = [self._read_rows()]
        while row_blocks[-1][-1, 0] - row_blocks[0][0, 0] < ticks - self._bench.ticks_per_row:
            row_blocks.append(self._read_rows())
        rows = np.concatenate(row_blocks)
        last_row = rows[-1]
        state = State(int(last_row[self._column_indices["state"]]))
        fault = Fault(int(last_row[self._column_indices["fault"]]))
        if state is not State.RUN:
            reason = "" if fault is Fault.NONE else f" ({fault.name.lower().replace('_', ' ')})"
            raise InputError(
                f"measure: the controller is in the state {state.name.lower()}{reason}",
                code="wrong-state",
                key="measure",
            )
        force, limit = rows[:, self._column_indices["force"]], self._specimen.max_force
        largest_force_row = int(np.argmax(force))
        if not force[largest_force_row] <= limit.value:  # The reading may be nan.
            self._bench.demand(0.0)
            raise InputError(
                f"{limit.key}: {force[largest_force_row]:.4g} N are read at "
                f"{rows[largest_force_row, self._column_indices['current']]:.4g} A, more than {limit.value:g} N; lower "
                "excite.current_max_A",
                code="force-above-limit",
                key=limit.key,
            )
        return rows

    def _state(self) -> State:
        return State(int(self._read_rows()[-1, self._column_indices["state"]]))

    def _wait_for_state(self, target_state: State, timeout_s: float = _STATE_TIMEOUT_S) -> None:
        """Wait until the controller is in a state."""
        end = time.monotonic() + timeout_s
        while (state := self._state()) is not target_state:
            if state is State.FAULT or time.monotonic() > end:
                raise InputError(
                    f"measure: the controller is in the state {state.name.lower()}, not "
                    f"{target_state.name.lower()}; find the cause, and clear its fault",
                    code="wrong-state",
                    key="measure",
                )


def _probe_gap(specimen: Specimen, drive: BoardDrive, thermal_peak: Bound) -> ProbedGap:
    """Raise the current once until a quantity reaches its limit, then return to zero."""
    path = sweep_path([0.0, thermal_peak.value], current_step(specimen))
    drive.wait_until_cool(np.concatenate([path, path[::-1]]))
    forces: list[float] = []
    for current in path.tolist():
        forces.append(float(drive.drive_to(current)[1][-1]))
        if forces[-1] >= PROBE_FORCE_TO_LIMIT * specimen.max_force.value:
            break
    drive.drive_to(0.0)
    return evaluate_probe(specimen, drive.gap, path[: len(forces)], forces, thermal_peak)


def _record_loop(drive: BoardDrive, record: Record) -> Loop:
    """Bring the iron into the initial state of a record, then measure the record."""
    drive.wait_until_cool(record.full_path(record.sample_s))
    for reversal in record.approach_reversals:
        drive.drive_to(reversal)
    sample_blocks = [drive.drive_to(reversal_value) for reversal_value in _find_reversals(record.path)]
    current, force = (np.concatenate(column_blocks) for column_blocks in zip(*sample_blocks, strict=True))
    label = f"{1e3 * drive.gap:g}mm-{record.name}"
    return Loop(label, current, force, np.full(current.size, drive.gap), history=record.history)


def _find_reversals(path: FloatArray) -> list[float]:
    """Return the ends and the reversal points of a path."""
    directions = np.sign(np.diff(path))
    indices = 1 + np.flatnonzero(directions[1:] != directions[:-1])
    return [float(reversal) for reversal in path[[0, *indices, path.size - 1]]]
