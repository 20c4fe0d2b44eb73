"""The text files of an output folder: what belongs into a project, and the accuracy budget as a page."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache
from pathlib import Path

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from matplotlib.figure import Figure

from anhyst.compensate.budget import Budget, percent
from anhyst.compensate.holding import SECONDS
from anhyst.compensate.measure import BudgetPart
from anhyst.compensate.plan import Plan
from anhyst.compilation.controller import ControllerPlan, controller_values
from anhyst.compilation.manifest import controller_bytes, explain, parameters_bytes, state_bytes
from anhyst.compilation.parameters import c_type, definition, literal, memories, scales_source
from anhyst.compilation.toolchain import (
    AROUND,
    AROUND_SINGLE,
    CONTROL,
    SINGLE,
    SOURCES,
    SRC,
    core_files,
    read_core,
)
from anhyst.support.block_words import Names
from anhyst.support.figures import ALARM, MODEL, WIDTH, styled, svg_text
from anhyst.support.numeric import FloatArray, rms
from anhyst.support.page import (
    NOT_KNOWN,
    Cell,
    Headline,
    PageTable,
    Picture,
    Section,
    Text,
    render_page,
    table,
)
from anhyst.support.units import Quantity

PORT = "port/anhyst_port_cortex_m4.h"
TYPES = {"q15": "int16_t", "q31": "int32_t", "f32": "float"}
ONES = {"q15": 2**15, "q31": 2**31, "f32": 1}


def sources(
    plan: Plan,
    accuracy: Mapping[str, str],
    sha256: str,
    version: str,
    controller: ControllerPlan | None = None,
) -> dict[str, str]:
    """Return the C files and what helps to build them."""
    real = not plan.block.is_fixed
    taken = (SINGLE if real else SOURCES)[plan.block.kind] + (CONTROL if controller else ())
    taken += AROUND_SINGLE if real else AROUND
    parts = ("parameters",) if controller is None else ("parameters", "controller")
    common = example_values(plan, sha256, version, controller) | {
        "core": sorted(f"{SRC}/{name}" for name in taken),
        "own": [f"{plan.name}_{part}.c" for part in parts],
    }
    parameters = common | _parameters(plan)
    files = core_files(taken, memories(plan.block)) | {
        f"{plan.name}_parameters.h": render("parameters.h.j2", parameters),
        f"{plan.name}_parameters.c": render("parameters.c.j2", parameters),
        "main.c": render("main.c.j2", common),
        "example/interrupt.c": render("interrupt.c.j2", parameters),
        "anhyst.mk": render("anhyst.mk.j2", common),
        "anhyst.cmake": render("anhyst.cmake.j2", common),
    }
    guide = common | _guide(plan) | dict(accuracy)
    if controller is not None:
        files |= _controller_files(common, plan.name, controller)
        guide |= controller_values(controller, plan.name) | {
            "controller_bytes": controller_bytes(controller.magnets, controller.block)
        }
    files["DROP_IN.md"] = render("DROP_IN.md.j2", guide)
    return files if real else {**files, PORT: read_core(PORT)}


def example_values(
    plan: Plan, sha256: str, version: str, controller: ControllerPlan | None
) -> dict[str, object]:
    """Return what all files may show: names, and the calls of an example."""
    model, block, io = plan.model, plan.block, plan.request.io
    return {
        "name": plan.name,
        "macro": plan.name.upper(),
        "control": controller is not None,
        "kind": block.kind,
        "version": version,
        "model": in_comment(model.name),
        "sha256": sha256,
        "io": io,
        "real": not block.is_fixed,
        "port": block.is_fixed,
        "word": c_type(block),
        "memories": memories(block),
        "input": model.input.name.replace("_", " "),
        "output": model.output.name.replace("_", " "),
        "type": TYPES[io],
        "one": ONES[io],
        **_calls(plan.name, not block.is_fixed),
    }


def _calls(name: str, real: bool) -> dict[str, object]:
    """Return what the example calls, and what it keeps."""
    suffix = "_f32" if real else ""
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
    common: Mapping[str, object], name: str, controller: ControllerPlan
) -> dict[str, str]:
    """Return the files of the position controller; its example stands for the compensator's."""
    values = dict(common) | controller_values(controller, name)
    values["controller"] = in_comment(str(values["controller"]))
    return {
        f"{name}_controller.h": render("controller.h.j2", values),
        f"{name}_controller.c": render("controller.c.j2", values),
        "main.c": render("main_controller.c.j2", values),
    }


