"""Generate signals, which a bench adds to its target.

:class:`PeriodicWave` repeats a shape. :class:`Chirp` and :class:`WaveTable` end by themselves.
:class:`DrivenBench` adds such a signal to the target of another bench every millisecond.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst.support.states import Command
from anhyst.support.units import Unit, parse_header, require_unit
from anhyst_rigs.rig.bench.protocol import Bench, Parameter

WAVE_SHAPES: Mapping[str, Callable[[float], float]] = {
    "step": lambda part: 1.0 if part < 0.5 else -1.0,
    "triangle": lambda part: 1.0 - abs(4.0 * ((part + 0.25) % 1.0) - 2.0),
    "sine": lambda part: math.sin(2.0 * math.pi * part),
}
"""Function of each shape from the phase, 0 to 1, to its value, -1 to 1."""

LOWEST_HZ, HIGHEST_HZ = 0.01, 50.0


@dataclass(frozen=True, slots=True)
class PeriodicWave:
    """A periodic signal, which a bench adds to its target."""

    shape: str  # shape, a key of :data:`WAVE_SHAPES`
    amplitude: float  # amplitude, in the unit of the target; 0 or more
    frequency: float  # frequency, Hz, 0.01 to 50
    start_tick: int  # first tick of the first period

    duration_s: ClassVar[float] = math.inf

    def __post_init__(self) -> None:
        if self.shape not in WAVE_SHAPES:
            raise InputError(
                f"generator: no shape '{self.shape}'; take {', '.join(WAVE_SHAPES)}",
                code="unknown-shape",
                key="shape",
            )
        if not (math.isfinite(self.amplitude) and self.amplitude >= 0.0):
            raise InputError(
                "generator: the amplitude is not 0 or more", code="out-of-range", key="amplitude"
            )
        if not LOWEST_HZ <= self.frequency <= HIGHEST_HZ:
            raise InputError(
                f"generator: the frequency is not within {LOWEST_HZ:g} to {HIGHEST_HZ:g} Hz",
                code="out-of-range",
                key="frequency",
            )

    @property
    def range(self) -> tuple[float, float]:
        """Smallest and largest value of the signal, in the unit of the target."""
        return -self.amplitude, self.amplitude

    def value_at(self, tick: int, rate: float) -> float:
        """Return the value at a tick, in the unit of the target."""
        return self.amplitude * WAVE_SHAPES[self.shape](
            ((tick - self.start_tick) * self.frequency / rate) % 1.0
        )

    def as_dict(self) -> dict[str, float | str]:
        """Return the description that a page shows."""
        return {"shape": self.shape, "amplitude": self.amplitude, "frequency": self.frequency}


MAX_WAVE_DURATION_S = 3600.0
_MIN_TABLE_ROWS = 2


@dataclass(frozen=True, slots=True)
class Chirp:
    """A sine for the target; its frequency changes by constant octaves per second."""

    amplitude: float  # amplitude, in the unit of the target; 0 or more
    low: float  # frequencies at the start and at the end, Hz; 0.01 to 50, in any order
    high: float
    duration_s: float  # duration, s, up to 3600
    start_tick: int  # first tick of the chirp

    def __post_init__(self) -> None:
        if not (math.isfinite(self.amplitude) and self.amplitude >= 0.0):
            raise InputError("chirp: the amplitude is not 0 or more", code="out-of-range", key="amplitude")
        for value in (self.low, self.high):
            if not LOWEST_HZ <= value <= HIGHEST_HZ:
                raise InputError(
                    f"chirp: {value:g} Hz is not within {LOWEST_HZ:g} to {HIGHEST_HZ:g} Hz",
                    code="out-of-range",
                    key="frequency",
                )
        if not 1.0 / min(self.low, self.high) <= self.duration_s <= MAX_WAVE_DURATION_S:
            raise InputError(
                f"chirp: it lasts {self.duration_s:g} s; choose at least a period of its slowest sine, "
                f"{1.0 / min(self.low, self.high):g} s, and at most {MAX_WAVE_DURATION_S:g} s",
                code="out-of-range",
                key="lasts",
            )

    @property
    def range(self) -> tuple[float, float]:
        """Smallest and largest value of the signal, in the unit of the target."""
        return -self.amplitude, self.amplitude

    def value_at(self, tick: int, rate: float) -> float:
        """Return the value at a tick, in the unit of the target."""
        time = (tick - self.start_tick) / rate
        log_ratio = math.log(self.high / self.low) / self.duration_s
        cycles = time if log_ratio == 0.0 else math.expm1(time * log_ratio) / log_ratio
        return self.amplitude * math.sin(2.0 * math.pi * self.low * cycles)

    def as_dict(self) -> dict[str, float | str]:
        """Return the description that a page shows."""
        return {
            "shape": "chirp",
            "amplitude": self.amplitude,
            "low": self.low,
            "high": self.high,
            "lasts": self.duration_s,
        }


@dataclass(frozen=True, slots=True)
class WaveTable:
    """A table of values over time, added to the target with linear interpolation."""

    times: FloatArray  # time, s, ascending from 0; shape (n,)
    values: FloatArray  # value, in the unit of the target; shape (n,)
    start_tick: int  # first tick of the table

    @property
    def duration_s(self) -> float:
        """Time of the last row, s."""
        return float(self.times[-1])

    @property
    def range(self) -> tuple[float, float]:
        """Smallest and largest value of the signal, in the unit of the target."""
        return float(self.values.min()), float(self.values.max())

    def value_at(self, tick: int, rate: float) -> float:
        """Return the value at a tick, in the unit of the target."""
        return float(np.interp((tick - self.start_tick) / rate, self.times, self.values))

    def as_dict(self) -> dict[str, float | str]:
        """Return the description that a page shows."""
        return {"shape": "own CSV", "rows": float(len(self.times)), "lasts": self.duration_s}


Wave = PeriodicWave | Chirp | WaveTable
"""Any signal that a bench adds to its target."""


def read_wave_table(text: str, unit: str, begin: int) -> WaveTable:
    """Read a CSV of the user: a header with units such as ``t_s,gap_um``, then rows of two numbers."""
    lines = [
        (line_number, [cell.strip() for cell in line.split(",")])
        for line_number, line in enumerate(text.splitlines(), 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not lines:
        raise InputError("own CSV: is empty; begin it with a header such as t_s,gap_um", code="no-data")
    number, header_line = lines[0]
    units = _read_header_units(number, header_line, unit)
    rows: list[tuple[float, float]] = []
    for number, cells in lines[1:]:
        time, value = _read_row(number, cells, units)
        last_time = rows[-1][0] if rows else -1.0
        if time <= last_time:
            raise InputError(
                f"own CSV: line {number}: the time is not later than in the previous row",
                code="time-not-rising",
            )
        if not rows and time != 0.0:
            raise InputError(
                f"own CSV: line {number}: the time does not begin at 0", code="time-not-from-zero"
            )
        rows.append((time, value))
    if len(rows) < _MIN_TABLE_ROWS or rows[-1][0] > MAX_WAVE_DURATION_S:
        raise InputError(
            f"own CSV: {len(rows)} rows; at least {_MIN_TABLE_ROWS} and at most {MAX_WAVE_DURATION_S:g} s are needed",
            code="rows-out-of-range",
        )
    table = np.array(rows)
    return WaveTable(table[:, 0], table[:, 1], begin)


def _read_header_units(line_number: int, header_cells: list[str], unit: str) -> tuple[Unit, Unit]:
    """Return the units of the two columns."""
    units = [unit for unit in (parse_header(cell).unit for cell in header_cells) if unit is not None]
    if len(header_cells) == len(units) == 2:
        time, value = units
        if time.dimension == "time" and value.dimension == require_unit(unit).dimension:
            return time, value
    dimension = require_unit(unit).dimension
    example = "gap_um" if unit == "m" else "F_N"
    raise InputError(
        f"own CSV: line {line_number}: no header of a time and a {dimension} with their units, such as t_s,{example}",
        code="no-header",
    )


def _read_row(line_number: int, cells: list[str], units: tuple[Unit, Unit]) -> tuple[float, float]:
    if len(cells) != 2:
        raise InputError(f"own CSV: line {line_number}: {len(cells)} columns, not two", code="fields-missing")
    row_values = []
    for cell, unit in zip(cells, units, strict=True):
        try:
            value = unit.value_to_si(float(cell))
        except ValueError:
            raise InputError(
                f"own CSV: line {line_number}: '{cell[:40]}' is not a number", code="not-a-number"
            ) from None
        if not math.isfinite(value):
            raise InputError(f"own CSV: line {line_number}: '{cell[:40]}' is not finite", code="not-finite")
        row_values.append(value)
    return row_values[0], row_values[1]


_CHUNK_S = 0.001
"""Time from one update of the target by a generator to the next, s of the bench."""


class DrivenBench(Bench):
    """A bench that adds a generator to another bench, and stores the target and the load."""

    def __init__(self, bench: Bench, on_refusal: Callable[[str], None], log: Callable[[str], None]) -> None:
        self._bench = bench
        self._copy_attributes()
        self.commands, self.has_own_clock = bench.commands, bench.has_own_clock
        self.max_load = bench.max_load
        self.body = getattr(bench, "body", None)
        self.injection_port = bench.injection_port
        self.target = bench.demand_range.value
        self._on_refusal = on_refusal
        self._on_event = log
        self.load_N: float | None = None
        self.generator: Wave | None = None  # signal that the bench adds to the target

    def _copy_attributes(self) -> None:
        """Copy the attributes that a choice of signals changes."""
        bench = self._bench
        self.rate, self.ticks_per_row, self.signals = bench.rate, bench.ticks_per_row, bench.signals
        self.catalogue, self.demand_range = bench.catalogue, bench.demand_range
        self._chunk_ticks = max(1, round(_CHUNK_S * bench.rate))

    def search(self, text: str, max_count: int) -> list[Mapping[str, object]]:
        """Return descriptions of variables that can be chosen."""
        return self._bench.search(text, max_count)

    def choose(self, signals: Sequence[str], parameters: Sequence[str], event: int | None) -> None:
        """Choose other signals and parameters."""
        try:
            self._bench.choose(signals, parameters, event)
        finally:
            self._copy_attributes()

    @property
    def tick(self) -> int:
        """Number of the last tick."""
        return self._bench.tick

    def advance(self, ticks: int) -> FloatArray:
        """Advance the bench; an active generator changes the target every millisecond."""
        chunks, end_tick = [], self.tick + ticks
        while self.tick < end_tick:
            remaining_ticks = end_tick - self.tick
            if self.generator is not None:
                self._set_target(self.generator)
                remaining_ticks = min(remaining_ticks, self._chunk_ticks)
            chunks.append(self._bench.advance(remaining_ticks))
            for message in self._bench.take_messages():
                self.generator = None
                self.target = self._bench.demand_range.value
                self._on_event(message)
            self.loss_reason = self._bench.loss_reason
            if self.loss_reason or not len(chunks[-1]):
                break
        return np.concatenate(chunks)

    def _set_target(self, generator: Wave) -> None:
        try:
            if self.tick + 1 - generator.start_tick > generator.duration_s * self.rate:
                self.generate(None)
                self._on_refusal("it is over")
            else:
                self._bench.demand(self.target + generator.value_at(self.tick + 1, self.rate))
        except InputError as refused:
            self.generator = None
            self._on_refusal(str(refused))

    def generate(self, generator: Wave | None) -> None:
        """Start a generator, or stop it and return to the plain target."""
        if generator is not None:
            self._check_generator(self.target, generator)
        elif self.generator is None:
            return
        self._bench.demand(self.target)
        self.generator = generator

    def _check_generator(self, target: float, generator: Wave) -> None:
        demand, (lowest_value, highest_value) = self.demand_range, generator.range
        if not demand.low <= target + lowest_value <= target + highest_value <= demand.high:
            raise InputError(
                f"generator: {target + lowest_value:g} to {target + highest_value:g} {demand.unit} is not within "
                f"{demand.low:g} to {demand.high:g} {demand.unit}; set a target in between, or take less",
                code="out-of-range",
                key="generator",
            )

    def demand(self, value: float) -> None:
        """Set the target, m or N; an active generator still adds to the target."""
        if self.generator is not None:
            self._check_generator(value, self.generator)
        self._bench.demand(value)
        self.target = value

    def inject(self, signal: FloatArray) -> int:
        """Add a signal, m, to the position reading; return its first tick."""
        return self._bench.inject(signal)

    def load(self, force: float) -> None:
        """Set the force of the load drive, N."""
        self._bench.load(force)
        self.load_N = force

    def command(self, command: Command) -> None:
        """Send a command. STOP also ends the generator. RUN sets the target to 0."""
        if command is Command.STOP:
            self.generator = None
        self._bench.command(command)
        if command is Command.RUN:
            self.target = 0.0

    def parameters(self) -> tuple[Parameter, ...]:
        """Return all parameters that can be changed."""
        return self._bench.parameters()

    def apply(self, values: Mapping[str, float]) -> int:
        """Set parameters, all at the same tick; return the first tick that uses them."""
        return self._bench.apply(values)

    def close(self) -> None:
        """Close the rig."""
        self._bench.close()
