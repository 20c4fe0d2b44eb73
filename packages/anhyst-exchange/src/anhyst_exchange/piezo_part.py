"""A simulated piezo stage as a component: the plant of ``anhyst simulate`` and its controller."""

from __future__ import annotations

import math

from anhyst.compilation.toolchain import KIND_SOURCES, core_files
from anhyst.support.atomic import PathLike
from anhyst_exchange.bearing_part import c_initialiser, plant_sources
from anhyst_exchange.part import (
    WRAPPER_FOLDER,
    Part,
    Variable,
    c_array_literal,
    header_text,
    kernel_expression,
)
from anhyst_exchange.stage_part import biquad_initialiser
from anhyst_rigs.rig.piezo import PiezoControllerArguments, PiezoRig, controller_arguments, read_piezo_rig
from anhyst_rigs.rig.stage.loop import parameter_block
from anhyst_rigs.study.piezo import find_inverses

_PIEZO_CORE_FILES = (
    "numeric/elementary.c",
    *(name for kind in ("full", "cells") for name in KIND_SOURCES[kind]),
    *(f"compensator/{name}.c" for name in ("map", "force_controller")),
    *(
        f"compensator/{name}_f64.c"
        for name in ("force_coded", "force_controller", "map", "block", "compensator")
    ),
    *("control/biquad_f64.c", "control/tracking.c"),
)
"""C files of the core that a piezo stage and its controller need."""


def piezo_part(rig_path: PathLike) -> Part:
    """Return a piezo stage with its controller as a component.

    The input is the demanded displacement; the outputs are the position and the voltage. The
    component runs at the rate of the controller. The inverse model comes from simulated loops of
    the stage.
    """
    rig = read_piezo_rig(rig_path)
    inverse_model = find_inverses(rig)["full"]
    parameters = parameter_block(inverse_model)
    sources = {
        name: text.encode() for name, text in core_files(_PIEZO_CORE_FILES, parameters.memory_count).items()
    }
    sources |= plant_sources("^(?!.*piezo)")
    sources["piezo.c"] = (WRAPPER_FOLDER / "piezo.c").read_bytes()
    compensator = {
        "PIEZO_KERNEL": kernel_expression(f"anhyst_kernel_{parameters.kind}", "words"),
        "PIEZO_WORDS": c_initialiser(parameters.words.tolist()),
    }
    macros = compensator | _piezo_macros(rig, controller_arguments(rig, inverse_model))
    sources["piezo_numbers.h"] = header_text("piezo_numbers", macros).encode()
    title, rate = rig.settings.name, rig.settings.timing.rate_Hz
    text = f"{title}, piezo stage controlled by feedforward and integrator, full in fixed point"
    return Part(title, text, rate, _piezo_variables(rig, inverse_model.scales.demand), sources)


def _piezo_macros(rig: PiezoRig, controller: PiezoControllerArguments) -> dict[str, object]:
    """Return the parameters of the stage and the controller."""
    stack = rig.settings.stack
    filters, settings = (
        [biquad_initialiser(coefficients.tolist()) for coefficients in controller["filters"]],
        controller["settings"],
    )
    stage = {
        **rig.plant_parameters(rig.dt),
        "creep_time": c_array_literal(stack.creep_times_s),
        "creep_share": c_array_literal(stack.creep_shares),
        "creeps": len(stack.creep_times_s),
    }
    control_law = {
        "pid": biquad_initialiser(controller["pid"].tolist()),
        **{name: settings[f"current_{name}"] for name in ("low", "high", "step")},
        "filter": "filters",
        "filters": len(filters),
    }
    scales = ("demand_full", "current_full", "flux_full", "gap_low", "gap_high")
    return {
        "PIEZO_STAGE": c_initialiser(stage),
        "PIEZO_FILTER_COUNT": len(filters),
        "PIEZO_FILTERS": c_initialiser(filters),
        "PIEZO_SETTINGS": c_initialiser(control_law),
        "PIEZO_CODES": c_array_literal(settings[name] for name in scales),
        "PIEZO_SENSOR_STEP": repr(rig.settings.position_sensor.step_m),
        "PIEZO_TICK_S": repr(rig.dt),
        "PIEZO_LATENESS_S": repr(float(rig.response_delay)),
        "PIEZO_LATE_TICKS": math.ceil(rig.response_delay / rig.dt) + 2,
    }


def _piezo_variables(rig: PiezoRig, max_displacement: float) -> list[Variable]:
    low = rig.settings.displacement_case.low_m
    return [
        Variable("reference_m", "input", "m", "demanded displacement", low, 0.0, max_displacement),
        Variable("load_m", "input", "m", "load, as the displacement that it causes at rest"),
        Variable("position_noise_m", "input", "m", "noise that is added to the position reading"),
        Variable("position_m", "output", "m", "true position"),
        Variable("position_read_m", "output", "m", "reading of the sensor at the last tick"),
        Variable("expected_m", "output", "m", "delayed reference that the reading should equal"),
        Variable("error_m", "output", "m", "true position minus the delayed reference"),
        Variable("demand_m", "output", "m", "displacement demanded from the stack: corrected reference"),
        Variable("voltage_V", "output", "V", "reference of the amplifier, from the next tick on"),
        Variable("stack_voltage_V", "output", "V", "voltage at the stack"),
        Variable("velocity_m_per_s", "output", "m/s", "velocity of the stage"),
        Variable("hysteresis_m", "output", "m", "shortening of the stack by hysteresis"),
        Variable("creep_m", "output", "m", "lengthening of the stack by creep"),
    ]