def _parameters(plan: Plan) -> dict[str, object]:
    """Return what the files of the parameters show beside what all files do."""
    model, block = plan.model, plan.block
    names = Names(model.output.unit, model.input.unit)
    values: dict[str, object] = {
        "signals": signal_lines(plan),
        "limits": limit_lines(plan),
        "layered": memories(block) > 1,
        "rate": f"{plan.request.rate:.10g}",
    }
    words = f"{plan.name.upper()}_PARAMETERS_WORDS"
    return values | {
        "kernel": f"anhyst_kernel_{block.kind}{'' if block.is_fixed else '_f32'}",
        "defines": _defines(plan),
        "scales": scales_source(block),
        "definition": definition(plan.name, words, block, names, model.schedule),
        "words": block.words.size,
    }


def _guide(plan: Plan) -> dict[str, object]:
    """Return what the drop-in guide says beside the code."""
    start, io = plan.start, plan.request.io
    cycles = start.conditioning.cycles
    rows = [line.partition(" ") for line in signal_lines(plan)]
    return {
        "rate": f"{plan.request.rate:.10g}",
        "bits": 16 if io == "q15" else 32,
        "signals": [(name, text.strip()) for name, _, text in rows],
        "scale_name": f"{plan.name.upper()}_FULL_SCALE_DEMAND_{_unit(plan.model.output)}",
        "unit": plan.model.output.unit,
        "layered": memories(plan.block) > 1,
        "condition": (
            f"{cycles} triangle{'s' * (cycles > 1)} of current between its limits, "
            f"{start.seconds:g} s"
        ),
        "remaining": f"{100.0 * start.remaining / plan.largest:.2g}",
        "parameters_bytes": parameters_bytes(plan.block),
        "state_bytes": state_bytes(plan.block),
    }


def render(template: str, values: Mapping[str, object]) -> str:
    """Fill one template of this package."""
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


def in_comment(text: str) -> str:
    """Return a text that cannot end a comment or a line."""
    return re.sub(r"[^ -~]|\*/|/\*", "?", text)


def signal_lines(plan: Plan) -> list[str]:
    """Say what the codes of each signal mean, a line each."""
    model, scales, limits = plan.model, plan.block.scales, plan.block.limits
    if plan.request.io == "f32":
        return _real_signals(plan)
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


def limit_lines(plan: Plan) -> list[str]:
    """Return the macros with the limits of demand, current and gap, a line each."""
    model, block, macro = plan.model, plan.block, plan.name.upper()
    scales, limits, io = block.scales, block.limits, plan.request.io
    gap = scales.gap_low, scales.gap_high
    rows = [("DEMAND", limits.demand, 0.0, scales.demand, model.output)]
    rows += [("CURRENT", limits.current, 0.0, scales.current, model.input)]
    if model.schedule is not None:
        rows += [("GAP", gap, gap[0], (gap[1] - gap[0]) or 1.0, model.schedule)]

    def written(value: float, origin: float, scale: float) -> str:
        if io == "f32":
            return literal(value)
        one = ONES[io]
        code = one // 32768 * round((value - origin) / scale * 32768.0)
        return f"({code})" if code < 0 else f"{min(code, one - 1)}"

    texts = [
        (f"#define {macro}_{name}_{end} {written(value, origin, scale)}", _value(value, quantity))
        for name, ends, origin, scale, quantity in rows
        for end, value in zip(("MIN", "MAX"), ends, strict=True)
    ]
    if model.schedule is None:
        number = "0.0f" if io == "f32" else "0"
        texts += [(f"#define {macro}_GAP_{end} {number}", "not used") for end in ("MIN", "MAX")]
    end = max(len(text) for text, _ in texts)
    return [f"{text:<{end}} /* {doc} */" for text, doc in texts]


