"""Measured loops: input, output, scheduling variable and history, in SI units and immutable."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from anhyst.data.formats.channels import Texts
from anhyst.data.formats.text import Column, write_csv
from anhyst.data.output_map import output_map
from anhyst.data.path import (
    ANHYSTERETIC,
    SETTLED,
    History,
    HistoryLike,
    are_measured,
    correlation,
    find_time_reversal,
    is_bipolar,
    is_negative,
    reversal_count,
)
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst.support.result import (
    MAX_ROWS,
    Result,
    group_label,
    html_table,
    length_scale,
    range_text,
    schedule_colours,
    thinning_slice,
)
from anhyst.support.units import GAP_ADVICE, QUANTITIES, Quantity
from anhyst.support.wording import count_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, eq=False)
class Loop:
    """One loop: a record of input and output, in SI units.

    Parameters
    ----------
    label
        Identifies the loop; unique together with the scheduling value.
    input, output
        Shape (n,), n >= 3, finite; stored as read-only float64.
    schedule
        The scheduling variable (gap, temperature, ...) at each sample, or ``None``.
    time
        Time of each sample, s, not decreasing, or ``None`` if not recorded.
    history
        The history before the first sample.
    source
        File of the loop, for messages; empty if there is none.

    Raises
    ------
    InputError
        If arrays differ in length, are too short or contain values that cannot be measured, if the
        input is constant, or if time decreases or is constant.
    """

    label: str
    input: FloatArray
    output: FloatArray
    schedule: FloatArray | None = None
    time: FloatArray | None = None
    history: History = SETTLED
    source: str = ""

    def __post_init__(self) -> None:
        for name in ("input", "output", "schedule", "time"):
            values = getattr(self, name)
            if values is not None:
                object.__setattr__(self, name, self._check_column(name, values))
        if np.ptp(self.input) == 0.0:
            raise InputError(
                f"loop '{self.label}': the input is constant ({self.input[0]:g}); a loop needs an "
                "input that increases and decreases",
                code="input-constant",
                key=self.label,
            )
        if self.time is not None and (fault_row := find_time_reversal(self.time)) is not None:
            raise InputError(
                f"loop '{self.label}': time goes backwards at sample {fault_row + 1}; sort the samples "
                "or distinguish the loops by a column 'loop'",
                code="time-backwards",
                key=self.label,
            )
        if self.time is not None and self.time[0] == self.time[-1]:
            raise InputError(
                f"loop '{self.label}': time is constant at {self.time[0]:g} s; correct it or "
                'leave the column out, such as --columns "t_s="',
                code="time-stands-still",
                key=self.label,
            )

    def _check_column(self, name: str, values: FloatArray) -> FloatArray:
        column = np.asarray(values, dtype=np.float64)
        if column.ndim != 1 or column.size != np.size(self.input):
            raise InputError(
                f"loop '{self.label}': {name} must have one value per sample", code="length-differs", key=name
            )
        if column.size < 3:
            raise InputError(
                f"loop '{self.label}': has {count_text(column.size, 'sample')}; a loop needs at least 3",
                code="too-few-samples",
                key=self.label,
            )
        is_measured = are_measured(column)
        if not is_measured.all():
            bad_row = int(np.argmin(is_measured))
            raise InputError(
                f"loop '{self.label}': {name} is {column[bad_row]:g} at sample {bad_row + 1}, which is not a "
                "measured value; remove the sample",
                code="not-finite",
                key=name,
            )
        if column.flags.writeable or not column.flags.c_contiguous:
            column = column.copy()
            column.flags.writeable = False
        return column

    @property
    def n(self) -> int:
        """Number of samples."""
        return self.input.size

    @property
    def schedule_value(self) -> float | None:
        """The scheduling value if the loop has one and it is constant, otherwise ``None``."""
        if self.schedule is None or np.ptp(self.schedule) != 0.0:
            return None
        return float(self.schedule[0])

    @property
    def reversals(self) -> int:
        """Number of reversals of the input above 2 % of its range."""
        return reversal_count(self.input)

    @property
    def reverses(self) -> bool:
        """Whether the input reverses; a record without a reversal does not show hysteresis."""
        return self.reversals > 0


@dataclass(frozen=True, slots=True)
class Source:
    """Origin of loops: the file, the SHA-256 of its content, and the mapping of its columns."""

    path: str
    sha256: str
    columns: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False, repr=False)
class Loops(Result):
    """Loops of one device, with one input and one output quantity.

    ``notes`` state what was found during reading (comments of the file, unused columns, proposed
    histories). ``repairs`` state the changes by cleaning steps.

    Raises
    ------
    InputError
        If there are no loops, only some have a scheduling value, two have equal label and scheduling
        value, or a gap is negative.
    """

    loops: tuple[Loop, ...]
    input: Quantity
    output: Quantity
    schedule: Quantity | None = None
    sources: tuple[Source, ...] = ()
    notes: tuple[str, ...] = ()
    repairs: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not self.loops:
            raise InputError("no loops: nothing to work with", code="no-loops")
        used_keys: set[tuple[str, float | None]] = set()
        for loop in self.loops:
            if (loop.schedule is None) != (self.schedule is None):
                schedule_name = self.schedule.name if self.schedule else "scheduling value"
                raise InputError(
                    f"loop '{loop.label}': has a {schedule_name} and other loops do not, or the reverse",
                    code="quantities-differ",
                    key=loop.label,
                )
            is_gap = loop.schedule is not None and self.schedule == QUANTITIES["gap"]
            if is_gap and (min_gap := float(np.min(loop.schedule))) < 0.0:  # type: ignore[arg-type]
                raise InputError(
                    f"loop '{loop.label}': negative gap {min_gap:g} m; {GAP_ADVICE}",
                    code="negative-gap",
                    key=loop.label,
                )
            key = (loop.label, loop.schedule_value)
            if key in used_keys and (loop.schedule is None or key[1] is not None):
                raise InputError(
                    f"two loops are both called '{self.describe(loop)}'; rename one",
                    code="loop-twice",
                    key=loop.label,
                )
            used_keys.add(key)

    def __len__(self) -> int:
        return len(self.loops)

    def __iter__(self) -> Iterator[Loop]:
        return iter(self.loops)

    def __getitem__(self, index: int | str) -> Loop:
        """Return a loop by its index or its label."""
        if not isinstance(index, str):
            return self.loops[index]
        matches = [loop for loop in self.loops if loop.label == index]
        if len(matches) == 1:
            return matches[0]
        label_list = ", ".join(repr(label) for label in dict.fromkeys(self.labels))
        text = f"no loop '{index}'; there are: {label_list}"
        if matches:
            schedule_name = self.schedule.name if self.schedule else "scheduling value"
            text = f"{len(matches)} loops are called '{index}'; select one {schedule_name} first: at(value)"
        raise InputError(text, code="no-such-loop", key=index)

    @property
    def labels(self) -> tuple[str, ...]:
        """The labels of the loops, in their order."""
        return tuple(loop.label for loop in self.loops)

    @property
    def schedule_values(self) -> tuple[float, ...]:
        """The distinct constant scheduling values, ascending; empty without a schedule."""
        values = {loop.schedule_value for loop in self.loops}
        return tuple(sorted(value for value in values if value is not None))

    def by_schedule(self) -> dict[float, list[Loop]]:
        """Return the loops by scheduling value, ascending; all with key 0.0 without a schedule.

        Raises
        ------
        InputError
            If the scheduling variable changes during a loop.
        """
        if self.schedule is None:
            return {0.0: list(self.loops)}
        for loop in self.loops:
            if loop.schedule_value is None:
                raise InputError(
                    f"loop '{loop.label}': the {self.schedule.name} changes during the loop; loops "
                    "at constant values are required (cleaning step 'steady' removes small changes)",
                    code="schedule-moves",
                    key=self.schedule.name,
                )
        return {
            value: [loop for loop in self.loops if loop.schedule_value == value]
            for value in self.schedule_values
        }

    def at(self, values: float | Iterable[float]) -> Loops:
        """Return the loops at the given scheduling values (to 1e-9 of the largest).

        Raises
        ------
        InputError
            If there is no loop at a value.
        """
        requested_values = [values] if isinstance(values, int | float) else list(values)
        scale = max((abs(value) for value in self.schedule_values), default=0.0)
        selected_values: set[float] = set()
        for value in requested_values:
            matching_values = {
                known_value
                for known_value in self.schedule_values
                if abs(known_value - value) <= 1e-9 * scale
            }
            if not matching_values:
                value_list = ", ".join(f"{v:g}" for v in self.schedule_values) or "none"
                raise InputError(f"no loop at {value:g}; there are: {value_list}", code="no-such-loop")
            selected_values |= matching_values
        loops = tuple(loop for loop in self.loops if loop.schedule_value in selected_values)
        return replace(self, loops=loops)

    def without(self, value: float) -> Loops:
        """Return all loops except those at one scheduling value.

        Raises
        ------
        InputError
            If there is no loop at that value, or no loop remains.
        """
        removed_ids = {id(loop) for loop in self.at(value).loops}
        return replace(self, loops=tuple(loop for loop in self.loops if id(loop) not in removed_ids))

    def with_loops(self, loops: Iterable[Loop], repair: str | None = None) -> Loops:
        """Return the same set with other loops, and add the repair that changed them."""
        repairs = self.repairs if repair is None else (*self.repairs, repair)
        return replace(self, loops=tuple(loops), repairs=repairs)

    def with_history(self, history: HistoryLike) -> Loops:
        """Return the same set with the given history for every loop."""
        common_history = History.of(history)
        return self.with_loops(replace(loop, history=common_history) for loop in self.loops)

    def require_reversals(self) -> None:
        """Raise an error for loops without a reversal, which identification cannot use.

        Raises
        ------
        InputError
            With the first such loop.
        """
        for loop in self.loops:
            if not loop.reverses:
                raise InputError(
                    f"{self.describe(loop)}: the {self.input.name} never reverses, so there is no "
                    "hysteresis in the record; record at least one ascending and one descending branch",
                    code="no-reversal",
                )

    def split_tables(self) -> tuple[Loops | None, Loops | None]:
        """Return the single-valued loops without hysteresis, and the other loops. None replaces an empty set."""
        is_table = [loop.history == ANHYSTERETIC for loop in self.loops]
        parts = [[loop for loop, flag in zip(self.loops, is_table, strict=True) if flag is kind]
                 for kind in (True, False)]  # fmt: skip
        tables, measured = (self.with_loops(loops) if loops else None for loops in parts)
        return tables, measured

    def with_return_branches(self) -> Loops:
        """Return the set with a descending branch in each single-valued loop, equal to the ascending one.

        A fit to both branches finds a model without hysteresis.
        """

        def append_return(loop: Loop) -> Loop:
            rows = np.concatenate([np.arange(loop.n), np.arange(loop.n - 1)[::-1]])
            schedule = None if loop.schedule is None else loop.schedule[rows]
            return replace(loop, input=loop.input[rows], output=loop.output[rows], schedule=schedule)

        return self.with_loops(
            append_return(loop) if loop.history == ANHYSTERETIC and not loop.reverses else loop
            for loop in self.loops
        )

    def describe(self, loop: Loop) -> str:
        """Return the name of a loop for a message: its file, its label and its scheduling value."""
        file_text = f"{loop.source}: " if loop.source else ""
        value = loop.schedule_value
        if self.schedule is None or value is None:
            return f"{file_text}loop '{loop.label}'"
        return f"{file_text}loop '{loop.label}' at {self.schedule.show(value)}"

    def to_columns(self) -> dict[str, Column]:
        """Return all loops one after the other, as columns of SI values by header."""
        codes = np.concatenate([np.full(loop.n, n, np.int32) for n, loop in enumerate(self.loops)])
        columns: dict[str, Column] = {"loop": Texts(tuple(any_loop.label for any_loop in self.loops), codes)}
        times = [loop.time for loop in self.loops if loop.time is not None]
        if len(times) == len(self.loops):
            columns[QUANTITIES["time"].column] = np.concatenate(times)
        columns[self.input.column] = np.concatenate([loop.input for loop in self.loops])
        columns[self.output.column] = np.concatenate([loop.output for loop in self.loops])
        values = [loop.schedule for loop in self.loops if loop.schedule is not None]
        if self.schedule is not None:
            columns[self.schedule.column] = np.concatenate(values)
        return columns

    def facts(self) -> dict[str, str]:
        """Return the numbers of loops and samples, the ranges, and the scheduling values."""
        drive = [end for loop in self.loops for end in (loop.input.min(), loop.input.max())]
        output = [end for loop in self.loops for end in (loop.output.min(), loop.output.max())]
        facts = {
            "loops": str(len(self)),
            "samples": str(sum(loop.n for loop in self.loops)),
            self.input.name: range_text(min(drive), max(drive), self.input.unit),
            self.output.name: range_text(min(output), max(output), self.output.unit),
        }
        if self.schedule is not None:
            values = self.schedule_values
            facts["measured at"] = ", ".join(map(self.schedule.show, values)) or "moving"
        return facts

    def _repr_html_(self) -> str:
        """Return the facts and one row for each loop, for a notebook."""
        headings = ["loop", *([self.schedule.name] if self.schedule else []), "samples"]
        headings += [self.input.label, self.output.label, "history"]
        rows = []
        for loop in self.loops[:MAX_ROWS]:
            value = loop.schedule_value
            schedule_fields = [] if self.schedule is None else ["moves" if value is None else f"{value:g}"]
            ranges = (f"{np.min(signal):.4g} to {np.max(signal):.4g}" for signal in (loop.input, loop.output))
            rows.append([loop.label, *schedule_fields, str(loop.n), *ranges, loop.history.kind])
        hidden_count = len(self) - len(rows)
        rows += [[f"and {count_text(hidden_count, 'more loop')}"]] if hidden_count else []
        return super()._repr_html_() + html_table(headings, rows)

    def draw(self, ax: Axes) -> None:
        """Draw all loops, output over input, with one colour for each scheduling value."""
        scale, axis_text = length_scale(self.output)
        has_moving_schedule = any(loop.schedule_value is None for loop in self.loops)
        for group, colour in schedule_colours(self.schedule_values, has_moving=has_moving_schedule).items():
            name = group_label(self.schedule, group)
            for loop in self.loops:
                if loop.schedule_value == group:
                    shown_rows = thinning_slice(loop.n)
                    output = loop.output[shown_rows] * scale
                    ax.plot(loop.input[shown_rows], output, color=colour, lw=1.1, label=name)
                    name = None  # one legend entry for each value
        ax.set_xlabel(self.input.label)
        ax.set_ylabel(axis_text)

    def save(self, path: PathLike) -> Path:
        """Write all loops to one CSV file, SI units, full precision; no partial file is left.

        Histories are not written; state them again to read the file.

        Raises
        ------
        InputError
            If the file cannot be written.
        """
        write_csv(path, self.to_columns())
        return Path(path)


def replace_columns(loop: Loop, convert: Callable[[FloatArray], FloatArray], **other_changes: Any) -> Loop:
    """Return a loop with the same change to all columns, except the columns that are given."""
    columns = {name: getattr(loop, name) for name in ("input", "output", "schedule", "time")}
    changed_columns = {
        name: convert(values)
        for name, values in columns.items()
        if values is not None and name not in other_changes
    }
    return replace(loop, **changed_columns | other_changes)


def is_even(loopset: Loops) -> bool:
    """Whether the output is independent of the sign of the input, as a force usually is.

    False for a magnet with a bias (permanent magnet or second coil), whose force follows the sign.
    """
    return are_even(loopset.loops, loopset.output)


def are_even(loops: Sequence[Loop], output: Quantity) -> bool:
    """Whether an output is independent of the sign of the input, as in `is_even`."""
    if not output_map(output).is_even:
        return False
    bipolar_loops = [loop for loop in loops if is_bipolar(loop.input)]
    return all(abs(correlation(loop.input, loop.output)) < 0.5 for loop in bipolar_loops)


def fold_input(loop: Loop, *, is_even: bool) -> tuple[FloatArray, FloatArray]:
    """Return input and output of a loop, with the magnitude of the input for an even output."""
    if is_even and is_bipolar(loop.input):
        return np.abs(loop.input), loop.output
    if is_even and is_negative(loop.input):
        return -loop.input, loop.output
    return loop.input, loop.output
