"""Draw the block diagram of the simulated loop with its actual values (paper, Fig. 10)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from anhyst.control.controller_file import ControllerTable
from anhyst.support.figures import FALLING_COLOUR, RISING_COLOUR, use_report_style
from anhyst.support.kinds import FLUX_PROBE_METHODS, METHOD_TITLES
from anhyst.support.page import format_number
from anhyst_rigs.reports.study.page import (
    BOX_HEIGHT_IN,
    BOX_WIDTH_IN,
    PLANT_FILL,
    SOFTWARE_FILL,
    DiagramBlock,
    draw_arrow,
    draw_box,
    draw_label,
    new_diagram,
)
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.file import RigFile

FORMATS = {"f64": "64-bit floating point", "f32": "32-bit floating point", "fixed": "fixed point"}


def diagram_blocks(rig: BodyRig, controller: ControllerTable) -> Mapping[str, DiagramBlock]:
    """Return the content of each block of the loop."""
    plant = rig.settings
    return {
        "controller": _controller_block(controller),
        "compensator": _compensator_block(controller),
        "output": _output_block(rig),
        "amplifier": _amplifier_block(plant),
        "electrical": _electrical_block(plant),
        "hysteresis": _hysteresis_block(plant),
        "mechanics": _mechanics_block(plant),
        "sensors": _sensors_block(plant, controller),
        "load": _load_block(plant),
    }


def compensator_inputs(controller: ControllerTable) -> str:
    """Return the inputs that the compensator has in addition to the demanded force."""
    inputs = ["gap"]
    if controller.compensation.applied == "measured":
        inputs.append("current")
    if controller.compensation.variant in FLUX_PROBE_METHODS:
        inputs.append("flux density")
    return ", ".join(inputs)


def _controller_block(settings: ControllerTable) -> DiagramBlock:
    gains = settings.pidd2_gains()
    lines = [
        f"K_p {_format_gain(gains.K_p)} N/m",
        f"K_i {_format_gain(gains.K_i)} N/(m s)",
        f"K_d {_format_gain(gains.K_d)} N s/m",
        f"K_dd {_format_gain(gains.K_dd)} N s²/m, weight {settings.set_point_weight:.3g}",
        f"derivatives below {_format_frequency(settings.filter.cutoff_Hz)}",
    ]
    if settings.filter.cutoff_2_Hz != settings.filter.cutoff_Hz and gains.K_dd:
        lines[-1] += f", {_format_frequency(settings.filter.cutoff_2_Hz)}"
    return DiagramBlock("controller PIDD²", tuple(lines))


def _compensator_block(settings: ControllerTable) -> DiagramBlock:
    limits, compensation = settings.limits, settings.compensation
    return DiagramBlock(
        "force to current",
        (
            *METHOD_TITLES[compensation.variant].split(", "),
            FORMATS[compensation.format],
            f"{limits.force_low_N:g} to {limits.force_high_N:g} N",
            f"{limits.current_low_A:g} to {limits.current_high_A:g} A",
            f"commits the {compensation.applied} current",
        ),
    )


def _output_block(rig: BodyRig) -> DiagramBlock:
    timing, amplifier = rig.settings.timing, rig.settings.amplifier
    current_range = amplifier.current_high_A - amplifier.current_low_A
    step = current_range / ((1 << amplifier.dac_bits) - 1)
    return DiagramBlock(
        "DAC and delay",
        (
            f"{_format_frequency(timing.rate_Hz)}, tick {1e6 * rig.dt:g} µs",
            f"sample to output: {timing.delay_ticks:g} tick{'s' * (timing.delay_ticks != 1.0)}",
            f"{amplifier.dac_bits} bits, {1e6 * step:.0f} µA a step",
        ),
    )


def _amplifier_block(plant: RigFile) -> DiagramBlock:
    amplifier = plant.amplifier
    loop = "current loop" if amplifier.mode == "current" else "voltage mode"
    lines = [
        f"{loop}, {_format_frequency(amplifier.bandwidth_Hz)}",
        f"supply ±{amplifier.supply:g} V",
        f"{amplifier.current_low_A:g} to {amplifier.current_high_A:g} A",
    ]
    if amplifier.delay_s:
        lines.append(f"delay {1e6 * amplifier.delay_s:g} µs")
    return DiagramBlock(f"amplifier{_count_text(plant)}", tuple(lines))


def _electrical_block(plant: RigFile) -> DiagramBlock:
    magnet = plant.magnet
    lines = [
        f"{magnet.turns} turns, {magnet.poles.resistance:.3g} Ω",
        "flux linkage ψ(i, gap) " + ("of the iron" if magnet.flux_table is None else "from a table"),
        "u = R·i + dψ/dt, by",
        "current and by motion",
    ]
    if magnet.eddy_time_s:
        lines.append(f"eddy currents {1e6 * magnet.eddy_time_s:g} µs")
    return DiagramBlock(f"electrical subsystem{_count_text(plant)}", tuple(lines))


def _hysteresis_block(plant: RigFile) -> DiagramBlock:
    magnet, poles = plant.magnet, plant.magnet.poles
    pole = f"pole {1e3 * poles.width:.3g} × {1e3 * poles.depth:.3g} mm"
    if magnet.model is not None:
        lines = ["identified Jiles-Atherton law", magnet.model, pole]
    else:
        lines = [*plant.steel.diagram_texts(), pole]
    if plant.gap_total_m is not None:
        lines.append(f"bias {plant.bias_N:g} N, gaps {1e3 * plant.gap_total_m:g} mm")
    return DiagramBlock(f"force-current hysteresis{_count_text(plant)}", tuple(lines))


def _mechanics_block(plant: RigFile) -> DiagramBlock:
    mechanics = plant.body
    stop_low_mm, stop_high_mm = 1e3 * mechanics.stop_low_m, 1e3 * mechanics.stop_high_m
    lines = [f"mass {mechanics.mass_kg:g} kg", f"stops at {stop_low_mm:g} and {stop_high_mm:g} mm"]
    if mechanics.damping_N_s_per_m:
        lines.append(f"guide {mechanics.damping_N_s_per_m:g} N s/m")
    if mechanics.gravity_m_per_s2:
        lines.append(f"gravity {mechanics.gravity_m_per_s2:g} m/s²")
    lines.append(f"operates at {1e3 * plant.gap_m:g} mm")
    return DiagramBlock("mechanics", tuple(lines))


def _sensors_block(plant: RigFile, controller: ControllerTable) -> DiagramBlock:
    gap_sensor, current_sensor = plant.gap_sensor, plant.current_sensor
    lines = [
        f"{gap_sensor.kind}: step {_format_length(gap_sensor.resolution)}",
        f"noise {_format_length(gap_sensor.noise_m)} rms, {_format_frequency(gap_sensor.bandwidth_Hz)}",
    ]
    if gap_sensor.delay_s:
        lines.append(f"delay {1e6 * gap_sensor.delay_s:g} µs")
    lines.append(f"current: {current_sensor.adc_bits} bits, {1e3 * current_sensor.noise_A:g} mA rms")
    if controller.compensation.variant in FLUX_PROBE_METHODS and plant.hall_probe is not None:
        hall_probe = plant.hall_probe
        lines.append(f"Hall: {hall_probe.adc_bits} bits, {1e3 * hall_probe.noise_T:g} mT rms")
    return DiagramBlock("sensors", tuple(lines))


def _load_block(plant: RigFile) -> DiagramBlock:
    load = plant.load
    lines = [f"{load.force_N:g} N, {_format_frequency(load.bandwidth_Hz)}"]
    if load.stiffness_N_per_m or load.damping_N_s_per_m:
        lines.append(f"{_format_gain(load.stiffness_N_per_m)} N/m, {load.damping_N_s_per_m:g} N s/m")
    lines.append(f"encoder {_format_length(load.encoder_step_m)}")
    for disturbance in plant.load.disturbance[:1]:
        more_text = f" and {len(load.disturbance) - 1} more" if len(load.disturbance) > 1 else ""
        lines.append(f"{disturbance.kind} of {disturbance.force_N:g} N{more_text}")
    return DiagramBlock("load drive", tuple(lines))


def _count_text(plant: RigFile) -> str:
    return " × 2" if plant.opposite is not None else ""


def _format_gain(value: float) -> str:
    """Return a gain as text; very large and very small gains are written with a power of ten."""
    if value == 0.0:
        return "0"
    power = 3 * math.floor(math.log10(abs(value)) / 3.0)
    if 1e-2 <= abs(value) < 1e5:
        return format_number(value, 4, is_short=True)
    superscripts = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")
    return f"{format_number(value / 10.0**power, 3, is_short=True)}·10{str(power).translate(superscripts)}"


def _format_frequency(value: float) -> str:
    return f"{value / 1e3:.4g} kHz" if value >= 1e3 else f"{value:.4g} Hz"


def _format_length(value: float) -> str:
    return f"{1e9 * value:.3g} nm" if value < 1e-6 else f"{1e6 * value:.3g} µm"


_BOX_GAP_IN = 0.46
_LEFT_EDGE_IN = 0.62
_TOP_ROW_IN = 3.95
_MIDDLE_ROW_IN = 1.95
_LOW_ROW_IN = 0.56
_LOAD_HEIGHT_IN = 0.96
_FIGURE_SIZE_IN = (_LEFT_EDGE_IN + 4 * BOX_WIDTH_IN + 3 * _BOX_GAP_IN + 0.5, 4.8)


@use_report_style
def figure_structure(rig: BodyRig, controller: ControllerTable) -> Figure:
    """Draw the control loop, with the controller above, and the magnet and the armature below."""
    figure, ax = new_diagram(*_FIGURE_SIZE_IN)
    blocks = diagram_blocks(rig, controller)
    columns = [
        _LEFT_EDGE_IN + 0.5 * BOX_WIDTH_IN + index * (BOX_WIDTH_IN + _BOX_GAP_IN) for index in range(4)
    ]
    upper_blocks = ("controller", "compensator", "output", "amplifier")
    lower_blocks = ("sensors", "mechanics", "hysteresis", "electrical")
    for x, name in zip(columns, upper_blocks, strict=True):
        draw_box(
            ax,
            (x, _TOP_ROW_IN),
            name,
            blocks[name],
            SOFTWARE_FILL if name in upper_blocks[:2] else PLANT_FILL,
        )
    for x, name in zip(columns, lower_blocks, strict=True):
        draw_box(ax, (x, _MIDDLE_ROW_IN), name, blocks[name], PLANT_FILL)
    draw_box(ax, (columns[0], _LOW_ROW_IN), "load", blocks["load"], PLANT_FILL, _LOAD_HEIGHT_IN)
    _draw_signals(ax, columns, compensator_inputs(controller))
    return figure


def _draw_signals(ax: Axes, columns: Sequence[float], inputs: str) -> None:
    """Draw the signals between the blocks."""
    half_width, half_height = 0.5 * BOX_WIDTH_IN, 0.5 * BOX_HEIGHT_IN
    for index, name in enumerate(("F demand", "i demand", "i ref")):
        x = columns[index] + half_width
        draw_arrow(ax, [(x, _TOP_ROW_IN), (x + _BOX_GAP_IN, _TOP_ROW_IN)])
        draw_label(ax, (x + 0.5 * _BOX_GAP_IN, _TOP_ROW_IN + 0.08), name.replace(" ", "\n"))
    draw_arrow(ax, [(columns[3], _TOP_ROW_IN - half_height), (columns[3], _MIDDLE_ROW_IN + half_height)])
    draw_label(ax, (columns[3] + 0.08, 0.5 * (_TOP_ROW_IN + _MIDDLE_ROW_IN)), "voltage u", "left", "center")
    for index, name in ((3, "i, ψ"), (2, "force"), (1, "gap")):
        x = columns[index] - half_width
        draw_arrow(
            ax,
            [(x, _MIDDLE_ROW_IN), (x - _BOX_GAP_IN, _MIDDLE_ROW_IN)],
            FALLING_COLOUR if index == 2 else RISING_COLOUR,
        )
        draw_label(ax, (x - 0.5 * _BOX_GAP_IN, _MIDDLE_ROW_IN + 0.08), name)
    # The reference comes from the left, and the measured gap from below.
    draw_arrow(ax, [(0.06, _TOP_ROW_IN), (_LEFT_EDGE_IN, _TOP_ROW_IN)])
    draw_label(ax, (0.5 * _LEFT_EDGE_IN, _TOP_ROW_IN + 0.08), "gap\ndemand")
    draw_arrow(ax, [(columns[0], _MIDDLE_ROW_IN + half_height), (columns[0], _TOP_ROW_IN - half_height)])
    draw_label(
        ax, (columns[0] - 0.08, 0.5 * (_TOP_ROW_IN + _MIDDLE_ROW_IN)), "measured gap", "right", "center"
    )
    line_y = 0.5 * (_TOP_ROW_IN + _MIDDLE_ROW_IN)
    draw_arrow(ax, [(columns[0], line_y), (columns[1], line_y), (columns[1], _TOP_ROW_IN - half_height)])
    ax.add_patch(Circle((columns[0], line_y), 0.035, fc=RISING_COLOUR, ec=RISING_COLOUR))
    draw_label(ax, (0.5 * (columns[0] + columns[1]), line_y + 0.05), inputs)
    _draw_load_and_gap(ax, columns)


def _draw_load_and_gap(ax: Axes, columns: Sequence[float]) -> None:
    """Draw the load and the moving gap, below the plant."""
    half_width, bottom = 0.5 * BOX_WIDTH_IN, _MIDDLE_ROW_IN - 0.5 * BOX_HEIGHT_IN
    load_x = columns[1] - 0.5 * half_width
    draw_arrow(
        ax, [(columns[0] + half_width, _LOW_ROW_IN), (load_x, _LOW_ROW_IN), (load_x, bottom)], FALLING_COLOUR
    )
    draw_label(ax, (0.5 * (columns[0] + half_width + load_x), _LOW_ROW_IN + 0.05), "load")
    start, line_y = columns[1] + 0.5 * half_width, 0.5 * (_LOW_ROW_IN + bottom)
    ax.plot([start, start], [bottom, line_y], color=RISING_COLOUR, lw=1.3)
    draw_arrow(ax, [(start, line_y), (columns[3], line_y), (columns[3], bottom)])
    draw_arrow(ax, [(columns[2], line_y), (columns[2], bottom)])
    ax.add_patch(Circle((columns[2], line_y), 0.035, fc=RISING_COLOUR, ec=RISING_COLOUR))
    draw_label(ax, (0.5 * (columns[2] + columns[3]), line_y + 0.05), "gap and its velocity")