def _real_signals(plan: Plan) -> list[str]:
    model, scales, limits = plan.model, plan.block.scales, plan.block.limits
    lines = [
        f"demand   in {model.output.unit}, taken from {limits.demand[0]:.6g} to "
        f"{limits.demand[1]:.6g}",
        f"current  in {model.input.unit}, given from {limits.current[0]:.6g} to "
        f"{limits.current[1]:.6g}",
    ]
    if model.schedule is not None and model.needs_schedule:
        lines.append(
            f"gap      in {model.schedule.unit}, from {scales.gap_low:.6g} to "
            f"{scales.gap_high:.6g}; beyond, the nearer of the two counts"
        )
    else:
        lines.append("gap      not used: pass 0")
    return lines


def _value(value: float, quantity: Quantity) -> str:
    return f"{1e3 * value:.6g} mm" if quantity.unit == "m" else f"{value:.6g} {quantity.unit}"


def _defines(plan: Plan) -> list[str]:
    """Return the macros with SI values, a line each."""
    model, scales, macro = plan.model, plan.block.scales, plan.name.upper()
    rows = [
        (f"{macro}_FULL_SCALE_DEMAND_{_unit(model.output)}", scales.demand, "demand of 1.0"),
        (f"{macro}_FULL_SCALE_CURRENT_{_unit(model.input)}", scales.current, "current of 1.0"),
    ]
    if model.schedule is not None:
        unit = _unit(model.schedule)
        rows += [
            (f"{macro}_GAP_LOW_{unit}", scales.gap_low, "gap of 0"),
            (f"{macro}_GAP_HIGH_{unit}", scales.gap_high, "gap of 1.0"),
        ]
    texts = [(f"#define {name} {_real(value)}", doc) for name, value, doc in rows]
    end = max(len(text) for text, _ in texts)
    return [f"{text:<{end}} /* {doc} */" for text, doc in texts]


def _real(value: float) -> str:
    """Return a number that C takes for a double."""
    text = f"{value:.10g}"
    return text if re.search(r"[.e]", text) else f"{text}.0"


def _unit(quantity: Quantity) -> str:
    return re.sub(r"\W+", "_", quantity.unit.replace("/", "_per_")).upper()


ROW = 2.1  # inches
POINTS = 1200
"""Drawn of a path; the largest of each stretch, so that no peak is lost."""


def budget_page(plan: Plan, budget: Budget, version: str) -> str:
    """Return the page of a budget."""
    worst, drift = (percent(budget, part.worst or 0.0) for part in (budget.compiled, budget.drift))
    text = f"Compiled, the output is within {worst:.2g} % of what the model would give"
    if budget.wanted is not None:
        text += f"; {percent(budget, budget.wanted):.3g} % was asked for"
    head = Headline(
        title=f"{plan.model.name}: {plan.block.kind}, {plan.request.io}",
        what=f"{text}. Held, it drifts by {drift:.2g} % in {SECONDS:g} s.",
        basis="",
        notes=(),
        tiles=(),
        comparison=None,
        holds=f"Per cent are of the largest demand, {budget.largest:.4g} {budget.unit}. Every "
        "figure is measured: the currents of the compensator go through the model in double "
        "precision, and what comes out is compared with what was demanded.",
    )
    sections = (
        Section("parts", "What each step costs", (_parts(budget),)),
        Section("paths", "Deviation along the paths", _along(budget)),
        Section("held", "Demands that are held", (_held(budget),)),
        Section("choices", "What was chosen, and why", _choices(plan)),
        Section("signals", "Signals", (_signals(plan),)),
    )
    return render_page(head, sections, version, kind="Accuracy budget", source="the model file")


