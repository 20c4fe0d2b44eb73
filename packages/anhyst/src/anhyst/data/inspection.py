"""Inspect measured loops: characteristic values, warnings, benefit of a hysteresis model, plots."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from anhyst.data import estimates
from anhyst.data.delay import estimate_delay
from anhyst.data.estimates import estimate_noise
from anhyst.data.holes import find_holes
from anhyst.data.initial_history import HistoryProposal, correct_histories_of_fast_loops, propose_histories
from anhyst.data.loops import Loop, Loops
from anhyst.data.output_map import name_full_scale
from anhyst.data.path import ANHYSTERETIC, History, find_branches
from anhyst.data.plausibility import check_plausible
from anhyst.data.recurrence import estimate_drift
from anhyst.data.speeds import describe_rate
from anhyst.data.symmetry import describe_bias, recentre_loops
from anhyst.data.verdict import (
    Verdict,
    assess_loops,
    largest_output,
    loop_width_and_height,
    single_valued_residuals,
)
from anhyst.support.numeric import FloatArray
from anhyst.support.result import (
    Result,
    length_scale,
    rows_to_columns,
    schedule_colours,
    style_axes,
    thinning_slice,
)
from anhyst.support.units import Quantity
from anhyst.support.wording import word_for_reader

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True)
class LoopFigures:
    """Characteristic values of one loop, SI units; ``None`` if a value cannot be determined."""

    label: str
    schedule: float | None
    samples: int
    cycles: float  # half the number of branches
    input_low: float
    input_high: float
    output_low: float
    output_high: float
    step: float | None  # median time step, s
    uneven: float | None  # largest relative deviation from the median time step
    input_offset: float | None  # input at the centre of a symmetric loop with an odd output
    output_offset: float | None  # output at the centre of a symmetric loop
    drift: float | None  # linear drift of the output over the record
    closure: float | None  # output at the end of the last full cycle minus output at its start
    noise: float  # standard deviation of the output noise
    skew: float | None  # delay of the output after the input, samples
    skew_s: float | None  # delay of the output, s; None without time
    # slope at the largest input relative to the largest slope: almost 0 in saturation
    saturation: float | None
    width: float  # largest distance of neighbouring branches in the input
    height: float  # largest distance of neighbouring branches in the output
    single_mean: float  # mean deviation from the best single-valued curve
    single_worst: float  # largest deviation from the best curve
    history: History  # history as stated or assumed
    proposed: History  # history as proposed from the record
    reason: str  # reason for the proposed history


@dataclass(frozen=True, slots=True, repr=False)
class Inspection(Result):
    """Results of `inspect` for a set of loops.

    Attributes
    ----------
    loops
        Figures of each loop, in the order of the set.
    schedule_values
        Distinct constant scheduling values, SI units, ascending.
    notes, repairs
        From reading and cleaning.
    warnings
        Unusual findings, one sentence each.
    verdict
        Whether a hysteresis model has a benefit.
    rate
        The rate from which loops change, as a sentence; empty if the loops of each gap have about
        the same speed.
    """

    input: Quantity
    output: Quantity
    schedule: Quantity | None
    schedule_values: tuple[float, ...]
    loops: tuple[LoopFigures, ...]
    notes: tuple[str, ...]
    repairs: tuple[str, ...]
    warnings: tuple[str, ...]
    verdict: Verdict
    rate: str = ""

    def as_dict(self) -> dict[str, Any]:
        """Return all results for JSON, with units in the keys (``width_A``, ``noise_N``, ...)."""
        units = self._unit_suffixes()
        return {
            "input": self.input.column,
            "output": self.output.column,
            "schedule": self.schedule.column if self.schedule else None,
            "schedule_values": list(self.schedule_values),
            "samples": sum(loop.samples for loop in self.loops),
            "loops": [_as_json_figures(loop, units) for loop in self.loops],
            "verdict": _as_json_figures(self.verdict, units) | {"worthwhile": self.verdict.worthwhile},
            "rate": self.rate,
            "warnings": list(self.warnings),
            "repairs": list(self.repairs),
            "notes": list(self.notes),
        }

    def facts(self) -> dict[str, str]:
        """Return the verdict and its main values."""
        verdict, drive, output = self.verdict, self.input, self.output
        return {
            "worth a hysteresis model": verdict.level,
            "loops": str(len(self.loops)),
            "width": f"{verdict.width:.3g} {drive.unit} ({100 * verdict.width_relative:.2g} %)",
            "best single-valued curve": f"{verdict.single_mean:.3g} {output.unit} mean, "
            f"{verdict.single_worst:.3g} {output.unit} worst",
            "noise": f"{verdict.noise_mean:.2g} {output.unit} mean",
            **({"rate": self.rate} if self.rate else {}),
        }

    def to_columns(self) -> dict[str, list[Any]]:
        """Return the characteristic values of each loop, with units in their names."""
        return rows_to_columns(self.as_dict()["loops"])

    def draw(self, ax: Axes) -> None:
        """Draw the error of the best single-valued curve for each loop, next to the noise."""
        scale, label = length_scale(self.output)
        positions = np.arange(len(self.loops))
        for offset, name, text in (
            (-0.27, "single_worst", "single-valued curve, worst"),
            (0.0, "single_mean", "single-valued curve, mean"),
            (0.27, "noise", "noise, rms"),
        ):
            heights = [scale * getattr(loop, name) for loop in self.loops]
            ax.bar(positions + offset, heights, 0.25, label=text)
        names = [loop.label for loop in self.loops]
        ax.set_xticks(positions, names, rotation=60.0, ha="right", fontsize="small")
        ax.set_xlabel("loop")
        ax.set_ylabel(label)

    def _unit_suffixes(self) -> dict[str, str]:
        """Return the unit suffix of each value that has a unit."""
        drive, output = _unit_suffix(self.input), _unit_suffix(self.output)
        units = dict.fromkeys(("input_low", "input_high", "input_offset", "width"), drive)
        names = ("output_low", "output_high", "output_offset", "drift", "closure", "noise",
                 "height", "single_mean", "single_worst", "noise_mean")  # fmt: skip
        units |= dict.fromkeys(names, output)
        units |= {"step": "s", "skew": "samples"}
        if self.schedule is not None:
            units["schedule"] = _unit_suffix(self.schedule)
        return units


def inspect(loops: Loops) -> Inspection:
    """Return values of loops, warnings, and the benefit of a hysteresis model: `anhyst.inspect`.

    Noise and delay are those of the given samples, so inspect a record before it is thinned.
    """
    warnings = list(check_plausible(loops))
    residuals = {id(loop): residual for loop, residual in single_valued_residuals(loops)}
    centred_loops, is_even = recentre_loops(loops)
    proposals = correct_histories_of_fast_loops(
        loops.loops, propose_histories(centred_loops.loops, is_even=is_even)
    )
    widths_and_heights = [loop_width_and_height(loop, is_even=is_even) for loop in centred_loops.loops]
    figures = tuple(
        _inspect_loop(loop, np.abs(residuals[id(loop)]), proposal, size, loops.output, is_even=is_even)
        for loop, proposal, size in zip(loops.loops, proposals, widths_and_heights, strict=True)
    )
    bias_text = describe_bias(loops)
    warnings += _find_warnings(loops, figures)
    return Inspection(
        loops.input,
        loops.output,
        loops.schedule,
        loops.schedule_values,
        figures,
        (*loops.notes, bias_text) if bias_text else loops.notes,
        loops.repairs,
        tuple(map(word_for_reader, warnings)),
        assess_loops(loops),
        describe_rate(loops),
    )


def _inspect_loop(
    loop: Loop,
    deviation: FloatArray,
    proposal: HistoryProposal,
    width_and_height: tuple[float, float],
    output: Quantity,
    *,
    is_even: bool,
) -> LoopFigures:
    proposed_history, reason = proposal
    loop_centre = None if is_even else estimates.estimate_offsets(loop)
    (step, step_deviation), delay = estimates.measure_sampling(loop), estimate_delay(loop)
    return LoopFigures(
        label=loop.label,
        schedule=loop.schedule_value,
        samples=loop.n,
        cycles=len(find_branches(loop.input)) / 2.0,
        input_low=float(loop.input.min()),
        input_high=float(loop.input.max()),
        output_low=float(loop.output.min()),
        output_high=float(loop.output.max()),
        step=step,
        uneven=step_deviation,
        input_offset=loop_centre[0] if loop_centre else None,
        output_offset=loop_centre[1] if loop_centre else None,
        drift=estimate_drift(loop, output),
        closure=estimates.closure_error(loop),
        noise=estimate_noise(loop.output),
        skew=delay,
        skew_s=delay * step if delay is not None and step else None,
        saturation=estimates.slope_ratio_at_tip(loop),
        width=width_and_height[0],
        height=width_and_height[1],
        single_mean=float(deviation.mean()),
        single_worst=float(deviation.max()),
        history=loop.history,
        proposed=proposed_history,
        reason=reason,
    )


def _find_warnings(loopset: Loops, figures: tuple[LoopFigures, ...]) -> list[str]:
    warnings = []
    for loop, figure in zip(loopset.loops, figures, strict=True):
        name = loopset.describe(loop)
        height = figure.output_high - figure.output_low
        if figure.skew is not None and abs(figure.skew) >= 0.3:
            seconds = f"{figure.skew_s:.3g} s, " if figure.skew_s else ""
            warnings.append(
                f"{name}: the output lags by {seconds}{figure.skew:.4g} samples (if the "
                "measurement causes it, and not the device, use cleaning step 'skew')"
            )
        warnings += [f"{name}: {hole}; the history after it is unknown" for hole in find_holes(loop.time)]
        if figure.drift is not None and abs(figure.drift) > max(0.005 * height, 4.0 * figure.noise):
            warnings.append(
                f"{name}: the output drifts by {figure.drift / height:.1%} of its height over the "
                "record (cleaning step 'drift' removes it)"
            )
        if figure.samples < 40 and figure.history != ANHYSTERETIC:
            warnings.append(f"{name}: only {figure.samples} samples; 100 per loop are recommended")
        if figure.history.kind == "settled" and figure.proposed.kind == "demagnetised":
            warnings.append(f"{name}: stated as settled, but {figure.reason}")
    if loopset.schedule is not None and len(loopset.schedule_values) == 1:
        warnings.append(f"only one {loopset.schedule.name}: the dependence on it cannot be identified")
    return warnings


def _unit_suffix(quantity: Quantity) -> str:
    return quantity.column.removeprefix(quantity.symbol).lstrip("_")


def _as_json_figures(figures: LoopFigures | Verdict, units: dict[str, str]) -> dict[str, Any]:
    """Return the values for JSON, with units in the keys."""
    values: dict[str, Any] = {}
    for field in fields(figures):
        value, unit = getattr(figures, field.name), units.get(field.name)
        if isinstance(value, History | tuple):
            value = str(value) if isinstance(value, History) else list(value)
        values[f"{field.name}_{unit}" if unit else field.name] = value
    return values


def plot_inspection(inspection: Inspection, loopset: Loops) -> Figure:
    """Draw the loops, the residuals of the best single-valued curve, and the verdict."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 5.4), layout="constrained")
    grid = figure.add_gridspec(2, 2, height_ratios=(1.0, 0.24))
    loop_axes, residual_axes = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[0, 1])
    text_axes = figure.add_subplot(grid[1, :])
    loopset.plot(loop_axes)
    loop_axes.set_title("measured", loc="left", fontsize="medium")
    has_moving_schedule = any(loop.schedule_value is None for loop in loopset.loops)
    colours = schedule_colours(loopset.schedule_values, has_moving=has_moving_schedule)
    reference = largest_output(loopset)
    for loop, residual in single_valued_residuals(loopset):
        shown_rows = thinning_slice(loop.n)
        percent = 100.0 * residual[shown_rows] / reference
        residual_axes.plot(loop.input[shown_rows], percent, color=colours[loop.schedule_value], lw=0.9)
    noise = 100.0 * inspection.verdict.noise_relative
    residual_axes.axhspan(-noise, noise, color="0.6", alpha=0.5, lw=0, label="noise (mean)")
    residual_axes.set_xlabel(loopset.input.label)
    residual_axes.set_ylabel(f"% of {name_full_scale(loopset.output)}")
    residual_axes.set_title("residuals of the best single-valued curve", loc="left", fontsize="medium")
    residual_axes.legend(frameon=False, fontsize="small")
    style_axes(residual_axes)
    text_axes.set_axis_off()
    text = "\n".join(inspection.verdict.sentences)
    text_axes.text(0.0, 1.0, text, va="top", fontsize="medium", linespacing=1.5)
    return figure
