"""Compare two models: different settings and parameters, and the difference of their loops."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from anhyst.data.output_map import full_scale
from anhyst.model.actuator import Model, resolve_model
from anhyst.model.parameters import Parameter
from anhyst.model.predict import slow_times
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError
from anhyst.support.result import Result, rows_to_columns

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from anhyst.model.schema import Range

DRIVES_PER_BRANCH = 200

Value = Parameter | str | None


@dataclass(frozen=True, slots=True)
class Change:
    """One setting or parameter that differs; SI."""

    name: str
    first: Value
    second: Value


@dataclass(frozen=True, slots=True)
class LoopDifference:
    """Difference of the steady-state loops at one value of the scheduling variable."""

    schedule: float | None  # scheduling variable, SI
    # largest absolute output of the first model at this value, in units of the output
    largest_output: float
    mean: float  # mean and largest absolute difference of the outputs
    worst: float
    at_drive: float  # drive at the largest difference, in units of the input


@dataclass(frozen=True, slots=True, repr=False)
class ModelDiff(Result):
    """Differences between two models.

    Parameters
    ----------
    settings : tuple of Change
        Law, gap map, nodes, history and valid ranges that differ.
    parameters : tuple of Change
        Parameters that differ.
    drive : tuple of two floats or None
        Range of the compared steady-state cycle, in units of the input, within both valid ranges.
        None if there is no such range.
    loops : tuple of LoopDifference
        At every node of either model and half-way between nodes, within both valid ranges.
    mean, worst : float or None
        Over all those loops, in units of the output.
    note : str
        Reason why no loops were compared, or empty.
    """

    settings: tuple[Change, ...]
    parameters: tuple[Change, ...]
    drive: Range | None
    loops: tuple[LoopDifference, ...]
    mean: float | None
    worst: float | None
    note: str = ""

    @property
    def same(self) -> bool:
        """Whether the models give the same results; their names and origins may differ."""
        return not self.settings and not self.parameters

    def facts(self) -> dict[str, str]:
        """Return the names of all differences, and the mean and largest difference of the loops."""
        facts = {"different": ", ".join(item.name for item in (*self.settings, *self.parameters))}
        if self.mean is not None and self.worst is not None:
            facts |= {"mean": f"{self.mean:.3g}", "worst": f"{self.worst:.3g} (SI)"}
        return {"same": "yes"} if self.same else facts

    def to_columns(self) -> dict[str, Any]:
        """Return the differences of the steady-state loops at each scheduling value, SI."""
        return rows_to_columns([asdict(loop) for loop in self.loops])

    def as_dict(self) -> dict[str, Any]:
        """Return everything as plain data, for JSON."""
        return {"same": self.same, **asdict(self)}

    def draw(self, ax: Axes) -> None:
        """Draw mean and largest difference of the steady-state loops over the scheduling variable."""
        schedules = [0.0 if loop.schedule is None else loop.schedule for loop in self.loops]
        ax.plot(schedules, [loop.worst for loop in self.loops], "o-", lw=1.1, label="largest difference")
        ax.plot(schedules, [loop.mean for loop in self.loops], "o-", lw=1.1, label="mean")
        ax.set_xlabel("scheduling variable, SI")
        ax.set_ylabel("difference of the outputs, SI")


def diff(first: Model | PathLike, second: Model | PathLike) -> ModelDiff:
    """Compare two models of the same kind: `anhyst.diff`."""
    first, second = resolve_model(first, "diff", "first"), resolve_model(second, "diff", "second")
    for quantity_role in ("input", "output"):
        first_quantity, second_quantity = getattr(first, quantity_role), getattr(second, quantity_role)
        if first_quantity != second_quantity:
            raise InputError(
                f"the models cannot be compared: the {quantity_role} of one is {first_quantity.column}, of the other "
                f"{second_quantity.column}",
                code="quantities-differ",
            )
    settings = _find_changes(_compared_settings(first), _compared_settings(second))
    parameters = _find_changes(first.parameters, second.parameters)
    try:
        drive = _common_range([model.valid.input for model in (first, second) if model.valid])
        gaps = _common_schedule(first, second)
    except InputError as error:
        return ModelDiff(settings, parameters, None, (), None, None, str(error))
    loops = tuple(_compare_loops(first, second, drive, gap) for gap in gaps)
    mean = float(np.mean([loop.mean for loop in loops]))
    return ModelDiff(settings, parameters, drive, loops, mean, max(loop.worst for loop in loops))


def _find_changes(
    first_values: Mapping[str, Value], second_values: Mapping[str, Value]
) -> tuple[Change, ...]:
    named_pairs = (
        (name, first_values.get(name), second_values.get(name)) for name in {**first_values, **second_values}
    )
    return tuple(
        Change(name, first_value, second_value)
        for name, first_value, second_value in named_pairs
        if first_value != second_value
    )


def _compared_settings(model: Model) -> dict[str, Value]:
    schedule, valid_range = model.schedule, model.valid
    return {
        "law": model.law,
        "cells": str(model.cells) if model.cells else None,
        "layers": str(model.layers) if model.layers else None,
        "eddy_circuit": str(model.eddy_circuit) if model.eddy_circuit else None,
        "gap_map": model.gap_map,
        "history": str(model.history),
        "schedule": schedule.column if schedule else None,
        "nodes": model.nodes,
        f"valid {model.input.symbol}": valid_range.input if valid_range else None,
        f"valid {model.output.symbol}": valid_range.output if valid_range else None,
        "valid schedule": valid_range.schedule if valid_range else None,
        f"valid rate of {model.input.symbol}": valid_range.input_rate if valid_range else None,
    }


def _common_range(ranges: list[Range]) -> Range:
    if not ranges:
        text = "neither model has a valid range of the input: no loops compared"
        raise InputError(text, code="no-valid-range", key="valid")
    low, high = max(low for low, _ in ranges), min(high for _, high in ranges)
    if not low < high:
        text = "the valid ranges of the input do not overlap: no loops compared"
        raise InputError(text, code="ranges-apart")
    return low, high


def _common_schedule(first_model: Model, second_model: Model) -> list[float | None]:
    """Return the nodes of both models and the midpoints between them, within both valid ranges."""
    if first_model.schedule != second_model.schedule and (
        first_model.needs_schedule or second_model.needs_schedule
    ):
        raise InputError("the scheduling variables differ: no loops compared", code="quantities-differ")
    nodes = np.unique([*first_model.nodes, *second_model.nodes])
    if not nodes.size:
        return [None]
    ranges = [
        model.valid.schedule for model in (first_model, second_model) if model.valid and model.valid.schedule
    ]
    limits = ranges or [
        (model.nodes[0], model.nodes[-1]) for model in (first_model, second_model) if model.nodes
    ]
    low, high = max(low for low, _ in limits), min(high for _, high in limits)
    common_nodes = nodes[(nodes >= low) & (nodes <= high)]
    if not common_nodes.size:
        text = "the valid ranges of the schedule do not overlap: no loops compared"
        raise InputError(text, code="ranges-apart")
    return sorted([*common_nodes.tolist(), *(0.5 * (common_nodes[1:] + common_nodes[:-1])).tolist()])


def _compare_loops(
    first_model: Model, second_model: Model, drive: Range, gap: float | None
) -> LoopDifference:
    ascending_drive = np.linspace(*drive, DRIVES_PER_BRANCH)
    cycle = np.concatenate([ascending_drive, ascending_drive[-2::-1]])
    times = slow_times(cycle.size)
    output, other_output = (
        model.predict(cycle, gap, times, "settled").output for model in (first_model, second_model)
    )
    differences = np.abs(output - other_output)
    largest_output, worst_drive = (
        full_scale(first_model.output, (output,)),
        float(cycle[int(np.argmax(differences))]),
    )
    return LoopDifference(
        gap, largest_output, float(differences.mean()), float(differences.max()), worst_drive
    )
