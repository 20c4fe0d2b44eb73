"""Write the C files, build files and guide of an output folder from templates."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from anhyst.compensate.plan import Plan
from anhyst.compilation.controller import ControllerPlan, controller_template_values
from anhyst.compilation.manifest import controller_bytes, state_bytes
from anhyst.compilation.parameters import align_comments, define_parameters, float_literal, scales_initialiser
from anhyst.compilation.toolchain import (
    CONTROL_SOURCES,
    KIND_SOURCES,
    KIND_SOURCES_F32,
    MONITOR_SOURCES,
    MONITOR_SOURCES_F32,
    SOURCE_FOLDER,
    core_files,
    read_core,
)
from anhyst.support.block_words import SignalUnits
from anhyst.support.units import Quantity

PORT_HEADER = "port/anhyst_port_cortex_m4.h"
C_TYPES = {"q15": "int16_t", "q31": "int32_t", "f32": "float"}
CODE_OF_ONE = {"q15": 2**15, "q31": 2**31, "f32": 1}


def make_sources(
    plan: Plan,
    values: Mapping[str, object],
    accuracy: Mapping[str, str],
    signals: Sequence[str],
    controller: ControllerPlan | None = None,
) -> dict[str, str]:
    """Return the C files and build files; `values` is the result of :func:`example_values`."""
    is_float = not plan.block.is_fixed
    core_sources = (KIND_SOURCES_F32 if is_float else KIND_SOURCES)[plan.block.kind] + (
        CONTROL_SOURCES if controller else ()
    )
    core_sources += MONITOR_SOURCES_F32 if is_float else MONITOR_SOURCES
    source_stems = ("parameters",) if controller is None else ("parameters", "controller")
    common_values = dict(values) | {
        "core": sorted(f"{SOURCE_FOLDER}/{name}" for name in core_sources),
        "own": [f"{plan.name}_{source_stem}.c" for source_stem in source_stems],
    }
    parameters = common_values | _parameter_values(plan, signals)
    files = core_files(core_sources, plan.block.memory_count) | {
        f"{plan.name}_parameters.h": render("parameters.h.j2", parameters),
        f"{plan.name}_parameters.c": render("parameters.c.j2", parameters),
        "main.c": render("main.c.j2", common_values),
        "example/interrupt.c": render("interrupt.c.j2", parameters),
        "anhyst.mk": render("anhyst.mk.j2", common_values),
        "anhyst.cmake": render("anhyst.cmake.j2", common_values),
    }
    guide_values = common_values | _guide_values(plan, signals) | dict(accuracy)
    if controller is not None:
        files |= _controller_files(common_values, plan.name, controller)
        guide_values |= controller_template_values(controller, plan.name) | {
            "controller_bytes": controller_bytes(controller.magnets, controller.block)
        }
    files["DROP_IN.md"] = render("DROP_IN.md.j2", guide_values)
    return files if is_float else {**files, PORT_HEADER: read_core(PORT_HEADER)}


def example_values(
    plan: Plan, sha256: str, version: str, controller: ControllerPlan | None
) -> dict[str, object]:
    """Return the values for all templates: names, and the calls of an example."""
    model, block, io = plan.model, plan.block, plan.request.io
    return {
        "name": plan.name,
        "macro": plan.name.upper(),
        "control": controller is not None,
        "kind": block.kind,
        "version": version,
        "model": escape_comment(model.name),
        "sha256": sha256,
        "io": io,
        "real": not block.is_fixed,
        "port": block.is_fixed,
        "word": block.c_type,
        "parameters_bytes": block.size,
        "memories": block.memory_count,
        "input": model.input.words,
        "output": model.output.words,
        "type": C_TYPES[io],
        "one": CODE_OF_ONE[io],
        **_init_values(plan.name, not block.is_fixed),
    }


def _init_values(name: str, is_float: bool) -> dict[str, object]:
    """Return the state type and the init call of the example."""
    suffix = "_f32" if is_float else ""
    arguments = (
        f"&compensator, &{name.upper()}_KERNEL, {name}_parameters,\n"
        f"{' ' * (33 + len(suffix))}{name.upper()}_PARAMETERS_WORDS"
    )
    return {
        "state": f"anhyst_compensator{suffix}",
        "calls": "anhyst_compensator",
        "init": f"anhyst_compensator_init{suffix}({arguments})",
        "play": False,
    }


def _controller_files(
    common_values: Mapping[str, object], name: str, controller: ControllerPlan
) -> dict[str, str]:
    """Return the files of the position controller; its example replaces that of the compensator."""
    values = dict(common_values) | controller_template_values(controller, name)
    values["controller"] = escape_comment(str(values["controller"]))
    return {
        f"{name}_controller.h": render("controller.h.j2", values),
        f"{name}_controller.c": render("controller.c.j2", values),
        "main.c": render("main_controller.c.j2", values),
    }


def _parameter_values(plan: Plan, signals: Sequence[str]) -> dict[str, object]:
    """Return the additional values for the templates of the parameters."""
    model, block = plan.model, plan.block
    names = SignalUnits(model.output.unit, model.input.unit)
    values: dict[str, object] = {
        "signals": signals,
        "limits": limit_lines(plan),
        "layered": block.memory_count > 1,
        "rate": f"{plan.request.rate:.10g}",
    }
    words = f"{plan.name.upper()}_PARAMETERS_WORDS"
    return values | {
        "kernel": f"anhyst_kernel_{block.kind}{'' if block.is_fixed else '_f32'}",
        "defines": _scale_macros(plan),
        "scales": scales_initialiser(block),
        "definition": define_parameters(plan.name, words, block, names, model.schedule),
        "words": block.words.size,
    }


def _guide_values(plan: Plan, signals: Sequence[str]) -> dict[str, object]:
    """Return the additional values for the drop-in guide."""
    start, io = plan.start_up, plan.request.io
    cycles = start.conditioning.cycles
    rows = [line.partition(" ") for line in signals]
    return {
        "rate": f"{plan.request.rate:.10g}",
        "bits": 16 if io == "q15" else 32,
        "signals": [(name, text.strip()) for name, _, text in rows],
        "scale_name": f"{plan.name.upper()}_FULL_SCALE_DEMAND_{_unit_suffix(plan.model.output)}",
        "unit": plan.model.output.unit,
        "layered": plan.block.memory_count > 1,
        "condition": (
            f"{cycles} triangle{'s' * (cycles > 1)} of current between its limits, {start.seconds:g} s"
        ),
        "remaining": f"{100.0 * start.remaining_difference / plan.reference_output:.2g}",
        "state_bytes": state_bytes(plan.block),
    }


def render(template: str, values: Mapping[str, object]) -> str:
    """Render a template of this package."""
    return _environment().get_template(template).render(values)


@cache
def _environment() -> Environment:
    return Environment(
        loader=FileSystemLoader(Path(__file__).parent / "templates"),
        autoescape=False,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )


def escape_comment(text: str) -> str:
    """Return a text that cannot end a comment or a line."""
    return re.sub(r"[^ -~]|\*/|/\*", "?", text)


def signal_lines(plan: Plan) -> list[str]:
    """Return a line about the codes of each signal."""
    model, scales, limits = plan.model, plan.block.scales, plan.block.limits
    if plan.request.io == "f32":
        return _float_signal_lines(plan)
    lines = [
        f"demand   1.0 is {_value_text(scales.demand, model.output)}; limited to "
        f"{_value_text(limits.demand[0], model.output)} to {_value_text(limits.demand[1], model.output)}",
        f"current  1.0 is {_value_text(scales.current, model.input)}; limited to "
        f"{_value_text(limits.current[0], model.input)} to {_value_text(limits.current[1], model.input)}",
    ]
    if model.schedule is not None and scales.gap_high > scales.gap_low:
        lines.append(
            f"gap      0 is {_value_text(scales.gap_low, model.schedule)}, 1.0 is "
            f"{_value_text(scales.gap_high, model.schedule)}; limited to this range"
        )
    else:
        lines.append("gap      not used: pass 0")
    return lines


def limit_lines(plan: Plan) -> list[str]:
    """Return a line with the macros of the limits of demand, current and gap."""
    model, block, macro = plan.model, plan.block, plan.name.upper()
    scales, limits, io = block.scales, block.limits, plan.request.io
    gap = scales.gap_low, scales.gap_high
    rows = [("DEMAND", limits.demand, 0.0, scales.demand, model.output)]
    rows += [("CURRENT", limits.current, 0.0, scales.current, model.input)]
    if model.schedule is not None:
        rows += [("GAP", gap, gap[0], (gap[1] - gap[0]) or 1.0, model.schedule)]

    def write_limit(value: float, zero_value: float, scale: float) -> str:
        if io == "f32":
            return float_literal(value)
        code_of_one = CODE_OF_ONE[io]
        code = code_of_one // 32768 * round((value - zero_value) / scale * 32768.0)
        return f"({code})" if code < 0 else f"{min(code, code_of_one - 1)}"

    texts = [
        (f"#define {macro}_{name}_{end} {write_limit(value, origin, scale)}", _value_text(value, quantity))
        for name, ends, origin, scale, quantity in rows
        for end, value in zip(("MIN", "MAX"), ends, strict=True)
    ]
    if model.schedule is None:
        number = "0.0f" if io == "f32" else "0"
        texts += [(f"#define {macro}_GAP_{end} {number}", "not used") for end in ("MIN", "MAX")]
    return align_comments(texts)


def _float_signal_lines(plan: Plan) -> list[str]:
    model, scales, limits = plan.model, plan.block.scales, plan.block.limits
    lines = [
        f"demand   in {model.output.unit}, limited to {limits.demand[0]:.6g} to {limits.demand[1]:.6g}",
        f"current  in {model.input.unit}, limited to {limits.current[0]:.6g} to {limits.current[1]:.6g}",
    ]
    if model.schedule is not None and model.needs_schedule:
        lines.append(
            f"gap      in {model.schedule.unit}, from {scales.gap_low:.6g} to "
            f"{scales.gap_high:.6g}; limited to this range"
        )
    else:
        lines.append("gap      not used: pass 0")
    return lines


def _value_text(value: float, quantity: Quantity) -> str:
    return f"{1e3 * value:.6g} mm" if quantity.unit == "m" else f"{value:.6g} {quantity.unit}"


def _scale_macros(plan: Plan) -> list[str]:
    """Return the macros with SI values, one per line."""
    model, scales, macro = plan.model, plan.block.scales, plan.name.upper()
    rows = [
        (f"{macro}_FULL_SCALE_DEMAND_{_unit_suffix(model.output)}", scales.demand, "demand of 1.0"),
        (f"{macro}_FULL_SCALE_CURRENT_{_unit_suffix(model.input)}", scales.current, "current of 1.0"),
    ]
    if model.schedule is not None:
        unit = _unit_suffix(model.schedule)
        rows += [
            (f"{macro}_GAP_LOW_{unit}", scales.gap_low, "gap of 0"),
            (f"{macro}_GAP_HIGH_{unit}", scales.gap_high, "gap of 1.0"),
        ]
    texts = [(f"#define {name} {_double_literal(value)}", doc) for name, value, doc in rows]
    return align_comments(texts)


def _double_literal(value: float) -> str:
    """Return the C literal of a number in double precision."""
    text = f"{value:.10g}"
    return text if re.search(r"[.e]", text) else f"{text}.0"


def _unit_suffix(quantity: Quantity) -> str:
    return re.sub(r"\W+", "_", quantity.unit.replace("/", "_per_")).upper()
