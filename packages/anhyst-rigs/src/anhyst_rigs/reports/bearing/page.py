"""Write the report of a simulated bearing as a self-contained HTML page."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from anhyst.control.controller_file import ControllerTable
from anhyst.support.kinds import MethodName
from anhyst.support.page import NBSP, Block, Headline, Note, Picture, Section, Text, Tile, format_number
from anhyst.support.wording import capitalise
from anhyst_rigs.reports.bearing.block_diagram import figure_structure
from anhyst_rigs.reports.bearing.figures import (
    StepPanel,
    figure_bode,
    figure_force_current,
    figure_forces,
    figure_nyquist,
    figure_sensitivity,
    figure_standstill,
    figure_steps,
    figure_tracking,
)
from anhyst_rigs.reports.bearing.subject import (
    OVERSHOOT_METRIC,
    SETTLING,
    STANDSTILL_OF_STEP,
    SimulationSubject,
    benefit_table,
    experiment_tables,
    margin_table,
    metric_text,
    settling_sentence,
    standstill_tables,
    step_tables,
)
from anhyst_rigs.reports.study.page import (
    legend_table,
    origin_section,
    page_text,
    picture,
    sort_for_report,
    verdict_note,
)
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.study.bearing.linear import find_zone
from anhyst_rigs.study.bearing.responses import StepComparison, judge_steps
from anhyst_rigs.study.engine.table import Metric, strongest_baseline


def render(subject: SimulationSubject) -> str:
    """Return the text of the report; the same subject always gives the same text."""
    sections = (
        _step_section(subject),
        _force_section(subject),
        _loop_section(subject),
        _tracking_section(subject),
        _standstill_section(subject),
        _frequency_section(subject),
        structure_section(subject.rig, subject.controller, subject.all_variants),
        origin_section(subject.files, subject.command, subject.rig.settings.seed),
    )
    return page_text("Magnetic bearing", _headline(subject), sections)


def _headline(subject: SimulationSubject) -> Headline:
    plant = subject.rig.settings
    control = f"controller “{subject.controller.name}”, variant {subject.variant}"
    basis = (
        f"Simulated with {plant.timing.delay_ticks:g} tick of delay, DAC, ADC, sensor noise and a "
        f"supply of {plant.amplifier.supply_V:g}{NBSP}V"
    )
    if subject.steps:
        basis += f"; intervals are those of 95 % confidence over {subject.seeds} noise seeds"
    return Headline(
        title=plant.name,
        description=f"{plant_text(subject.rig)}; {control}.",
        basis=f"{basis}.",
        verdict=verdict_note(judge_steps(subject.steps, subject.variant)),
        notes=(*_loss_notes(subject), *subject.notes),
        tiles=tuple(_tiles(subject)),
        picture=_picture_of_steps("answer", subject.panels[-1:], subject.seeds) if subject.panels else None,
        comparison=benefit_table(subject),
        validity="These results apply only to this plant, its iron and these settings. The gain "
        "of compensation depends on loop width, reversible fraction and step height.",
    )


def plant_text(rig: BodyRig) -> str:
    """Return a short description of a bearing."""
    plant = rig.settings
    arrangement = "A pair of magnets" if plant.opposite is not None else "One magnet"
    return (
        f"{arrangement}, {plant.body.mass_kg:g}{NBSP}kg, {rig.static_load:g}{NBSP}N load, "
        f"{1e3 * plant.gap_m:g}{NBSP}mm gap, {plant.timing.rate_Hz:g} ticks a second"
    )


def _tiles(subject: SimulationSubject) -> Iterable[Tile]:
    """Yield overshoot, settling time and standstill of the largest step at the operating gap."""
    steps = [step for step in subject.steps if step.gap == subject.rig.settings.gap_m]
    for metric in (OVERSHOOT_METRIC, SETTLING, STANDSTILL_OF_STEP) if steps else ():
        step = max(steps, key=lambda step: step.height)
        interval = step.figure(metric.key).get(subject.variant)
        if interval is None or math.isnan(interval.mean):
            continue
        value = "never" if math.isinf(interval.mean) else format_number(metric.factor * interval.mean, 2)
        yield Tile(
            value if value == "never" else f"{value}{NBSP}{metric.unit}",
            f"{metric.title.lower()}, {1e6 * step.height:g}{NBSP}µm step",
            "; ".join(_comparison(step, subject.variant, metric)),
        )


def _comparison(step: StepComparison, variant: MethodName, metric: Metric) -> Iterable[str]:
    """Yield texts with a metric of a variant, of the strongest baseline, and of measured flux."""
    yield f"{variant}: {metric_text(step, variant, metric)}"
    baseline = strongest_baseline(step.figure(metric.key))
    if baseline not in (None, variant):
        yield f"best without hysteresis model ({baseline}): {metric_text(step, baseline, metric)}"
    if "flux" in step.cells and variant != "flux":
        yield f"measured flux: {metric_text(step, 'flux', metric)}"


def _loss_notes(subject: SimulationSubject) -> Iterable[Note]:
    """Yield a note about the runs that lost levitation."""
    runs = [
        f"{name} at {subject.step_text(step)}: {step_cell.lost} of {subject.seeds} runs"
        for step in subject.steps
        for name, step_cell in step.cells.items()
        if step_cell.lost
    ]
    if runs:
        text = f"{'; '.join(runs)}. A metric has no mean if one of its runs was lost."
        yield Note("bad", "Levitation lost", text)


def structure_section(
    rig: BodyRig, controller: ControllerTable, variants: Iterable[MethodName | None]
) -> Section:
    """Return the section with the block diagram and the variants."""
    caption = (
        "Structure of the simulation (the paper's Fig. 10) with the values of rig and controller "
        "file. Blue: the compiled program, as on a controller. Grey: the plant."
    )
    alt = (
        "Block diagram: controller, force to current, DAC and delay, amplifier, electrical "
        "subsystem, force-current hysteresis, mechanics with load drive, sensors back to the "
        "controller."
    )
    figure = figure_structure(rig, controller)
    return Section(
        "structure",
        "Structure and numbers",
        (
            picture(figure, "structure", alt, caption),
            legend_table(sort_for_report(variant for variant in variants if variant)),
        ),
    )


def _picture_of_steps(key: str, panels: Sequence[StepPanel], seeds: int) -> Picture:
    """Return the picture of one or more steps."""
    names = sort_for_report({name for panel in panels for name in panel.recordings})
    return picture(
        figure_steps(panels),
        key,
        f"Step responses, position against time, one panel per step: {', '.join(names)}.",
        "Step responses with and without compensation (the paper's Fig. 11), one run of "
        f"{seeds}; overshoot in the legends is the mean over all of them, in % of "
        "the height. The grey band is 2 % of the height. True position; upwards closes "
        "the gap. Below each, how far it is from the reference, enlarged. Above zero, it is "
        "beyond the reference.",
    )


def _step_section(subject: SimulationSubject) -> Section:
    blocks: list[Block] = (
        [_picture_of_steps("steps", subject.panels, subject.seeds)] if subject.panels else []
    )
    if sentence := settling_sentence(subject):
        blocks.append(Text(sentence))
    blocks += step_tables(subject)
    return Section("steps", "Step responses", tuple(blocks))


def _force_section(subject: SimulationSubject) -> Section:
    blocks: list[Block] = []
    if subject.forces:
        blocks.append(
            picture(
                figure_forces(subject.forces),
                "forces",
                "Demanded and true force over time and their difference, one column per variant: "
                f"{', '.join(sort_for_report(subject.forces))}.",
                "The force that the position controller demands and the force of the magnet. The "
                "difference includes hysteresis, the lag of the amplifier and the delay. With a "
                "constant ratio, it also includes the effect of the armature motion.",
            )
        )
    return Section("forces", "Demanded and true force", tuple(blocks))


def _loop_section(subject: SimulationSubject) -> Section | None:
    if not subject.run or not subject.measured_loops:
        return None
    gaps_m = sorted({loop.gap for loop in subject.measured_loops})
    gaps = " and ".join(f"{1e3 * gap:g}{NBSP}mm" for gap in gaps_m)
    figure = figure_force_current(subject.run, subject.measured_loops, subject.identified)
    return Section(
        "loops",
        "Force over current",
        (
            picture(
                figure,
                "loops",
                f"Force against current: measured loops at {gaps}, and the run: "
                f"{', '.join(sort_for_report(subject.run))}.",
                f"True force over true current of the run, over the loops measured at {gaps}, the "
                "nearest gaps, and the identified loop at the gap of the run. Below, the loops "
                "minus the single-valued curve of their gap: only hysteresis remains.",
            ),
        ),
    )


def _tracking_section(subject: SimulationSubject) -> Section:
    blocks: list[Block] = []
    for index, tracking in enumerate(subject.tracked):
        blocks.append(
            picture(
                figure_tracking(tracking.recordings, tracking.title),
                f"tracking{index}",
                f"{capitalise(tracking.title)}: position over time and its error, "
                f"{', '.join(sort_for_report(tracking.recordings))}.",
                f"{capitalise(tracking.title)}. True position; one run of {subject.seeds}.",
            )
        )
    if subject.experiments is not None:
        blocks += experiment_tables(subject.experiments)
    return Section("tracking", "Trajectories, load steps, recovery", tuple(blocks))


def _standstill_section(subject: SimulationSubject) -> Section:
    blocks: list[Block] = []
    if subject.standstill_runs:
        sensor = subject.rig.settings.gap_sensor
        noise, step = sensor.noise_m, sensor.resolution
        blocks.append(
            picture(
                figure_standstill(subject.standstill_runs),
                "standstill",
                "Position at a standstill over time, and its spectrum: "
                f"{', '.join(sort_for_report(subject.standstill_runs))}.",
                f"True position at standstill, with a sensor of {1e9 * noise:g}{NBSP}nm rms "
                f"and steps of {1e9 * step:g}{NBSP}nm ({sensor.kind}).",
            )
        )
    if subject.experiments is not None:
        blocks += standstill_tables(subject.experiments.standstill)
    return Section("standstill", "Standstill", tuple(blocks))


def _frequency_section(subject: SimulationSubject) -> Section:
    blocks: list[Block] = []
    if subject.sensitivity:
        peaks = [
            f"{name}: peak {curve.peak:.2f}, zone {find_zone(curve.peak)}"
            for name, curve in (
                (variant, subject.sensitivity[variant]) for variant in sort_for_report(subject.sensitivity)
            )
        ]
        blocks.append(Text(f"Measured sensitivity, ISO 14839-3. {'; '.join(peaks)}."))
        blocks.append(
            picture(
                figure_sensitivity(subject.sensitivity, subject.linear_sensitivity),
                "sensitivity",
                "Sensitivity over frequency, measured by injection of a sine into the running "
                f"nonlinear loop, with the zones A to D: {', '.join(sort_for_report(subject.sensitivity))}",
                "Signal of the controller over the injected one, a stepped sine in the running "
                "nonlinear loop; dotted: linearised. Zones of ISO 14839-3: A up to 3 (9.5 dB), "
                "B up to 4 (12 dB), C up to 5 (14 dB).",
            )
        )
    if subject.loop_gain:
        names = ", ".join(sort_for_report(subject.loop_gain))
        blocks.append(
            picture(
                figure_bode(subject.loop_gain),
                "bode",
                f"Bode plot of the linearised loop gain, magnitude and phase: {names}.",
                "Loop gain of the loop linearised at the operating point, delay, amplifier and "
                "sensor included. A variant with a model is shown as if it knew the static "
                "slopes and cancelled them exactly. Then hysteresis has no effect, and all these "
                "variants have the same loop. Margins are given only for constants. The magnet itself "
                "is unstable, so that the gain must be above 1 at low frequencies.",
            )
        )
        blocks.append(
            picture(
                figure_nyquist(subject.loop_gain),
                "nyquist",
                f"Nyquist plot of the linearised loop gain around the critical point: {names}.",
                "The same in the complex plane; inside the red circle around -1, the sensitivity "
                "is beyond zone A.",
            )
        )
    if subject.margins:
        blocks.append(margin_table(subject.margins))
    title = "Sensitivity, Bode and Nyquist plots"
    return Section("frequency", title, tuple(blocks))
