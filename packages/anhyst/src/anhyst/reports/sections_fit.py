"""Sections about the measurement: loops, what the model leaves over, what was understood."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from anhyst.data.inspection import Inspection, LoopFigures
from anhyst.data.loops import Loop
from anhyst.data.speeds import speeds_of
from anhyst.model.actuator import Model
from anhyst.model.dynamics import GAMMA
from anhyst.model.schema import LoopFit
from anhyst.reports import figures
from anhyst.reports.subject import Evidence, ModelSubject
from anhyst.support.numeric import FloatArray, rms
from anhyst.support.page import (
    NBSP,
    NOT_KNOWN,
    Block,
    Cell,
    Items,
    PageTable,
    Scale,
    Section,
    Text,
    name_of,
    number,
    percent,
    scale_for,
    shown_at,
    table,
    written,
)


def section_loops(subject: ModelSubject) -> Section | None:
    """Measured against modelled loops."""
    evidence = subject.evidence
    if evidence is None:
        return None
    panels, within = _panels(subject, evidence), ""
    if subject.fit is not None:
        worst = subject.deviation.show(subject.fit.worst)
        within = f"The lines lie within {worst} of the points."
    blocks: list[Block] = [
        subject.picture(
            figures.figure_loops(evidence.loops, evidence.fitted),
            f"{subject.answer} over {subject.drive}, {panels}: measured samples as grey points, "
            f"the modelled loops as blue lines. {within}",
            f"Measured samples (points) and model (line), {panels}." + _left_out(evidence),
        ),
        subject.picture(
            figures.figure_differences(evidence.loops, evidence.fitted, evidence.baseline),
            f"The same less the best single-valued curve, {panels}: what remains is hysteresis, "
            "measured as grey points, modelled as blue lines.",
            "The same less the best single-valued curve (one for each panel): hysteresis by "
            "itself. A curve without memory would be the zero line.",
        ),
    ]
    small = figures.figure_small_loops(evidence.loops, evidence.fitted)
    if small is not None:
        shown = len(figures.small_loops(evidence.loops))
        blocks.append(
            subject.picture(
                small,
                f"The {shown} smallest loops, each in a panel of its own scale: measured samples "
                "as grey points, the model as blue lines.",
                "Small loops, which the panels above do not show, each in its own scale.",
            )
        )
    return Section("loops", "Measured and modelled loops", tuple(blocks))


SHOWS = 0.01
"""Of the largest output of a cycle: by so much higher a loop shows its speed."""

_CYCLE, _SPEEDS = 200, np.geomspace(1e-3, 1.5, 40)
"""Samples of a cycle, and the speeds in which is looked, in parts of the fastest measured one."""


def section_rate(subject: ModelSubject) -> Section | None:
    """How the model follows each speed, where loops run at several; from where on speed shows."""
    evidence = subject.evidence
    speeds = None if evidence is None else speeds_of(evidence.loops)
    if evidence is None or speeds is None:
        return None
    groups = [list(speeds.slow.loops), *map(list, speeds.fast)]
    blocks: list[Block] = []
    if why := str(subject.model.provenance.settings.get("rate", "")):
        blocks.append(Text(f"{why[0].upper()}{why[1:]}."))
    if subject.model.has_eddy_currents:
        blocks.append(Text(_corner_text(subject.model)))
    rows = [_speed_row(subject, evidence, group) for group in groups]
    scale = subject.deviation
    head = ["speed", "loops", scale.head("rms"), "of largest", scale.head("worst"), "of largest"]
    blocks += [
        subject.picture(
            figures.figure_speeds(evidence.loops, evidence.fitted, speeds),
            f"{subject.answer} over {subject.drive}, one panel for each speed: measured samples as "
            "grey points, the modelled loops as blue lines.",
            "Measured samples (points) and model (line) at each speed, the slow loops first.",
        ),
        table("Speed by speed", head, rows, f"Of {subject.full_scale} of all loops."),
    ]
    return Section("rate", "Rate: what the speed of the loops does", tuple(blocks))


def _speed_row(subject: ModelSubject, evidence: Evidence, group: Sequence[Loop]) -> list[Cell]:
    chosen, scale = {id(loop) for loop in group}, subject.deviation
    pairs = zip(evidence.loops.loops, evidence.fitted, strict=True)
    off = [fit - loop.output for loop, fit in pairs if fit is not None and id(loop) in chosen]
    cells = [Cell(figures.speed_text(group)), Cell(str(len(group)))]
    if not off:
        return [*cells, *[Cell("")] * 4]
    every = np.concatenate(off)
    for size in (rms(every), float(np.abs(every).max())):
        cells += [Cell(scale.number(size)), Cell(subject.percent(size))]
    return cells


def _corner_text(model: Model) -> str:
    """Say from which speed on the model's loops are higher, and how sure that is."""
    cut = (
        f"cut into {model.layers.count} layers" if model.layers else "one layer, a lag of the flux"
    )
    corner, unsure, part = rate_corner(model), model.uncertainty, percent(SHOWS)
    if corner is None:
        return (
            f"The iron is {cut}; up to the fastest loops, speed changes the height of the model's "
            f"loops by less than {part}."
        )
    text = (
        f"The iron is {cut}. From {corner:.3g}{NBSP}Hz on the loops of the model are higher than at "
        f"rest by {part} of their largest {name_of(model.output)}"
    )
    if unsure is None or GAMMA not in unsure.names:
        return f"{text}."
    index = unsure.names.index(GAMMA)
    by = math.exp(2.0 * unsure.std[index] / unsure.values[index])
    ends = f"{corner / by:.3g} to {corner * by:.3g}{NBSP}Hz"
    return f"{text} ({ends}: two standard deviations of gamma)."


