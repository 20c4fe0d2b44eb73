"""Store the signals of a run, detect loss of control, and compute statistics of deviations."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np

from anhyst._core import POSITION_MAGNETS
from anhyst.data.table import check_recording, write_recording
from anhyst.support.atomic import PathLike
from anhyst.support.numeric import FloatArray
from anhyst.support.states import Phase, State

LOST_TO_LARGEST_DEMAND = 10.0
"""Demand, relative to the largest demand of the rig file, above which control counts as lost."""


class SignalBound(NamedTuple):
    """Bounds of a signal, and the reason that is reported if the signal leaves them."""

    reason: str
    values: FloatArray
    low: float
    high: float


class Loss(NamedTuple):
    """First tick after control was lost, and the reason."""

    tick: int
    reason: str


CURRENT_SIGNALS = (("command", "A"), ("current", "A"))


def column_name(signal: str, unit: str, number: int = 1) -> str:
    """Return the name of a column. The number of the first magnet is omitted."""
    return "_".join(name_part for name_part in (signal, f"{number}" if number > 1 else "", unit) if name_part)


def magnet_columns(
    signals: Sequence[tuple[str, str]], first_magnet: int, last_magnet: int
) -> tuple[str, ...]:
    """Return the columns of the given signals, one magnet after another."""
    return tuple(
        column_name(*name, number) for number in range(first_magnet, last_magnet + 1) for name in signals
    )


COLUMNS: tuple[str, ...] = (
    *("t_s", "reference_m", "gap_m", "gap_read_m", "velocity_m_per_s", "demand_N", "force_N"),
    *("load_N", "command_A", "current_A", "current_read_A", "voltage_V", "flux_Wb"),
    *("flux_density_T", *magnet_columns(CURRENT_SIGNALS, 2, POSITION_MAGNETS), "state", "flags"),
)
"""Columns of a bearing's recording, with units in their names; docs/simulate.md describes them.
Columns of a second magnet are zero if there is none."""


def state_code(state: State, phase: Phase = Phase.REST) -> int:
    """Return the value of the column ``state`` for a state and a phase of the controller."""
    return 16 * state + phase


READY_CODE = state_code(State.READY)
RUN_CODE = state_code(State.RUN)
FAULT_CODE = state_code(State.FAULT)
"""Smallest value of the column ``state`` in each state. The phase is added to it."""

BREAKAWAY_CODE = state_code(State.RUN, Phase.BREAKAWAY)
RISE_CODE = state_code(State.RUN, Phase.RISE)
HOVER_CODE = state_code(State.RUN, Phase.HOVER)
DESCEND_CODE = state_code(State.RUN, Phase.DESCEND)
SET_DOWN_CODE = state_code(State.RUN, Phase.SET_DOWN)
"""Value of the column ``state`` in each phase of levitation."""


@dataclass(frozen=True)
class Recording:
    """Signals of a run with one value per tick."""

    # signals by column name, such as ``gap_m``; the time is first
    columns: Mapping[str, FloatArray]
    loss: Loss | None = None  # first loss of control, if the run was checked for one

    @classmethod
    def from_table(cls, table: FloatArray, names: Iterable[str] = COLUMNS) -> Self:
        """Create a recording from a table of shape (ticks, columns)."""
        return cls(dict(zip(names, table.T, strict=True)))

    @classmethod
    def concatenate(cls, runs: Sequence[Recording]) -> Self:
        """Concatenate recordings with the same columns."""
        return cls.from_table(np.concatenate([run.table for run in runs]), runs[0].columns)

    def __getitem__(self, header: str) -> FloatArray:
        return self.columns[header]

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))

    @property
    def table(self) -> FloatArray:
        """All columns, shape (ticks, columns)."""
        return np.column_stack(list(self.columns.values()))

    @property
    def dt(self) -> float:
        """Time between ticks, s."""
        time = self["t_s"]
        return float(time[1] - time[0])

    @property
    def current_runs(self) -> list[tuple[FloatArray, FloatArray]]:
        """Currents, A, and times, s, of each magnet."""
        return [
            (values, self["t_s"])
            for name, values in self.columns.items()
            if name.startswith("current_") and name.endswith("_A") and "read" not in name
        ]

    @property
    def loss_text(self) -> str:
        """Text with time and reason of the loss of control; empty if control was not lost."""
        loss = self.loss
        return "" if loss is None else f"at {self.dt * loss.tick:.4f} s, {loss.reason}"

    def select_columns(self, names: Iterable[str]) -> Recording:
        """Return the columns with the given names, in this order; missing columns are zero."""
        zero_column = np.zeros(len(self))
        return Recording({name: self.columns.get(name, zero_column) for name in names})

    def slice_ticks(self, begin: int, end: int) -> Recording:
        """Return the rows of ticks begin to end (exclusive)."""
        return Recording({name: values[begin:end] for name, values in self.columns.items()})

    def save(self, path: PathLike) -> Path:
        """Write the recording in the format of the file extension, either completely or not at all."""
        check_recording(path)
        write_recording(path, self.columns)
        return Path(path)


def peak_deviation(deviation: FloatArray) -> float:
    """Return the largest absolute value of a deviation."""
    return float(np.abs(deviation).max())


def moving_statistics(deviation: FloatArray, ticks: int) -> tuple[FloatArray, FloatArray]:
    """Return the mean and the standard deviation in every window of the given number of ticks."""
    running_sums = np.cumsum(np.concatenate([[0.0], deviation]))
    squared_sums = np.cumsum(np.concatenate([[0.0], deviation**2]))
    mean = (running_sums[ticks:] - running_sums[:-ticks]) / ticks
    mean_square = (squared_sums[ticks:] - squared_sums[:-ticks]) / ticks
    return mean, np.sqrt(np.maximum(mean_square - mean**2, 0.0))


def settling_tick(deviation: FloatArray, band: float) -> int:
    """Return the tick after which a deviation stays within a band; its length if it never does."""
    outside_ticks = np.flatnonzero(np.abs(deviation) > band)
    return int(outside_ticks[-1]) + 1 if outside_ticks.size else 0


def find_loss(bounds: Sequence[SignalBound], planned_ticks: int) -> Loss | None:
    """Return the first loss of control in a run of `planned_ticks` ticks, or None."""
    losses = []
    for bound in bounds:
        # NaN counts as outside
        is_within = (bound.values > bound.low) & (bound.values < bound.high)
        if not is_within.all():
            tick = int(np.argmin(is_within))
            is_finite = np.isfinite(bound.values[tick])
            losses.append(Loss(tick, bound.reason if is_finite else "a value was not finite"))
        if len(is_within) < planned_ticks:
            losses.append(Loss(len(is_within), "the simulation diverged"))
    return min(losses, key=lambda loss: loss.tick, default=None)
