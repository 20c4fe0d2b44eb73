"""Tables and sentences of the report of a simulation, every figure with its confidence interval."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from anhyst.compensate.methods import METHODS, MODELS
from anhyst.data.verdict import WHERE_IT_PAYS
from anhyst.reports.bearing.look import interval_text, ordered
from anhyst.reports.bearing.subject import WITHIN_NOISE, FigureTable, SimulationSubject, Steps
from anhyst.study.bearing.linear import Margins
from anhyst.study.bearing.metrics import SETTLED
from anhyst.study.engine.verdict import (
    ComparedFigure,
    Interval,
    Judgement,
    compare,
    judge,
    strongest,
)
from anhyst.support.kinds import MethodName
from anhyst.support.page import MINUS, NBSP, NOT_KNOWN, Cell, PageTable, number, table

OVERSHOOT, NOISE = "overshoot_percent", "noise_percent"
STEP_TABLES: tuple[tuple[str, str, str, float, str], ...] = (
    (
        OVERSHOOT,
        "Overshoot",
        "%",
        1.0,
        "Of the height of the step, noise included; of a step up and one down, the larger. "
        f"“{WITHIN_NOISE}”: not certainly more than the noise below, so that it shows nothing of "
        "the step.",
    ),
    (
        NOISE,
        "Noise in the overshoot",
        "%",
        1.0,
        "Largest deviation of the gap from its mean in the last half of the hold, to both sides, "
        "of the height of the step; of a step up and one down, the larger.",
    ),
    ("rise_time_s", "Rise time, 10 to 90 %", "ms", 1e3, ""),
    (
        "settling_in_noise_s",
        "Settling time",
        "ms",
        1e3,
        f"Until the gap stays within {100.0 * SETTLED:g} % of the height, or three times the "
        "resolution of the position sensor (rms of its noise and its steps) where that is more: "
        "one band for all variants.",
    ),
    ("steady_error_m", "Steady-state error", "nm", 1e9, "Of the gap, over the end of the hold."),
    ("tracking_rms_m", "Deviation from the reference, rms", "µm", 1e6, "Over the whole step."),
    (
        "force_error_rms_N",
        "Force error, rms",
        "N",
        1.0,
        "True less wanted force of the same tick: it holds the tick of delay and the lag of the "
        "amplifier, which no compensation takes away.",
    ),
    (
        "current_rate_rms_A_per_s",
        "Current effort",
        "A/s",
        1.0,
        "Root mean square of the current's rate of change.",
    ),
)
"""Figure, title, unit as shown, factor to it, caption."""


def step_difference(step: Steps, mine: MethodName, baseline: MethodName) -> ComparedFigure:
    """Compare the overshoots of two variants in a step, beyond the larger noise of both."""
    overshoot, noise = step.of(OVERSHOOT), step.of(NOISE)
    floor = max(noise[mine].mean, noise[baseline].mean)
    return compare("overshoot", baseline, overshoot[mine], overshoot[baseline], floor)


def difference_text(figure: ComparedFigure) -> str:
    """Write such as "54 % less"."""
    if figure.less:
        return f"{number(100.0 * (1.0 - figure.ratio), 2)}{NBSP}% less"
    if figure.more:
        return f"+{number(figure.mine - figure.its, 2)} points"
    return "alike" if math.isfinite(figure.mine + figure.its) else NOT_KNOWN


def judge_steps(steps: Sequence[Steps], variant: MethodName) -> Judgement:
    """Judge a variant, or the fullest model beside it where it has none."""
    names = {name for step in steps for name in step.cells}
    models = [name for name in ordered(names) if name in MODELS]
    mine = variant if variant in MODELS or not models else models[-1]
    if mine not in MODELS:
        return Judgement("unknown", "no variant with a hysteresis model was run")
    compared = []
    for step in steps:
        other = strongest(step.of(OVERSHOOT))
        if other is not None and mine in step.cells:
            difference = step_difference(step, mine, other)
            compared += [difference] if math.isfinite(difference.mine + difference.its) else []
    if not compared:
        return Judgement("unknown", f"{mine} or every baseline lost levitation at every step")
    judged = judge(mine, compared, "steps", WHERE_IT_PAYS["feedback"])
    return replace(judged, text=f"{judged.text}{_beside_flux(steps, mine)}")


def _beside_flux(steps: Sequence[Steps], mine: MethodName) -> str:
    """Say how it stands against measured flux, if that was run."""
    differences = [
        step_difference(step, mine, "flux") for step in steps if {mine, "flux"} <= set(step.cells)
    ]
    known = [
        difference for difference in differences if math.isfinite(difference.mine + difference.its)
    ]
    if not known:
        return ""
    less, more = (
        sum(difference.less for difference in known),
        sum(difference.more for difference in known),
    )
    return f"; than measured flux less at {less} and more at {more}"


def overshoot_text(step: Steps, name: MethodName) -> str:
    """Write the overshoot of a variant, and whether it is noise."""
    return f"{interval_text(step.of(OVERSHOOT)[name], '%')} {step.remarks.get(name, '')}".rstrip()


def benefit_table(subject: SimulationSubject) -> PageTable | None:
    """Say for every step and baseline how much overshoot is gone."""
    steps = [step for step in subject.steps if subject.variant in step.cells]
    baselines = subject.baselines
    if not steps or not baselines:
        return None
    rows: list[list[str | Cell]] = []
    for step in steps:
        row: list[str | Cell] = [subject.situation(step), overshoot_text(step, subject.variant)]
        for name in baselines:
            known = name in step.cells
            difference = step_difference(step, subject.variant, name) if known else None
            text = NOT_KNOWN if difference is None else difference_text(difference)
            row.append(Cell(text, strong=difference is not None and difference.less))
        rows.append(row)
    return table(
        f"Overshoot of {subject.variant} against that of each baseline",
        ["step", "overshoot", *baselines],
        rows,
        f"Overshoot of {subject.variant} in % of the height, and what it is against each baseline: "
        f"same gains, same plant, same {subject.seeds} noise seeds. “54 % less”: that part of the "
        "overshoot of the baseline in the head of the column is gone. “+0.5 points”: more than the "
        "baseline, by so many percentage points of the height. “Alike”: the 95 % confidence "
        "intervals leave both signs open, or the difference is less than one of the two moves "
        f"about at a standstill. “{WITHIN_NOISE}”: not certainly more than that. The overshoot of "
        "every baseline stands in section 2.",
    )


def step_tables(subject: SimulationSubject) -> list[PageTable]:
    """Return one table for each figure of the steps."""
    made = []
    for name, title, unit, factor, caption in STEP_TABLES:
        rows = {subject.situation(step): step.of(name) for step in subject.steps}
        remarks = {subject.situation(step): step.remarks for step in subject.steps}
        noted = remarks if name == OVERSHOOT else {}
        comparison = FigureTable(title, unit, factor, rows, caption, noted)
        if any(not math.isnan(interval.mean) for row in rows.values() for interval in row.values()):
            made.append(comparison_table(comparison))
    return made


def comparison_table(comparison: FigureTable) -> PageTable:
    """Return a table of one figure: a row a situation, a column a variant."""
    variants = ordered(name for row in comparison.rows.values() for name in row)

    def cell(situation: str, name: MethodName, interval: Interval | None) -> str:
        """Write a figure and its remark, between which alone a line may end."""
        remark = comparison.remarks.get(situation, {}).get(name, "")
        parts = (interval_text(interval, factor=comparison.factor), remark)
        return " ".join(part.replace(" ", NBSP) for part in parts if part)

    rows = [
        [situation, *(cell(situation, name, row.get(name)) for name in variants)]
        for situation, row in comparison.rows.items()
    ]
    counts = {one.count for row in comparison.rows.values() for one in row.values() if one.count}
    ends = " to ".join(str(end) for end in sorted({min(counts), max(counts)})) if counts else "no"
    interval = f"Mean and 95 % confidence interval over {ends} noise seeds."
    return table(
        f"{comparison.title} ({comparison.unit})" if comparison.unit else comparison.title,
        ["", *variants],
        rows,
        f"{comparison.caption} {interval}".strip(),
    )


def margin_table(margins: Mapping[MethodName, Margins]) -> PageTable:
    """Return the margins of linearised loops."""
    rows = [
        [
            name,
            "yes" if one.stable else "NO",
            f"{number(one.gain_down, 2)} to {number(one.gain_up, 2)}",
            number(one.phase, 2),
            number(1e6 * one.delay, 2),
            number(one.crossover, 3),
            f"{number(one.peak)} at {number(one.peak_frequency, 2)}{NBSP}Hz",
        ]
        for name, one in ((name, margins[name]) for name in ordered(margins))
    ]
    return table(
        "Margins of the linearised loop",
        (
            "variant",
            "stable",
            "gain may change by",
            "phase margin (°)",
            "more delay (µs)",
            "crossover (Hz)",
            "peak sensitivity",
        ),
        rows,
        texts=2,
    )


def legend_table(variants: Sequence[MethodName]) -> PageTable:
    """Say what the variants are."""
    meaning = {
        "ratio": "the paper's case without compensation; nothing cancels the negative stiffness",
        "secant": "the same, read as a line through the origin",
        "linearised": "cancels the negative stiffness at the operating point: standard practice",
        "single-valued": "the honest baseline of hysteresis: all that a curve without memory can do",
        "play": "the least that knows hysteresis: width of the loops and one state, no law of iron",
        "simplified": "inverse of the simplified law",
        "at-rest": "the same as full, but for iron that answers late: taken as if it did not",
        "full": "inverse of the identified law, its state advanced with what was applied",
        "flux": "needs a Hall probe in the gap, and measures instead of modelling",
        "fused": "full, corrected by a Hall probe in the gap",
    }
    rows: list[list[str | Cell]] = [
        [Cell(name, code=True), METHODS[name].title, meaning[name]] for name in variants
    ]
    return table(
        "Variants",
        ["name", "from wanted force to current", "remark"],
        rows,
        "All are fitted to the same measured loops, except flux, which has a static series of its "
        "probe.",
        texts=3,
    )


def settling_sentence(subject: SimulationSubject) -> str:
    """Say whether settling and steady-state error change, which the paper found not to."""
    if "ratio" not in subject.baselines:
        return ""
    counts = []
    for name, title, unit, factor in (
        ("settling_in_noise_s", "settling time", "ms", 1e3),
        ("steady_error_m", "steady-state error", "nm", 1e9),
    ):
        both = [
            (abs(row[subject.variant].mean), abs(row["ratio"].mean))
            for row in [step.of(name) for step in subject.steps]
            if subject.variant in row and "ratio" in row
        ]
        both = [pair for pair in both if not math.isnan(sum(pair))]  # lost
        if both:
            mine = _range([factor * first for first, _ in both], unit)
            other = _range([factor * second for _, second in both], unit)
            counts.append(f"{title}: {mine} with {subject.variant}, {other} with ratio")
    if not counts:
        return ""
    return (
        "The paper found settling time and steady-state error almost unchanged by compensation. "
        f"Here, over all steps: {'; '.join(counts)}."
    )


def _range(values: Sequence[float], unit: str) -> str:
    low, high = min(values), max(values)
    if not math.isfinite(low):
        return "never"
    end = f"{number(high, 2)}{NBSP}{unit}" if math.isfinite(high) else "never"
    return f"{number(low, 2)} to {end}".replace("-", MINUS)
