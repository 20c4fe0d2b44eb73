"""The report of a simulated bearing: one page that needs nothing else."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from matplotlib.figure import Figure

from anhyst.reports.bearing.block_diagram import figure_structure
from anhyst.reports.bearing.look import ordered, verdict_note
from anhyst.reports.bearing.over_frequency import figure_bode, figure_nyquist, figure_sensitivity
from anhyst.reports.bearing.over_runs import BenefitCell, figure_benefit, figure_pareto
from anhyst.reports.bearing.over_time import (
    figure_force_current,
    figure_forces,
    figure_standstill,
    figure_steps,
    figure_tracking,
)
from anhyst.reports.bearing.subject import SimulationSubject, Steps
from anhyst.reports.bearing.tables import (
    OVERSHOOT,
    benefit_table,
    comparison_table,
    judge_steps,
    legend_table,
    margin_table,
    overshoot_text,
    settling_sentence,
    step_tables,
)
from anhyst.study.bearing.linear import zone
from anhyst.study.engine.verdict import strongest
from anhyst.support.atomic import PathLike, atomic_writer
from anhyst.support.figures import svg_text
from anhyst.support.kinds import MethodName
from anhyst.support.page import (
    NBSP,
    Block,
    Cell,
    Headline,
    Items,
    Note,
    Picture,
    Section,
    Text,
    Tile,
    number,
    render_page,
    table,
)
from anhyst.support.version import running_version

_TILES = 4


def write_simulation_report(path: PathLike, subject: SimulationSubject) -> None:
    """Write the report of a simulation: one HTML file that needs nothing else."""
    text = render(subject)
    with atomic_writer(path) as stream:
        stream.write(text)


def render(subject: SimulationSubject) -> str:
    """Return the text of the report; the same for the same subject."""
    sections = (
        _structure(subject),
        _steps(subject),
        _forces(subject),
        _loops(subject),
        _tracking(subject),
        _standstill(subject),
        _frequency(subject),
        _benefit(subject),
        _tuning(subject),
        _origin(subject),
    )
    return render_page(
        _headline(subject),
        [section for section in sections if section is not None and section.blocks],
        running_version(),
        kind="Magnetic bearing",
        source="a simulation",
    )


def _picture(figure: Figure, key: str, alt: str, caption: str) -> Picture:
    return Picture(svg_text(figure, key), alt, caption)


def _more(subject: SimulationSubject, key: str) -> list[Block]:
    """Return the tables and other blocks of a section that stand below its figures."""
    tables = [comparison_table(comparison) for comparison in subject.tables.get(key, ())]
    return [*tables, *subject.blocks.get(key, ())]


def _headline(subject: SimulationSubject) -> Headline:
    plant = subject.rig.settings
    arrangement = "A pair of magnets" if plant.opposite is not None else "One magnet"
    what = (
        f"{arrangement}, {plant.body.mass_kg:g}{NBSP}kg, {subject.rig.load:g}{NBSP}N load, "
        f"{1e3 * plant.gap_m:g}{NBSP}mm gap, {plant.timing.rate_Hz:g} ticks a second; "
        f"controller “{subject.controller.name}”, variant {subject.variant}."
    )
    basis = (
        f"Simulated with {plant.timing.delay_ticks:g} tick of delay, DAC, ADC, sensor noise and a "
        f"supply of {plant.amplifier.supply_V:g}{NBSP}V"
    )
    if subject.steps:
        basis += f"; intervals are those of 95 % confidence over {subject.seeds} noise seeds"
    judged = [verdict_note(judge_steps(subject.steps, subject.variant))] if subject.steps else []
    notes = (*judged, *subject.notes, *_lost(subject))
    return Headline(
        title=plant.name,
        what=what,
        basis=f"{basis}.",
        notes=tuple(sorted(notes, key=lambda note: note.tone != "bad")),
        tiles=_tiles(subject),
        comparison=benefit_table(subject),
        holds="These figures hold for this plant and these settings, and for no other iron: what "
        "compensation gains depends on loop width, reversible fraction and step height.",
    )


def _tiles(subject: SimulationSubject) -> tuple[Tile, ...]:
    """Overshoot at every height at the operating gap, beside the strongest of the others."""
    tiles = []
    gap = subject.rig.settings.gap_m
    for step in subject.steps:
        mine = step.of(OVERSHOOT).get(subject.variant)
        if mine is None or math.isnan(mine.mean):
            continue
        if step.gap == gap and step.load == subject.steps[0].load:
            tiles.append(
                Tile(
                    f"{number(mine.mean, 2)}{NBSP}%",
                    f"overshoot, {1e6 * step.height:g}{NBSP}µm",
                    "; ".join(_beside(step, subject.variant)),
                )
            )
    return tuple(tiles[:_TILES])


def _beside(step: Steps, variant: MethodName) -> Iterable[str]:
    """Write the overshoot of a variant, of the strongest baseline and of measured flux."""
    yield f"{variant}: {overshoot_text(step, variant)}"
    other = strongest(step.of(OVERSHOOT))
    if other not in (None, variant):
        yield f"strongest without hysteresis model ({other}): {overshoot_text(step, other)}"
    if "flux" in step.cells and variant != "flux":
        yield f"measured flux: {overshoot_text(step, 'flux')}"


def _lost(subject: SimulationSubject) -> Iterable[Note]:
    """Say where levitation was lost."""
    runs = [
        f"{name} at {subject.situation(step)}: {cell.lost} of {subject.seeds} runs"
        for step in subject.steps
        for name, cell in step.cells.items()
        if cell.lost
    ]
    if runs:
        text = f"{'; '.join(runs)}. A figure of which a run was lost has no mean."
        yield Note("bad", "Levitation lost", text)


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]


def _structure(subject: SimulationSubject) -> Section:
    caption = (
        "Structure of the simulation (the paper's Fig. 10) with the numbers of rig and controller "
        "file. Blue boxes are the compiled program, as it would be flashed; grey ones the plant."
    )
    alt = (
        "Block diagram: controller, force to current, DAC and delay, amplifier, electrical "
        "subsystem, force-current hysteresis, mechanics with load drive, sensors back to the "
        "controller."
    )
    figure = figure_structure(subject.rig, subject.controller)
    return Section(
        "structure",
        "Structure and numbers",
        (_picture(figure, "structure", alt, caption), legend_table(subject.variants)),
    )


def _steps(subject: SimulationSubject) -> Section:
    blocks: list[Block] = []
    if subject.panels:
        names = ordered({name for panel in subject.panels for name in panel.recordings})
        blocks.append(
            _picture(
                figure_steps(subject.panels),
                "steps",
                f"Step responses, position over time, one panel a step: {', '.join(names)}.",
                "Step responses with and without compensation (the paper's Fig. 11), one run of "
                f"{subject.seeds}; overshoot in the legends is the mean over all of them, in % of "
                "the height. The grey band is 2 % of the height. True position; upwards closes "
                "the gap. Below each, how far it is from the reference, enlarged: above zero it is "
                "beyond its end.",
            )
        )
    if sentence := settling_sentence(subject):
        blocks.append(Text(sentence))
    blocks += step_tables(subject)
    return Section("steps", "Step responses", (*blocks, *_more(subject, "steps")))


def _forces(subject: SimulationSubject) -> Section:
    blocks: list[Block] = []
    if subject.forces:
        blocks.append(
            _picture(
                figure_forces(subject.forces),
                "forces",
                "Wanted and true force over time and their difference, one column a variant: "
                f"{', '.join(ordered(subject.forces))}.",
                "What the position controller wants and what the magnet gives. The difference "
                "holds hysteresis, but the lag of amplifier and delay as well, and for a constant "
                "ratio the force that the motion of the armature adds.",
            )
        )
    return Section("forces", "Wanted and true force", (*blocks, *_more(subject, "forces")))


def _loops(subject: SimulationSubject) -> Section | None:
    if not subject.run or not subject.measured:
        return None
    at = sorted({loop.gap for loop in subject.measured})
    gaps = " and ".join(f"{1e3 * gap:g}{NBSP}mm" for gap in at)
    figure = figure_force_current(subject.run, subject.measured, subject.identified)
    return Section(
        "loops",
        "In the plane of force and current",
        (
            _picture(
                figure,
                "loops",
                f"Force over current: measured loops at {gaps}, and where the run goes: "
                f"{', '.join(ordered(subject.run))}.",
                f"True force over true current of the run, over the loops measured at {gaps}, the "
                "nearest gaps, and the identified loop at the gap of the run. Below, the loops "
                "less the single-valued curve of their gap: hysteresis by itself.",
            ),
        ),
    )


def _tracking(subject: SimulationSubject) -> Section:
    blocks: list[Block] = []
    for index, tried in enumerate(subject.tracked):
        blocks.append(
            _picture(
                figure_tracking(tried.recordings, tried.title),
                f"tracking{index}",
                f"{_sentence(tried.title)}: position over time and its error, "
                f"{', '.join(ordered(tried.recordings))}.",
                f"{_sentence(tried.title)}. True position; one run of {subject.seeds}.",
            )
        )
    title = "Trajectories, load steps, recovery"
    return Section("tracking", title, (*blocks, *_more(subject, "tracking")))


def _standstill(subject: SimulationSubject) -> Section:
    blocks: list[Block] = []
    if subject.standstill:
        sensor = subject.rig.settings.gap_sensor
        noise, step = sensor.sensor().noise, sensor.sensor().step
        blocks.append(
            _picture(
                figure_standstill(subject.standstill),
                "standstill",
                "Position at a standstill over time, and its spectrum: "
                f"{', '.join(ordered(subject.standstill))}.",
                f"True position at rest in the air, with a sensor of {1e9 * noise:g}{NBSP}nm rms "
                f"and steps of {1e9 * step:g}{NBSP}nm ({sensor.kind}).",
            )
        )
    return Section("standstill", "Standstill", (*blocks, *_more(subject, "standstill")))


def _frequency(subject: SimulationSubject) -> Section:
    blocks: list[Block] = []
    if subject.sensitivity:
        peaks = [
            f"{name}: peak {curve.peak:.2f}, zone {zone(curve.peak)}"
            for name, curve in (
                (one, subject.sensitivity[one]) for one in ordered(subject.sensitivity)
            )
        ]
        blocks.append(Text(f"Measured sensitivity, ISO 14839-3. {'; '.join(peaks)}."))
        blocks.append(
            _picture(
                figure_sensitivity(subject.sensitivity, subject.linear_sensitivity),
                "sensitivity",
                "Sensitivity over frequency, measured by injection of a sine into the running "
                f"nonlinear loop, with the zones A to D: {', '.join(ordered(subject.sensitivity))}",
                "What the controller sees over what was injected, a stepped sine in the running "
                "nonlinear loop; dotted: linearised. Zones of ISO 14839-3: A up to 3 (9.5 dB), "
                "B up to 4 (12 dB), C up to 5 (14 dB).",
            )
        )
    if subject.loop_gain:
        names = ", ".join(ordered(subject.loop_gain))
        blocks.append(
            _picture(
                figure_bode(subject.loop_gain),
                "bode",
                f"Bode plot of the linearised loop gain, magnitude and phase: {names}.",
                "Loop gain of the loop linearised at the operating point, delay, amplifier and "
                "sensor included. A variant that is no constant is shown as if it knew the "
                "static slopes and cancelled them exactly: hysteresis drops out, all of these have "
                "one loop, and margins are given only for constants. The magnet is unstable by "
                "itself, at low frequencies the gain must stay above 1.",
            )
        )
        blocks.append(
            _picture(
                figure_nyquist(subject.loop_gain),
                "nyquist",
                f"Nyquist plot of the linearised loop gain around the critical point: {names}.",
                "The same in the complex plane; within the red circle around -1 the sensitivity "
                "is beyond zone A.",
            )
        )
    if subject.margins:
        blocks.append(margin_table(subject.margins))
    title = "Sensitivity, Bode and Nyquist plots"
    return Section("frequency", title, (*blocks, *_more(subject, "frequency")))


def _benefit(subject: SimulationSubject) -> Section:
    blocks: list[Block] = []
    for index, measure in enumerate(dict.fromkeys(cell.measure for cell in subject.benefit)):
        cells = [cell for cell in subject.benefit if cell.measure == measure]
        for against in dict.fromkeys(cell.against for cell in cells):
            mine = [cell for cell in cells if cell.against == against]
            blocks.append(Text(_gains(mine)))
        blocks.append(
            _picture(
                figure_benefit(cells, subject.variant),
                f"benefit{index}",
                f"Maps of the ratio of {measure} over loop width and reversible fraction, one "
                "column a step height, one row a baseline; hatched where no gain is certain.",
                f"{_sentence(measure)} of {subject.variant} over that of the baseline, same gains; "
                "below 1 (violet) compensation gains. Crossed red: it loses for certain, or has "
                "lost the armature; hatched grey: neither is certain, the 95 % confidence interval "
                "of the difference reaches zero; dotted: both overshoots are less than three times "
                "the rms of the standstill, there is nothing to gain. †: pathological iron, which "
                "hardly answers just after a reversal. The name in a square is that of the baseline "
                "there; lin. is linearised.",
            )
        )
    title = "Where compensation gains, and where not"
    return Section("benefit", title, (*blocks, *_more(subject, "benefit")))


def _gains(cells: Sequence[BenefitCell]) -> str:
    """Say how many cells of one map gain, how many lose, and the best of them."""
    gained = [cell for cell in cells if cell.outcome == "gain"]
    lost = sum(cell.outcome == "loss" for cell in cells)
    idle = sum(cell.outcome == "nothing to gain" for cell in cells)
    text = (
        f"{_sentence(cells[0].measure)} against {cells[0].against}: a certain gain in "
        f"{len(gained)} of {len(cells)} cells, a certain loss in {lost}, in {idle} there is "
        "nothing to gain"
    )
    if gained:
        best = min(gained, key=lambda cell: cell.ratio)
        share = "" if best.reversible is None else f"reversible fraction {best.reversible:g}, "
        text += (
            f"; at best {100.0 * (1.0 - best.ratio):.0f}{NBSP}% less than {best.baseline} (step of "
            f"{1e6 * best.height:g}{NBSP}µm, {share}loop width {100.0 * best.loop_width:.2g}{NBSP}%)"
        )
    return f"{text}."


def _tuning(subject: SimulationSubject) -> Section:
    blocks: list[Block] = []
    if subject.tuning is not None:
        blocks.append(
            _picture(
                figure_pareto(subject.tuning),
                "pareto",
                "Settling time against peak sensitivity of all gains that were tried, the fronts "
                f"and what was chosen: {', '.join(ordered(subject.tuning.chosen))}.",
                "Every mark is a set of gains, judged over all gaps, heights and loads at once; "
                "crosses miss another aim. The line is the front that no set of gains beats, the "
                "star what was chosen.",
            )
        )
    return Section("tuning", "Tuning", (*blocks, *_more(subject, "tuning")))


def _origin(subject: SimulationSubject) -> Section:
    rows: list[list[str | Cell]] = [
        [name, Cell(value[:16] + "…" if len(value) > 20 else value, code=True)]
        for name, value in subject.files.items()
    ]
    blocks: list[Block] = []
    if rows:
        blocks.append(table("Files", ["file", "SHA-256"], rows, texts=2))
    items = [f"Seed {subject.rig.settings.seed}; the same seed gives the same figures."]
    if subject.command:
        items.append(f"Made by: {subject.command}")
    blocks.append(Items("How to make it again", tuple(items)))
    return Section("origin", "Origin", tuple(blocks))