def rate_corner(model: Model) -> float | None:
    """Return the speed, Hz, from which on loops are higher than at rest by :data:`SHOWS`.

    Full cycles at the first node; time enters a model as gamma times a rate alone, so that the corner
    is in inverse proportion to gamma.
    """
    if model.valid is None or model.dynamics is None or not model.dynamics.fastest:
        return None
    low, high = model.valid.input
    shape = 1.0 - np.abs(np.linspace(-1.0, 1.0, _CYCLE, endpoint=False))
    drive, node = low + (high - low) * shape, model.first_node
    rates, heights = model.dynamics.fastest * _SPEEDS, []
    for rate in rates.tolist():
        time = np.arange(_CYCLE) / (_CYCLE * rate)
        made = model.predict(drive, node, time, "settled").output
        falling = np.append(made[_CYCLE // 2 :], made[0])[::-1]
        heights.append(float(np.max(falling - made[: _CYCLE // 2 + 1])) / float(np.ptp(made)))
    higher = np.array(heights) - heights[0]
    above = np.flatnonzero(higher >= SHOWS)
    if not above.size:
        return None
    at = int(above[0])
    ends, logs = higher[at - 1 : at + 1], np.log(rates[at - 1 : at + 1])
    return float(np.exp(np.interp(SHOWS, ends, logs)))


def _panels(subject: ModelSubject, evidence: Evidence) -> str:
    if evidence.loops.schedule is None or len(figures.groups_of(evidence.loops)) == 1:
        return "all loops in one panel"
    return f"one panel for each {subject.over}"


def _left_out(evidence: Evidence) -> str:
    groups = len(figures.groups_of(evidence.loops))
    return (
        f" {figures.MOST_PANELS} of {groups} panels are shown."
        if groups > figures.MOST_PANELS
        else ""
    )


def section_residuals(subject: ModelSubject) -> Section | None:
    """Residuals: picture, by scheduling value, loop by loop."""
    blocks: list[Block] = []
    evidence = subject.evidence
    if evidence is not None and any(output is not None for output in evidence.fitted):
        index = _worst_place(subject, evidence)
        noise = subject.deviation.show(evidence.verdict.noise_mean)
        figure = figures.figure_residuals(evidence.loops, evidence.fitted)
        panels = _panels(subject, evidence)
        alt = (
            f"Modelled minus measured {subject.answer} over {subject.drive}, {panels}; samples on "
            f"rising branches blue, on falling branches orange, noise as a grey band. {index}"
        )
        caption = (
            f"Model minus measurement. The grey band holds {percent(0.95)} of the noise of the "
            f"{subject.answer} (mean size {noise}); what stands out of it is not noise."
        )
        if subject.fit is not None and subject.fit.left_over:
            line = subject.fit.left_over
            caption += f" {line[0].upper()}{line[1:]}."
        blocks += [Text(index), subject.picture(figure, alt, caption + _left_out(evidence))]
        blocks += _by_group(subject, evidence)
    if subject.fit is not None and subject.fit.loops:
        blocks.append(_loop_table(subject, subject.fit.loops))
    return Section("residuals", "What the model leaves over", tuple(blocks)) if blocks else None


def _worst_place(subject: ModelSubject, evidence: Evidence) -> str:
    """Say where the model is farthest from the measurement."""
    best: tuple[float, int, int] = (-1.0, 0, 0)
    pairs = zip(evidence.loops.loops, evidence.fitted, strict=True)
    for index, (loop, output) in enumerate(pairs):
        if output is None:
            continue
        off = np.abs(output - loop.output)
        best = max(best, (float(off.max()), index, int(np.argmax(off))))
    size, index, sample = best
    loop = evidence.loops.loops[index]
    branch = "rising" if figures.rising(loop)[sample] else "falling"
    at = loop.schedule_value
    where = "" if at is None or evidence.loops.schedule is None else (
        f", {shown_at(evidence.loops.schedule, at)}"
    )  # fmt: skip
    drive = subject.input_scale.show(float(loop.input[sample]))
    return (
        f"The largest deviation, {subject.deviation.show(size)}, is at {drive} on the {branch} "
        f"branch of loop “{loop.label}”{where}."
    )


def _by_group(subject: ModelSubject, evidence: Evidence) -> list[Block]:
    """Deviations by scheduling value, with the bias of either branch; nothing for one value."""
    groups, scale = figures.groups_of(evidence.loops), subject.deviation
    if len(groups) < 2:
        return []
    rows = []
    for group in groups:
        over, up = [], []
        for index in group.places:
            loop, output = evidence.loops.loops[index], evidence.fitted[index]
            if output is not None:
                over.append(output - loop.output)
                up.append(figures.rising(loop))
        if not over:
            continue
        pooled, upwards = np.concatenate(over), np.concatenate(up)
        mean = float(np.mean(np.abs(pooled)))
        row = [group.title, str(pooled.size), scale.number(mean), subject.percent(mean)]
        row += map(scale.number, (rms(pooled), float(np.max(np.abs(pooled)))))
        row += [scale.number(_mean(pooled[branch]), 2) for branch in (upwards, ~upwards)]
        rows.append(row)
    head = [subject.over, "samples", scale.head("mean"), "of largest", scale.head("rms"),
            scale.head("worst"), scale.head("bias rising"), scale.head("bias falling")]  # fmt: skip
    caption = (
        f"“Of largest”: of {subject.full_scale} of all loops. Bias: mean of model minus "
        "measurement; where its sign differs between rising and falling branches, the modelled "
        "loop is too wide or too narrow."
    )
    return [table(f"By {subject.over}", head, rows, caption)]


def _mean(values: FloatArray) -> float | None:
    return float(values.mean()) if values.size else None


def _loop_table(subject: ModelSubject, loops: Sequence[LoopFit]) -> PageTable:
    scale = subject.deviation
    size = scale_for(subject.model.output, [loop.largest_output for loop in loops])
    worst, most = max(loop.worst for loop in loops), max(loop.mean_abs for loop in loops)
    columns: list[Column] = [
        (size.head("largest"), lambda one: size.number(one.largest_output)),
        (
            scale.head("mean"),
            lambda one: Cell(scale.number(one.mean_abs), bar=one.mean_abs / most if most else None),
        ),
        ("of largest", lambda one: subject.percent(one.mean_abs)),
        (
            "of own",
            lambda one: percent(one.mean_abs / one.largest_output if one.largest_output else None),
        ),
        (scale.head("rms"), lambda one: scale.number(one.rms)),
        (
            scale.head("worst"),
            lambda one: Cell(scale.number(one.worst), strong=one.worst == worst),
        ),
    ]
    caption = (
        f"“Of largest”: mean in parts of {subject.full_scale} of all loops; “of own”: of "
        "the largest of that loop."
    )
    if subject.evidence:
        curves = zip(loops, subject.evidence.baseline, strict=False)
        single = {id(one): float(np.mean(np.abs(curve))) for one, curve in curves}
        columns.append((scale.head("single-valued"), lambda one: scale.number(single[id(one)])))
        caption += " “Single-valued”: mean deviation of the best single-valued curve."
    return _by_loop(subject, loops, columns, "Loop by loop", caption)


def section_measurement(subject: ModelSubject) -> Section | None:
    """Figures of each loop, and what was repaired and noted."""
    evidence = subject.evidence
    if evidence is None:
        return None
    blocks: list[Block] = []
    inspection = evidence.inspection
    if inspection is not None:
        verdict = " ".join(inspection.verdict.sentences)
        blocks += [Text(written(re.sub(r"(?<=\d)%", " %", verdict)))]
        blocks += [_recorded(subject, inspection), _dirt(subject, inspection)]
    if not evidence.loops.repairs:
        blocks.append(Text("Nothing was repaired: the samples were fitted as they were read."))
    for title, texts in (
        ("Looks odd", inspection.warnings if inspection else ()),
        ("Repaired before the fit", evidence.loops.repairs),
        ("Noted while reading", evidence.loops.notes),
    ):
        if texts:
            blocks.append(Items(title, tuple(_short(text, evidence) for text in texts)))
    return Section("measurement", "What was understood of the measurement", tuple(blocks))


def _short(text: str, evidence: Evidence) -> str:
    """Leave folders out of a message: the files are named in full where the model came from."""
    paths = {source.path for source in evidence.loops.sources}
    paths |= {loop.source for loop in evidence.loops.loops if loop.source}
    for path in sorted(paths, key=len, reverse=True):
        text = text.replace(path, Path(path).name)
    return text


Column = tuple[str, Callable[[Any], str | Cell]]
"""The head of a column, and its cell for a `LoopFit` or `LoopFigures`."""


def _recorded(subject: ModelSubject, inspection: Inspection) -> PageTable:
    loops = inspection.loops
    across = scale_for(inspection.input, [v for o in loops for v in (o.input_low, o.input_high)])
    up = scale_for(inspection.output, [v for o in loops for v in (o.output_low, o.output_high)])
    columns: list[Column] = [
        ("samples", lambda one: str(one.samples)),
        ("cycles", lambda one: number(one.cycles, 2, short=True)),
        (across.head(subject.drive), lambda one: _span(across, one.input_low, one.input_high)),
        (up.head(subject.answer), lambda one: _span(up, one.output_low, one.output_high)),
    ]
    if any(loop.step is not None for loop in loops):
        columns.append(("step [ms]", lambda one: number(1e3 * (one.step or 0.0), short=True)))
    columns.append(("history", lambda one: str(one.history)))
    return _by_loop(subject, inspection.loops, columns, "What was recorded", unknown="moves")


def _dirt(subject: ModelSubject, inspection: Inspection) -> PageTable:
    loops = inspection.loops
    across = scale_for(inspection.input, [loop.width for loop in loops])
    up = scale_for(inspection.output, [loop.height for loop in loops])
    columns: list[Column] = [
        (across.head("width"), lambda one: across.number(one.width)),
        (up.head("height"), lambda one: up.number(one.height)),
        (up.head("noise σ"), lambda one: up.number(one.noise, 2)),
    ]
    optional: list[Column] = [
        (up.head("drift"), lambda one: up.number(one.drift, 2)),
        (up.head("closure"), lambda one: up.number(one.closure, 2)),
        (across.head("offset in"), lambda one: across.number(one.input_offset, 2)),
        (up.head("offset out"), lambda one: up.number(one.output_offset, 2)),
        ("skew", lambda one: number(float("nan") if one.skew is None else one.skew, 2)),
        ("saturation", lambda one: Scale(1.0, "").number(one.saturation, 2)),
    ]
    nothing = number(float("nan"))
    columns += [c for c in optional if any(c[1](loop) != nothing for loop in loops)]
    caption = (
        "Width and height: largest distance of the branches. Noise: standard deviation of the "
        "output. Drift: over the record. Closure: end minus start of a cycle. Skew: delay of the "
        "output behind the input, in samples. Saturation: slope at the tip over the steepest slope."
    )
    title = "How wide the loops are, and how clean the record"
    return _by_loop(subject, inspection.loops, columns, title, caption, unknown="moves")


def _by_loop(
    subject: ModelSubject,
    loops: Sequence[LoopFit | LoopFigures],
    columns: Sequence[Column],
    title: str,
    caption: str = "",
    unknown: str = NOT_KNOWN,
) -> PageTable:
    """Return a row for each loop, ascending over the schedule, those without a value last."""
    scale, schedule = subject.schedule_scale, subject.model.schedule
    rows = []
    for one in sorted(loops, key=lambda o: math.inf if o.schedule is None else o.schedule):
        at = unknown if one.schedule is None else scale.number(one.schedule, 4, short=True)
        row = [one.label, *([] if schedule is None else [at])]
        rows.append([*row, *(text(one) for _, text in columns)])
    over = [] if schedule is None else [scale.head(schedule.symbol)]
    return table(title, ["loop", *over, *(name for name, _ in columns)], rows, caption)


def _span(scale: Scale, low: float, high: float) -> str:
    return f"{scale.number(low, short=True)} to {scale.number(high, short=True)}"
