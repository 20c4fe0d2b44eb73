"""A whole virtual piezo stage as a component: the stage of ``anhyst simulate`` and its controller."""

from __future__ import annotations

import math

from anhyst.compilation.toolchain import SOURCES, core_files
from anhyst.support.atomic import PathLike
from anhyst_exchange.bearing_part import fields, plant_sources
from anhyst_exchange.part import WRAPPER, Part, Variable, header, kernel_of, row
from anhyst_exchange.stage_part import biquad
from anhyst_rigs.rig.piezo import ControllerNumbers, PiezoRig, controller_numbers, read_piezo_rig
from anhyst_rigs.rig.stage.loop import block_of
from anhyst_rigs.study.piezo import find_inverses

_CORE = (
    "numeric/elementary.c",
    *(name for kind in ("full", "cells") for name in SOURCES[kind]),
    *(f"compensator/{name}.c" for name in ("map", "force_controller")),
    *(
        f"compensator/{name}_f64.c"
        for name in ("force_coded", "force_controller", "map", "block", "compensator")
    ),
    *("control/biquad_f64.c", "control/tracking.c"),
)
"""What a piezo stage and its controller name."""


def piezo_part(rig_path: PathLike) -> Part:
    """Return a piezo stage with its controller: wanted displacement in; position, voltage out.

    It ticks at the rate of the controller, whose inverse is that of a model of the stage's loops.
    """
    rig = read_piezo_rig(rig_path)
    inverse = find_inverses(rig)["full"]
    block = block_of(inverse)
    sources = {name: text.encode() for name, text in core_files(_CORE, block.memories).items()}
    sources |= plant_sources("^(?!.*piezo)")
    sources["piezo.c"] = (WRAPPER / "piezo.c").read_bytes()
    compensator = {
        "PIEZO_KERNEL": kernel_of(f"anhyst_kernel_{block.kind}", "words"),
        "PIEZO_WORDS": fields(block.words.tolist()),
    }
    numbers = compensator | _numbers(rig, controller_numbers(rig, inverse))
    sources["piezo_numbers.h"] = header("piezo_numbers", numbers).encode()
    title, rate = rig.settings.name, rig.settings.timing.rate_Hz
    text = f"{title}, piezo stage led by feedforward and integrator, full in fixed point"
    return Part(title, text, rate, _variables(rig, inverse.scales.demand), sources)


def _numbers(rig: PiezoRig, controller: ControllerNumbers) -> dict[str, object]:
    """Return stage and controller as structures."""
    stack = rig.settings.stack
    filters, settings = (
        [biquad(one.tolist()) for one in controller["filters"]],
        controller["settings"],
    )
    stage = {
        **rig.numbers(rig.dt),
        "creep_time": row(stack.creep_times_s),
        "creep_share": row(stack.creep_shares),
        "creeps": len(stack.creep_times_s),
    }
    law = {
        "pid": biquad(controller["pid"].tolist()),
        **{name: settings[f"current_{name}"] for name in ("low", "high", "step")},
        "filter": "filters",
        "filters": len(filters),
    }
    scales = ("demand_full", "current_full", "flux_full", "gap_low", "gap_high")
    return {
        "PIEZO_STAGE": fields(stage),
        "PIEZO_FILTER_COUNT": len(filters),
        "PIEZO_FILTERS": fields(filters),
        "PIEZO_SETTINGS": fields(law),
        "PIEZO_CODES": row(settings[name] for name in scales),
        "PIEZO_SENSOR_STEP": repr(rig.settings.position_sensor.step_m),
        "PIEZO_TICK_S": repr(rig.dt),
        "PIEZO_LATENESS_S": repr(float(rig.lateness)),
        "PIEZO_LATE_TICKS": math.ceil(rig.lateness / rig.dt) + 2,
    }


def _variables(rig: PiezoRig, reach: float) -> list[Variable]:
    low = rig.settings.moved.low_m
    return [
        Variable("reference_m", "input", "m", "wanted displacement", low, 0.0, reach),
        Variable("load_m", "input", "m", "load, by how far it would move the stage at rest"),
        Variable("position_noise_m", "input", "m", "added to the position that is read"),
        Variable("position_m", "output", "m", "true position"),
        Variable("position_read_m", "output", "m", "as the sensor said at the last tick"),
        Variable("expected_m", "output", "m", "what of the reference should have shown there"),
        Variable("error_m", "output", "m", "true position there less what should have shown"),
        Variable("demand_m", "output", "m", "displacement asked of the stack: corrected reference"),
        Variable("voltage_V", "output", "V", "asked of the amplifier, from the next tick on"),
        Variable("stack_voltage_V", "output", "V", "at the stack"),
        Variable("velocity_m_per_s", "output", "m/s", "of the stage"),
        Variable("hysteresis_m", "output", "m", "by which hysteresis shortens the stack"),
        Variable("creep_m", "output", "m", "by which creep has lengthened it"),
    ]
