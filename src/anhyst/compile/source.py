"""The text files of an output folder that belong into a project."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from textwrap import fill

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from anhyst.compile.core import join, read_core, section_names
from anhyst.compile.parameters import parameters_source
from anhyst.compile.plan import Plan
from anhyst.compile.words import Names
from anhyst.data.units import Quantity

PORT = "anhyst_port_cortex_m4.h"

STATE_BYTES = 52
"""Of ``anhyst_compensator`` where a pointer has 32 bits; 4 less where it has 16."""


def sources(plan: Plan, sha256: str, version: str) -> dict[str, str]:
    """Return the C files and what helps to build them.

    Parameters
    ----------
    plan : Plan
        What is compiled.
    sha256 : str
        Of the model file.
    version : str
        Of anhyst.

    Returns
    -------
    dict of str to str
        Content by file name; the same for the same plan.
    """
    model, block, io = plan.model, plan.block, plan.request.io
    joined = join(block.kind)
    common = {
        "kind": block.kind,
        "version": version,
        "model": _in_comment(model.name),
        "sha256": sha256,
        "io": io,
        "input": model.input.name.replace("_", " "),
        "output": model.output.name.replace("_", " "),
    }
    header = common | {
        "system": joined.system,
        "body": joined.header,
        "header_files": _listed(section_names([joined.header])),
    }
    source = common | {
        "body": joined.source.rstrip("\n"),
        "source_files": _listed(section_names([joined.source])),
    }
    parameters = common | {
        "one": 32768 if io == "q15" else 2147483648,
        "signals": signal_lines(plan),
        "kernel": f"anhyst_kernel_{block.kind}",
        "rate": f"{plan.request.rate:.10g}",
        "defines": _defines(plan),
        "words": block.words.size,
        "rows": parameters_source(
            block, Names(model.output.unit, model.input.unit), model.schedule
        ),
    }
    main = common | {"type": "int16_t" if io == "q15" else "int32_t"}
    return {
        "anhyst.h": render("anhyst.h.j2", header),
        "anhyst.c": render("anhyst.c.j2", source),
        "anhyst_parameters.h": render("anhyst_parameters.h.j2", parameters),
        "anhyst_parameters.c": render("anhyst_parameters.c.j2", parameters),
        PORT: read_core(f"port/{PORT}"),
        "main.c": render("main.c.j2", main),
        "DROP_IN.md": render("DROP_IN.md.j2", main | _guide(plan)),
        "anhyst.mk": render("anhyst.mk.j2", common),
        "anhyst.cmake": render("anhyst.cmake.j2", common),
    }


def _guide(plan: Plan) -> dict[str, object]:
    """Return what the drop-in guide tells beside the code."""
    start, io = plan.start, plan.request.io
    cycles = start.conditioning.cycles
    rows = [line.partition(" ") for line in signal_lines(plan)]
    return {
        "rate": f"{plan.request.rate:.10g}",
        "one": 32768 if io == "q15" else 2147483648,
        "bits": 16 if io == "q15" else 32,
        "signals": [(name, text.strip()) for name, _, text in rows],
        "condition": (
            f"{cycles} triangle{'s' * (cycles > 1)} of current between its limits, "
            f"{start.seconds:g} s"
        ),
        "remaining": f"{100.0 * start.remaining / plan.largest:.2g}",
        "words_bytes": plan.block.size,
        "state_bytes": STATE_BYTES,
    }


def render(template: str, values: Mapping[str, object]) -> str:
    """Fill one template of this package."""
    return _environment().get_template(template).render(values)


@cache
def _environment() -> Environment:
    return Environment(
        loader=FileSystemLoader(Path(__file__).parent / "templates"),
        autoescape=lambda name: name is not None and ".html" in name,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )


def _listed(names: tuple[str, ...]) -> str:
    """Return file names as a phrase inside a comment."""
    text = f"{', '.join(names[:-1])} and {names[-1]}"
    return fill(text, 90, subsequent_indent="   ")


def _in_comment(text: str) -> str:
    """Return a text that cannot end a comment or a line."""
    return re.sub(r"[^ -~]|\*/|/\*", "?", text)


def signal_lines(plan: Plan) -> list[str]:
    """Say what the codes of each signal mean, a line each."""
    model, scales, limits = plan.model, plan.block.scales, plan.block.limits
    lines = [
        f"demand   1.0 is {_value(scales.demand, model.output)}; taken from "
        f"{_value(limits.demand[0], model.output)} to {_value(limits.demand[1], model.output)}",
        f"current  1.0 is {_value(scales.current, model.input)}; given from "
        f"{_value(limits.current[0], model.input)} to {_value(limits.current[1], model.input)}",
    ]
    if model.schedule is not None and scales.gap_high > scales.gap_low:
        lines.append(
            f"gap      0 is {_value(scales.gap_low, model.schedule)}, 1.0 is "
            f"{_value(scales.gap_high, model.schedule)}; beyond, the nearer of the two counts"
        )
    else:
        lines.append("gap      not used: pass 0")
    return lines


def _value(value: float, quantity: Quantity) -> str:
    if quantity.unit == "m":
        return f"{1e3 * value:.6g} mm"
    return f"{value:.6g} {quantity.unit}"


def _defines(plan: Plan) -> list[tuple[str, str, str]]:
    """Return name, value and meaning of the macros with SI values."""
    model, scales = plan.model, plan.block.scales
    rows = [
        (f"ANHYST_FULL_SCALE_DEMAND_{_unit(model.output)}", scales.demand, "demand of 1.0"),
        (f"ANHYST_FULL_SCALE_CURRENT_{_unit(model.input)}", scales.current, "current of 1.0"),
    ]
    if model.schedule is not None:
        unit = _unit(model.schedule)
        rows += [
            (f"ANHYST_GAP_LOW_{unit}", scales.gap_low, "gap of 0"),
            (f"ANHYST_GAP_HIGH_{unit}", scales.gap_high, "gap of 1.0"),
        ]
    return [(name, _real(value), doc) for name, value, doc in rows]


def _real(value: float) -> str:
    """Return a number that C takes for a double."""
    text = f"{value:.10g}"
    return text if re.search(r"[.e]", text) else f"{text}.0"


def _unit(quantity: Quantity) -> str:
    return re.sub(r"\W+", "_", quantity.unit.replace("/", "_per_")).upper()
