"""Predict the output of a whole record from its drive, or compute the drive for an output."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from anhyst._core import status_text
from anhyst.data.path import History, HistoryLike
from anhyst.laws.law import IronOperator
from anhyst.model.model_data import ModelData
from anhyst.model.parameters import Circuit
from anhyst.model.prediction import BoolArray, InputKind, Prediction, flag_samples
from anhyst.support.errors import InputError, NegativeResult, wrong_key
from anhyst.support.numeric import FloatArray
from anhyst.support.wording import count_text

OK = 0
NOT_CONVERGED = -5
NOT_SETTLED = -6  # the computation ended without a solution

MIN_RUN_SAMPLES = 8
"""Minimum number of samples at each scheduling value of a run. If a run at one value is shorter,
the schedule counts as moving."""

_Step = Callable[
    [FloatArray, FloatArray, FloatArray, FloatArray], tuple[FloatArray, FloatArray, FloatArray, int, int]
]

PIECE_SAMPLES = 1 << 16
"""Number of samples per call of the core."""

MAX_CYCLES = 10_000
CYCLE_TOLERANCE = 1e-12
LAYERS_CYCLE_TOLERANCE = 1e-10
"""A cycle is closed if its state returns within this tolerance: fields relative to the parameter
``a``, the magnetisation relative to ``M_s``. Rounding errors of layers are larger."""


class SampleError(InputError):
    """A sample that the core rejects."""

    def __init__(self, name: str, sample: int, fault: str) -> None:
        super().__init__(f"{name}: sample {sample} {fault}", code="sample-refused", key=name)
        self.sample = sample
        self.fault = fault


@dataclass(eq=False)
class _RecordRun:
    """Inputs of a record, and arrays for its results."""

    model: ModelData
    kind: InputKind
    inputs: FloatArray
    schedule: FloatArray | None
    rate: FloatArray | None

    def __post_init__(self) -> None:
        size = self.inputs.size
        self.results, self.flux_density, self.field = (np.empty(size) for _ in range(3))
        self.reachable: BoolArray = np.ones(size, dtype=np.bool_)

    def circuit(self, run: slice) -> Circuit:
        """Return the circuit around the iron for a part of the record."""
        size = self.inputs[run].size
        rate = np.zeros(size) if self.rate is None else self.rate[run]
        return self.model.circuit(None if self.schedule is None else self.schedule[run], rate)

    def core_input(self, run: slice, circuit: Circuit) -> FloatArray:
        """Return the input of the core for a part of the record: drive, A/m, or flux density, T."""
        if self.kind == "drive":
            return circuit.magnetomotive(self.inputs[run])
        flux_density, self.reachable[run] = circuit.flux_density(self.inputs[run])
        return flux_density


def run_record(
    model: ModelData,
    kind: InputKind,
    values: ArrayLike,
    schedule: ArrayLike | None,
    time: ArrayLike | None,
    history: HistoryLike | None,
) -> Prediction:
    """Compute the output for a drive, or the drive for a demanded output."""
    inputs = as_samples(values, kind)
    if model.dynamics is not None and model.dynamics.needs_time:
        clock = _require_times(time, inputs.size, "a lag or creep ([dynamics])")
        return _run_with_dynamics(model, kind, inputs, schedule, clock, as_history(history, model))
    result = _run_without_dynamics(model, kind, inputs, schedule, time, history)
    if model.flux is None:
        return result
    gap = as_samples(
        model.schedule_or_default(None) if schedule is None else schedule, "schedule", inputs.size
    )
    flux_linkage = np.copysign(model.flux.flux_linkage(result.output, gap), result.flux_density)
    return replace(result, flux_linkage=flux_linkage)


def _run_without_dynamics(
    model: ModelData,
    kind: InputKind,
    inputs: FloatArray,
    schedule: ArrayLike | None,
    time: ArrayLike | None,
    history: HistoryLike | None,
) -> Prediction:
    """Compute a record of an actuator without lag and creep."""
    schedule_values = None if schedule is None else as_samples(schedule, "schedule", inputs.size)
    if schedule_values is None:
        model.schedule_or_default(None)
    history_before = as_history(history, model)
    record = _RecordRun(model, kind, inputs, schedule_values, eddy_rate(model, time, inputs.size))
    runs = list(_split_runs(model, schedule_values, inputs.size))
    results = [_run_stretch(record, run, history_before) for run in runs]
    drive, output = (inputs, record.results) if kind == "drive" else (record.results, inputs)
    clock = None if time is None else as_samples(time, "time", inputs.size)
    is_valid, flags = flag_samples(model, kind, drive, output, schedule_values, record.reachable, clock)
    if not record.reachable.all():
        zero_flux_output = model.circuit(schedule_values, np.zeros(inputs.size)).output(np.zeros(inputs.size))
        output = np.where(record.reachable, inputs, zero_flux_output)
    notes = []
    if len(runs) > 1:
        notes.append(
            f"the schedule changes {len(runs) - 1} times; the iron of this model changes with it, "
            f"so each part starts with the history again ({history_before})"
        )
    cycles = [inputs[run] for run in runs] if history_before.kind == "settled" else []
    if any(
        cycle.size > 2 and abs(cycle[-1] - cycle[0]) > 2.0 * np.abs(np.diff(cycle)).max() for cycle in cycles
    ):
        notes.append(f"the {kind} does not end where it starts; 'settled' repeats it with a straight return")
    return Prediction(
        drive=drive,
        output=output,
        flux_density=record.flux_density,
        field=record.field,
        valid=is_valid,
        state=results[-1][0],
        cycles=max(cycles for _, cycles in results),
        history=history_before,
        reachable=record.reachable,
        flags=flags,
        notes=tuple(notes),
        quantities=(model.input, model.output),
    )


def _run_with_dynamics(
    model: ModelData,
    kind: InputKind,
    inputs: FloatArray,
    schedule: ArrayLike | None,
    time: FloatArray,
    initial_history: History,
) -> Prediction:
    """Compute a record with lag and creep. For a demand, the lag advances the drive in time."""
    dynamics, schedules = model.dynamics, None
    assert dynamics is not None
    if schedule is not None:
        schedules = as_samples(schedule, "schedule", inputs.size)

    def convert_creep(flux: FloatArray) -> FloatArray:
        """Return the output with creep for a drive, or without creep for a demand."""
        if initial_history.kind == "settled":
            creep_state = dynamics.settled_creep(flux, time, is_flux_known=kind == "drive")
        else:  # the creep has settled at rest before the record
            creep_state = np.full(len(dynamics.times), _flux_at_rest(model, schedules, initial_history))
        output_with_creep, _, _ = dynamics.apply_creep(flux, time, creep_state, is_flux_known=kind == "drive")
        return model.circuit(schedules, np.zeros(inputs.size)).output(output_with_creep)

    fast_inputs, reachable = inputs, np.ones(inputs.size, dtype=np.bool_)
    if kind == "drive":
        fast_inputs = dynamics.delay_record(inputs, time)
    elif dynamics.times:
        flux, reachable = model.circuit(schedules, np.zeros(inputs.size)).flux_density(inputs)
        fast_inputs = convert_creep(flux)
    run = _run_without_dynamics(model, kind, fast_inputs, schedule, time, initial_history)
    drive, output = inputs, run.output
    if kind == "demand":
        # The lag advances the drive in time; the last value is held after the end.
        drive, output = np.interp(time + dynamics.lag, time, run.drive), inputs
    elif dynamics.times:
        output = convert_creep(run.flux_density)
    is_valid, flags = flag_samples(model, kind, drive, output, schedules, reachable & run.reachable, time)
    return replace(run, drive=drive, output=output, valid=is_valid, flags=flags)


def _flux_at_rest(model: ModelData, schedule: FloatArray | None, initial_history: History) -> float:
    """Return the flux density, T, at the last reversal before the first sample."""
    if not initial_history.turning_points:
        return 0.0
    first_gap = None if schedule is None else schedule[:1]
    last_drive = as_samples(initial_history.turning_points[-1:], "turning point")
    return float(
        _run_without_dynamics(model, "drive", last_drive, first_gap, [0.0], initial_history).flux_density[0]
    )


def _require_times(time: ArrayLike | None, size: int, reason: str) -> FloatArray:
    """Return the times of samples, s; `reason` is the part of the model that needs them."""
    if time is None:
        text = f"the model has {reason}; give the time, in a file as column t_s"
        raise InputError(text, code="time-missing", key="t_s")
    clock = as_samples(time, "time", size)
    if (np.diff(clock) <= 0.0).any():
        sample = int(np.argmax(np.diff(clock) <= 0.0)) + 1
        raise wrong_key("time", f"does not ascend at sample {sample}", code="time-not-rising")
    return clock


def slow_times(size: int) -> FloatArray:
    """Return times of samples, s, with such long steps that eddy currents are negligible."""
    return 1e9 * np.arange(size, dtype=np.float64)


def _run_stretch(record: _RecordRun, run: slice, history: History) -> tuple[FloatArray, int]:
    """Compute an uninterrupted part of a record; return the final state and number of cycles."""
    start = None if record.schedule is None else float(record.schedule[run.start])
    iron = record.model.iron_at(start)
    if record.rate is not None:
        # A steady-state cycle returns to its start at its own rate. Without such a cycle, the rate
        # at the first sample is unknown and taken as zero.
        later_rates = record.rate[run][1:]
        is_cycle = history.kind == "settled" and later_rates.size
        record.rate[run.start] = np.median(later_rates) if is_cycle else 0.0
    state, cycles = initial_state(record.model, iron, history, start), 0
    if history.kind == "settled":
        state, cycles = _settle(iron, record, run, state)
    is_prediction = record.kind == "drive"
    run_core = _core_function(iron, record.kind)
    # The circuit of a long record is computed in pieces to save memory.
    for first_row in range(run.start, run.stop, PIECE_SAMPLES):
        rows = slice(first_row, min(first_row + PIECE_SAMPLES, run.stop))
        circuit = record.circuit(rows)
        core = record.core_input(rows, circuit)
        result, field, state, status, index = run_core(core, circuit.rho, circuit.eddy, state)
        check_status(status, record.kind, first_row + index, record.inputs)
        record.results[rows] = circuit.output(result) if is_prediction else circuit.drive(result)
        record.flux_density[rows] = result if is_prediction else core
        record.field[rows] = field
    return state, cycles


def initial_state(
    model: ModelData, iron: IronOperator, history: History, schedule: float | None
) -> FloatArray:
    """Return the state of the iron before the first sample."""
    state = np.zeros(model.states)
    is_remembered = history.kind == "conditioned" or model.operator_law.has_return_point_memory
    if not history.turning_points or not is_remembered:
        return state
    # The exact step does not depend on the sampling, so reversals are enough.
    points = np.array(history.turning_points)
    gaps = None if schedule is None else np.array(history.schedule_at_points(schedule), dtype=np.float64)
    circuit = model.circuit(gaps, np.zeros(points.shape))
    drive = circuit.magnetomotive(points)
    state_after: FloatArray
    _, _, state_after, status, index = iron.forward(drive, circuit.rho, circuit.eddy, state)
    check_status(status, "turning point", index, points)
    return state_after


def _core_function(iron: IronOperator, kind: InputKind) -> _Step:
    step: _Step = iron.forward if kind == "drive" else iron.inverse
    return step


def _settle(iron: IronOperator, record: _RecordRun, run: slice, start: FloatArray) -> tuple[FloatArray, int]:
    """Repeat a cycle until its state returns; also return the number of cycles."""
    kind, circuit = record.kind, record.circuit(run)
    core_inputs = (record.core_input(run, circuit), circuit.rho, circuit.eddy)
    tolerance = CYCLE_TOLERANCE if record.model.layers is None else LAYERS_CYCLE_TOLERANCE
    state, cycles, status = iron.settle(*core_inputs, start, kind == "demand", MAX_CYCLES, tolerance)
    if status == NOT_SETTLED:
        raise NegativeResult(
            f"the {kind} was repeated {cycles} times, but the cycle does not close: "
            "it is too small relative to the pinning of the model; use another history",
            code="cycle-does-not-close",
        )
    if status != OK:  # once more, to find the sample
        *_, second_status, index = _core_function(iron, kind)(*core_inputs, start)
        check_status(second_status or status, kind, run.start + index, record.inputs)
    return state, cycles


def as_samples(values: ArrayLike, name: str, size: int | None = None) -> FloatArray:
    """Return values as a finite array of samples; a scalar is repeated if `size` is given."""
    array = np.ascontiguousarray(values, dtype=np.float64)
    if size is not None and np.ndim(values) == 0:
        array = np.full(size, float(array.reshape(-1)[0]))
    if array.ndim != 1 or not array.size:
        raise wrong_key(name, f"has shape {array.shape}; give one row of samples", code="wrong-shape")
    if size is not None and array.size != size:
        text = f"has {count_text(array.size, 'sample')} for {size}; give one for each"
        raise wrong_key(name, text, code="length-differs")
    is_finite = np.isfinite(array)
    if not is_finite.all():
        text = f"sample {int(np.argmin(is_finite))} is not a finite number; correct it"
        raise wrong_key(name, text, code="not-finite")
    return array


def as_history(history: HistoryLike | None, model: ModelData) -> History:
    """Return the given history, or the history of the model."""
    return model.history if history is None else History.of(history)


def eddy_rate(model: ModelData, time: ArrayLike | None, size: int) -> FloatArray | None:
    """Return 1/dt of each sample, 1/s (0 for the first); None without eddy currents."""
    if not model.has_eddy_currents:
        return None
    steps = np.diff(_require_times(time, size, "eddy currents (gamma)"))
    return np.concatenate([[0.0], 1.0 / steps])


def check_status(status: int, name: str, index: int, values: FloatArray) -> None:
    """Raise an error with the sample for a status code of the core."""
    if status == OK:
        return
    error = SampleError(name, index, f"({values[index]:g}) {status_text(status)}")
    if status in {NOT_CONVERGED, NOT_SETTLED}:
        raise NegativeResult(str(error), code=error.code, key=name)
    raise error


def _split_runs(model: ModelData, schedule: FloatArray | None, size: int) -> Iterator[slice]:
    """Split a record where the iron itself changes, as with the gap map ``free``."""
    if schedule is None or not model.needs_fixed_gap:
        yield slice(0, size)
        return
    bounds = np.concatenate([[0], np.flatnonzero(np.diff(schedule)) + 1, [size]])
    lengths = np.diff(bounds)
    if len(lengths) > 1 and lengths.min() < MIN_RUN_SAMPLES:
        raise InputError(
            f"the schedule moves at sample {int(bounds[1])}, but in this model (gap map 'free') the "
            f"iron itself varies with it ({', '.join(model.varying)}): run each value separately, "
            "or identify with the gap map scaling or reluctance",
            code="schedule-moves",
        )
    for start, stop in pairwise(bounds):
        yield slice(int(start), int(stop))
