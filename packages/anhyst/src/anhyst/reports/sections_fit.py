"""Sections of the report about the measurement: loops, residuals, and how the file was read."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from anhyst.data.inspection import Inspection, LoopFigures
from anhyst.data.loops import Loop
from anhyst.data.speeds import group_by_speed
from anhyst.model.actuator import Model
from anhyst.model.dynamics import GAMMA_NAME
from anhyst.model.schema import LoopFit
from anhyst.reports import figures
from anhyst.reports.subject import Measurements, ModelSubject
from anhyst.support.numeric import FloatArray, rms
from anhyst.support.page import (
    NBSP,
    UNKNOWN_TEXT,
    Block,
    Cell,
    Items,
    PageTable,
    Picture,
    Scale,
    Section,
    Text,
    format_number,
    format_percent,
    make_table,
    quantity_scale,
    schedule_text,
    typeset,
)


def picture_of_loops(subject: ModelSubject) -> Picture | None:
    """Return the picture of the measured and the modelled loops."""
    measurements = subject.measurements
    if measurements is None:
        return None
    panels, deviation_text = _panels_text(subject, measurements), ""
    if subject.fit is not None:
        worst_text = subject.deviation_scale.format_with_unit(subject.fit.worst)
        deviation_text = f"The lines lie within {worst_text} of the points."
    return subject.picture(
        figures.figure_loops(measurements.loops, measurements.fitted),
        f"{subject.output_name} over {subject.input_name}, {panels}: measured samples as grey points, "
        f"the modelled loops as blue lines. {deviation_text}",
        f"Measured samples (points) and model (line), {panels}." + _omitted_panels_text(measurements),
    )


def section_loops(subject: ModelSubject) -> Section | None:
    """Return the section with the hysteresis of the loops, and with the small loops."""
    measurements = subject.measurements
    if measurements is None:
        return None
    panels = _panels_text(subject, measurements)
    blocks: list[Block] = [
        subject.picture(
            figures.figure_differences(measurements.loops, measurements.fitted, measurements.baseline),
            f"Loops minus the best single-valued curve, {panels}: only hysteresis remains, "
            "measured as grey points, modelled as blue lines.",
            "Loops minus the best single-valued curve (one curve for each panel): only hysteresis "
            "remains. A curve without hysteresis would be the zero line.",
        )
    ]
    small_loops_figure = figures.figure_small_loops(measurements.loops, measurements.fitted)
    if small_loops_figure is not None:
        count = len(figures.find_small_loops(measurements.loops))
        blocks.append(
            subject.picture(
                small_loops_figure,
                f"The {count} smallest loops, each in a panel of its own scale: measured samples "
                "as grey points, the model as blue lines.",
                "Small loops, which are not visible in the first picture, each in its own scale.",
            )
        )
    return Section("loops", "Hysteresis of the loops", tuple(blocks))


VISIBLE_HEIGHT_SHARE = 0.01
"""Increase of the loop height, as a fraction of the output range, above which the effect of the
rate is reported."""

_CYCLE_SAMPLES = 200
_SPEED_RATIOS = np.geomspace(1e-3, 1.5, 40)
"""Trial frequencies of the search for the corner, relative to the fastest measured loops."""


def section_rate(subject: ModelSubject) -> Section | None:
    """Return the section about loops of several speeds, and the speed above which loops change."""
    measurements = subject.measurements
    speeds = None if measurements is None else group_by_speed(measurements.loops)
    if measurements is None or speeds is None:
        return None
    groups = [list(speeds.slow.loops), *map(list, speeds.fast)]
    blocks: list[Block] = []
    if reason := str(subject.model.provenance.settings.get("rate", "")):
        blocks.append(Text(f"{reason[0].upper()}{reason[1:]}."))
    if subject.model.has_eddy_currents:
        blocks.append(Text(_corner_text(subject.model)))
    rows = [_speed_row(subject, measurements, group) for group in groups]
    scale = subject.deviation_scale
    head = ["speed", "loops", scale.heading("rms"), "of largest", scale.heading("worst"), "of largest"]
    blocks += [
        subject.picture(
            figures.figure_speeds(measurements.loops, measurements.fitted, speeds),
            f"{subject.output_name} over {subject.input_name}, one panel for each speed: measured samples as "
            "grey points, the modelled loops as blue lines.",
            "Measured samples (points) and model (line) at each speed, the slow loops first.",
        ),
        make_table(
            "Errors by speed", head, rows, f"“Of largest”: in % of {subject.full_scale_text} of all loops."
        ),
    ]
    return Section("rate", "Rate dependence", tuple(blocks))


def _speed_row(subject: ModelSubject, measurements: Measurements, group: Sequence[Loop]) -> list[Cell]:
    loop_ids, scale = {id(loop) for loop in group}, subject.deviation_scale
    loops_and_outputs = zip(measurements.loops.loops, measurements.fitted, strict=True)
    residuals = [
        output - loop.output
        for loop, output in loops_and_outputs
        if output is not None and id(loop) in loop_ids
    ]
    cells = [Cell(figures.speed_text(group)), Cell(str(len(group)))]
    if not residuals:
        return [*cells, *[Cell("")] * 4]
    all_residuals = np.concatenate(residuals)
    for error in (rms(all_residuals), float(np.abs(all_residuals).max())):
        cells += [Cell(scale.format(error)), Cell(subject.percent_of_largest(error))]
    return cells


def _corner_text(model: Model) -> str:
    """Return a sentence about the frequency above which eddy currents widen the modelled loops."""
    layers_text = f"cut into {model.layers.count} layers" if model.layers else "one layer, a lag of the flux"
    if model.eddy_circuit is not None:
        layers_text = f"one layer with an eddy circuit ({model.eddy_circuit})"
    corner, uncertainty, share = (rate_corner(model), model.uncertainty, format_percent(VISIBLE_HEIGHT_SHARE))
    if corner is None:
        return (
            f"The iron is {layers_text}. Up to the frequency of the fastest loops, the opening of the modelled "
            f"loops increases by less than {share} of the output range."
        )
    text = (
        f"The iron is {layers_text}. Above {corner:.3g}{NBSP}Hz, eddy currents increase the opening of the "
        f"modelled loops by more than {share} of the range of the {model.output.words}"
    )
    if uncertainty is None or GAMMA_NAME not in uncertainty.names:
        return f"{text}."
    index = uncertainty.names.index(GAMMA_NAME)
    factor = math.exp(2.0 * uncertainty.std[index] / uncertainty.values[index])
    interval = f"{corner / factor:.3g} to {corner * factor:.3g}{NBSP}Hz"
    return f"{text} ({interval}: two standard deviations of gamma)."


def rate_corner(model: Model) -> float | None:
    """Return the cycle frequency at which eddy currents visibly widen the loops, Hz.

    The loops then open by :data:`VISIBLE_HEIGHT_SHARE` more than slow loops do.

    The cycles are full cycles at the first node. Time enters a model only as gamma times a rate.
    Therefore, the corner frequency is inversely proportional to gamma.
    """
    if model.valid is None or model.dynamics is None or not model.dynamics.fastest:
        return None
    low, high = model.valid.input
    cycle_shape = 1.0 - np.abs(np.linspace(-1.0, 1.0, _CYCLE_SAMPLES, endpoint=False))
    drive, node = low + (high - low) * cycle_shape, model.first_node
    rates, relative_heights = model.dynamics.fastest * _SPEED_RATIOS, []
    for rate in rates.tolist():
        time = np.arange(_CYCLE_SAMPLES) / (_CYCLE_SAMPLES * rate)
        output = model.predict(drive, node, time, "settled").output
        descending_output = np.append(output[_CYCLE_SAMPLES // 2 :], output[0])[::-1]
        relative_heights.append(
            float(np.max(descending_output - output[: _CYCLE_SAMPLES // 2 + 1])) / float(np.ptp(output))
        )
    height_increase = np.array(relative_heights) - relative_heights[0]
    visible_indices = np.flatnonzero(height_increase >= VISIBLE_HEIGHT_SHARE)
    if not visible_indices.size:
        return None
    first_visible = int(visible_indices[0])
    bracket_increases, bracket_logs = (
        height_increase[first_visible - 1 : first_visible + 1],
        np.log(rates[first_visible - 1 : first_visible + 1]),
    )
    return float(np.exp(np.interp(VISIBLE_HEIGHT_SHARE, bracket_increases, bracket_logs)))


def _panels_text(subject: ModelSubject, measurements: Measurements) -> str:
    if measurements.loops.schedule is None or len(figures.group_by_schedule(measurements.loops)) == 1:
        return "all loops in one panel"
    return f"one panel for each {subject.schedule_name}"


def _omitted_panels_text(measurements: Measurements) -> str:
    groups = len(figures.group_by_schedule(measurements.loops))
    return f" {figures.MAX_PANELS} of {groups} panels are shown." if groups > figures.MAX_PANELS else ""


def section_residuals(subject: ModelSubject) -> Section | None:
    """Return the section about residuals: a figure, and tables by scheduling value and by loop."""
    blocks: list[Block] = []
    measurements = subject.measurements
    if measurements is not None and any(output is not None for output in measurements.fitted):
        index = _worst_point_text(subject, measurements)
        noise_text = subject.deviation_scale.format_with_unit(measurements.verdict.noise_mean)
        figure = figures.figure_residuals(measurements.loops, measurements.fitted)
        panels = _panels_text(subject, measurements)
        alt = (
            f"Modelled minus measured {subject.output_name} over {subject.input_name}, {panels}; samples on "
            f"rising branches blue, on falling branches orange, noise as a grey band. {index}"
        )
        caption = (
            f"Residual: model minus measurement. The grey band contains {format_percent(0.95)} of the noise of the "
            f"{subject.output_name} (mean magnitude {noise_text}); residuals outside it are not noise."
        )
        if subject.fit is not None and subject.fit.left_over:
            residual_text = subject.fit.left_over
            caption += f" {residual_text[0].upper()}{residual_text[1:]}."
        blocks += [Text(index), subject.picture(figure, alt, caption + _omitted_panels_text(measurements))]
        blocks += _group_table(subject, measurements)
    if subject.fit is not None and subject.fit.loops:
        blocks.append(_loop_table(subject, subject.fit.loops))
    return Section("residuals", "Residuals", tuple(blocks)) if blocks else None


def _worst_point_text(subject: ModelSubject, measurements: Measurements) -> str:
    """Return a sentence about the largest deviation of the model."""
    worst_point: tuple[float, int, int] = (-1.0, 0, 0)
    loops_and_outputs = zip(measurements.loops.loops, measurements.fitted, strict=True)
    for index, (loop, output) in enumerate(loops_and_outputs):
        if output is None:
            continue
        residual = np.abs(output - loop.output)
        worst_point = max(worst_point, (float(residual.max()), index, int(np.argmax(residual))))
    deviation, index, sample = worst_point
    loop = measurements.loops.loops[index]
    branch = "rising" if figures.mask_rising_samples(loop)[sample] else "falling"
    schedule_value = loop.schedule_value
    schedule_part = "" if schedule_value is None or measurements.loops.schedule is None else (
        f", {schedule_text(measurements.loops.schedule, schedule_value)}"
    )  # fmt: skip
    drive = subject.input_scale.format_with_unit(float(loop.input[sample]))
    return (
        f"The largest deviation, {subject.deviation_scale.format_with_unit(deviation)}, is at {drive} on the {branch} "
        f"branch of loop “{loop.label}”{schedule_part}."
    )


def _group_table(subject: ModelSubject, measurements: Measurements) -> list[Block]:
    """Return a table of deviations and biases by scheduling value; no table for a single value."""
    groups, scale = figures.group_by_schedule(measurements.loops), subject.deviation_scale
    if len(groups) < 2:
        return []
    rows = []
    for group in groups:
        residuals, rising_masks = [], []
        for index in group.indices:
            loop, output = measurements.loops.loops[index], measurements.fitted[index]
            if output is not None:
                residuals.append(output - loop.output)
                rising_masks.append(figures.mask_rising_samples(loop))
        if not residuals:
            continue
        pooled_residuals, is_rising = np.concatenate(residuals), np.concatenate(rising_masks)
        mean = float(np.mean(np.abs(pooled_residuals)))
        row = [group.title, str(pooled_residuals.size), scale.format(mean), subject.percent_of_largest(mean)]
        row += map(scale.format, (rms(pooled_residuals), float(np.max(np.abs(pooled_residuals)))))
        row += [
            scale.format(_mean_or_none(pooled_residuals[branch]), 2) for branch in (is_rising, ~is_rising)
        ]
        rows.append(row)
    head = [subject.schedule_name, "samples", scale.heading("mean"), "of largest", scale.heading("rms"),
            scale.heading("worst"), scale.heading("bias rising"), scale.heading("bias falling")]  # fmt: skip
    caption = (
        f"“Of largest”: in % of {subject.full_scale_text} of all loops. Bias: mean of model minus "
        "measurement; if its sign differs between rising and falling branches, the modelled "
        "loop is too wide or too narrow."
    )
    return [make_table(f"By {subject.schedule_name}", head, rows, caption)]


def _mean_or_none(values: FloatArray) -> float | None:
    return float(values.mean()) if values.size else None


def _loop_table(subject: ModelSubject, loops: Sequence[LoopFit]) -> PageTable:
    scale = subject.deviation_scale
    size = quantity_scale(subject.model.output, [loop.largest_output for loop in loops])
    worst_deviation, largest_mean = max(loop.worst for loop in loops), max(loop.mean_abs for loop in loops)
    columns: list[Column] = [
        (size.heading("largest"), lambda fit: size.format(fit.largest_output)),
        (
            scale.heading("mean"),
            lambda entry: Cell(
                scale.format(entry.mean_abs), bar=entry.mean_abs / largest_mean if largest_mean else None
            ),
        ),
        ("of largest", lambda entry: subject.percent_of_largest(entry.mean_abs)),
        (
            "of own",
            lambda entry: format_percent(
                entry.mean_abs / entry.largest_output if entry.largest_output else None
            ),
        ),
        (scale.heading("rms"), lambda entry: scale.format(entry.rms)),
        (
            scale.heading("worst"),
            lambda entry: Cell(scale.format(entry.worst), strong=entry.worst == worst_deviation),
        ),
    ]
    caption = (
        f"“Of largest”: mean relative to {subject.full_scale_text} of all loops; “of own”: relative to "
        "the largest value of that loop."
    )
    if subject.measurements:
        loops_and_curves = zip(loops, subject.measurements.baseline, strict=False)
        single_valued_means = {id(entry): float(np.mean(np.abs(curve))) for entry, curve in loops_and_curves}
        columns.append(
            (scale.heading("single-valued"), lambda entry: scale.format(single_valued_means[id(entry)]))
        )
        caption += " “Single-valued”: mean deviation of the best single-valued curve."
    return _table_by_loop(subject, loops, columns, "Errors by loop", caption)


def section_measurement(subject: ModelSubject) -> Section | None:
    """Return the section with the values of each loop, and with the repairs and notes."""
    measurements = subject.measurements
    if measurements is None:
        return None
    blocks: list[Block] = []
    inspection = measurements.inspection
    if inspection is not None:
        verdict = " ".join(inspection.verdict.sentences)
        blocks += [Text(typeset(re.sub(r"(?<=\d)%", " %", verdict)))]
        blocks += [_recording_table(subject, inspection), _quality_table(subject, inspection)]
    if not measurements.loops.repairs:
        blocks.append(Text("Nothing was repaired. The samples were fitted as they were read."))
    for title, texts in (
        ("Implausible values", inspection.warnings if inspection else ()),
        ("Repaired before the fit", measurements.loops.repairs),
        ("Noted while reading", measurements.loops.notes),
    ):
        if texts:
            blocks.append(Items(title, tuple(_shorten_paths(text, measurements) for text in texts)))
    return Section("measurement", "How the measurement was read", tuple(blocks))


def _shorten_paths(text: str, measurements: Measurements) -> str:
    """Remove the folders of the files from a message; another section shows their full paths."""
    paths = {source.path for source in measurements.loops.sources}
    paths |= {loop.source for loop in measurements.loops.loops if loop.source}
    for path in sorted(paths, key=len, reverse=True):
        text = text.replace(path, Path(path).name)
    return text


Column = tuple[str, Callable[[Any], str | Cell]]
"""Heading of a column, and the function that returns its cell for a `LoopFit` or `LoopFigures`."""


def _recording_table(subject: ModelSubject, inspection: Inspection) -> PageTable:
    loops = inspection.loops
    input_scale = quantity_scale(inspection.input, [v for o in loops for v in (o.input_low, o.input_high)])
    output_scale = quantity_scale(
        inspection.output, [v for o in loops for v in (o.output_low, o.output_high)]
    )
    columns: list[Column] = [
        ("samples", lambda entry: str(entry.samples)),
        ("cycles", lambda entry: format_number(entry.cycles, 2, is_short=True)),
        (
            input_scale.heading(subject.input_name),
            lambda entry: _format_range(input_scale, entry.input_low, entry.input_high),
        ),
        (
            output_scale.heading(subject.output_name),
            lambda entry: _format_range(output_scale, entry.output_low, entry.output_high),
        ),
    ]
    if any(loop.step is not None for loop in loops):
        columns.append(("step [ms]", lambda entry: format_number(1e3 * (entry.step or 0.0), is_short=True)))
    columns.append(("history", lambda entry: str(entry.history)))
    return _table_by_loop(subject, inspection.loops, columns, "Recorded loops", fallback="moves")


def _quality_table(subject: ModelSubject, inspection: Inspection) -> PageTable:
    loops = inspection.loops
    input_scale = quantity_scale(inspection.input, [loop.width for loop in loops])
    output_scale = quantity_scale(inspection.output, [loop.height for loop in loops])
    columns: list[Column] = [
        (input_scale.heading("width"), lambda entry: input_scale.format(entry.width)),
        (output_scale.heading("height"), lambda entry: output_scale.format(entry.height)),
        (output_scale.heading("noise σ"), lambda entry: output_scale.format(entry.noise, 2)),
    ]
    optional_columns: list[Column] = [
        (output_scale.heading("drift"), lambda entry: output_scale.format(entry.drift, 2)),
        (output_scale.heading("closure"), lambda entry: output_scale.format(entry.closure, 2)),
        (input_scale.heading("offset in"), lambda entry: input_scale.format(entry.input_offset, 2)),
        (output_scale.heading("offset out"), lambda entry: output_scale.format(entry.output_offset, 2)),
        ("skew", lambda entry: format_number(float("nan") if entry.skew is None else entry.skew, 2)),
        ("saturation", lambda entry: Scale(1.0, "").format(entry.saturation, 2)),
    ]
    unknown_text = format_number(float("nan"))
    columns += [c for c in optional_columns if any(c[1](loop) != unknown_text for loop in loops)]
    caption = (
        "Width and height: largest distances of the branches. Noise: standard deviation of the "
        "output. Drift: change over the record. Closure: end minus start of a cycle. Skew: delay of the "
        "output after the input, in samples. Saturation: slope at the tip relative to the steepest slope."
    )
    title = "Loop widths and data quality"
    return _table_by_loop(subject, inspection.loops, columns, title, caption, fallback="moves")


def _table_by_loop(
    subject: ModelSubject,
    loops: Sequence[LoopFit | LoopFigures],
    columns: Sequence[Column],
    title: str,
    caption: str = "",
    fallback: str = UNKNOWN_TEXT,
) -> PageTable:
    """Return a table with a row per loop, by scheduling value; loops without a value come last."""
    scale, schedule = subject.schedule_scale, subject.model.schedule
    rows = []
    for loop in sorted(loops, key=lambda o: math.inf if o.schedule is None else o.schedule):
        schedule_text = fallback if loop.schedule is None else scale.format(loop.schedule, 4, is_short=True)
        row = [loop.label, *([] if schedule is None else [schedule_text])]
        rows.append([*row, *(text(loop) for _, text in columns)])
    schedule_heading = [] if schedule is None else [scale.heading(schedule.symbol)]
    return make_table(title, ["loop", *schedule_heading, *(name for name, _ in columns)], rows, caption)


def _format_range(scale: Scale, low: float, high: float) -> str:
    return f"{scale.format(low, is_short=True)} to {scale.format(high, is_short=True)}"