def _parts(budget: Budget) -> PageTable:
    """Each part switched on alone, everything else exact; then the sums."""
    sums = budget.compiled, budget.total, budget.drift
    largest = max(part.worst or 0.0 for part in (*budget.parts, *sums))

    def row(part: BudgetPart) -> list[Cell]:
        def share(value: float | None) -> str:
            return NOT_KNOWN if value is None else f"{percent(budget, value):#.2g}"

        worst = NOT_KNOWN if part.worst is None else f"{part.worst:.3g}"
        return [
            Cell(part.title, strong=part in sums),
            Cell(part.note),
            Cell(worst),
            Cell(share(part.worst), bar=(part.worst or 0.0) / largest if largest else 0.0),
            Cell(share(part.rms)),
        ]

    return table(
        "Parts and sums",
        ["part", "what was switched on", f"worst [{budget.unit}]", "worst [%]", "rms [%]"],
        [row(part) for part in (*budget.parts, *sums)],
        "Each part is switched on alone, everything else exact.",
        texts=2,
    )


def _along(budget: Budget) -> tuple[Picture, PageTable]:
    rows = [
        [
            run.path.title,
            f"{error.size}",
            f"{percent(budget, float(np.abs(error).max())):.3g}",
            f"{percent(budget, rms(error)):.2g}",
        ]
        for run, error in budget.runs
    ]
    shown = Picture(
        svg_text(_figure(budget), "paths"),
        "Deviation of the output from the demand along each path",
        "Everything that compiling adds is switched on. Where the current stands at a limit, only "
        "deviations to the wrong side count.",
    )
    return shown, table("Every path", ["path", "samples", "worst [%]", "rms [%]"], rows)


def _held(budget: Budget) -> PageTable:
    rows = [
        [
            path.title,
            f"{path.demand:.3g}",
            f"{path.seconds:g}",
            f"{percent(budget, path.drift):.2g}",
        ]
        for path in budget.held
    ]
    return table(
        "Every movement",
        ["while", f"demand [{budget.unit}]", "time [s]", "drift [%]"],
        rows,
        "The same demand at the same gap, again and again: how far the output has moved since its "
        "first return. A movement that repeats itself is followed until compensator and model "
        "repeat themselves too.",
    )


def _choices(plan: Plan) -> tuple[PageTable, Text]:
    rows = [[choice.name, choice.value, choice.reason] for choice in explain(plan)]
    size = f"Altogether {parameters_bytes(plan.block)} bytes of parameters."
    return table("Every choice", ["what", "chosen", "because"], rows, texts=3), Text(size)


def _signals(plan: Plan) -> PageTable:
    lines = [line.partition(" ") for line in signal_lines(plan)]
    return table(
        "", ["signal", "meaning"], [[name, text.strip()] for name, _, text in lines], "", 2
    )


@styled
def _figure(budget: Budget) -> Figure:
    """Draw the deviation along each path."""
    rows = -(-len(budget.runs) // 2)
    # Panels that are all alike need no search for room, which took a fifth of compiling.
    figure = Figure((WIDTH, ROW * rows))
    figure.subplots_adjust(0.1, 0.5 / (ROW * rows), 0.99, 1.0 - 0.3 / (ROW * rows), 0.08, 0.65)
    axes = figure.subplots(rows, 2, squeeze=False, sharey=True).ravel().tolist()
    for ax in axes[len(budget.runs) :]:
        ax.remove()
    for ax, (run, error) in zip(axes, budget.runs, strict=False):
        at, low, high = _envelope(percent(budget, 1.0) * error)
        ax.fill_between(at, low, high, color=MODEL, linewidth=0.6, edgecolor=MODEL)
        ax.set_title(run.path.title)
        ax.set_xlabel("sample")
        if budget.wanted is not None:
            for bound in (-percent(budget, budget.wanted), percent(budget, budget.wanted)):
                ax.axhline(bound, color=ALARM, linewidth=0.8, dashes=(4, 3))
    for ax in axes[0 : len(budget.runs) : 2]:
        ax.set_ylabel("deviation, %")
    return figure


def _envelope(error: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return places, lowest and highest value of stretches of equal length."""
    edges = np.unique(np.linspace(0, error.size, min(POINTS, error.size) + 1).astype(int))
    low, high = (np.asarray(f.reduceat(error, edges[:-1])) for f in (np.minimum, np.maximum))
    return edges[:-1].astype(np.float64), low, high
