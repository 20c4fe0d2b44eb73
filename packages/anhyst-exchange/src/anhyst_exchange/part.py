"""A component for other tools: variables, C sources, and the XML files of FMI.

The module also creates the components of a model: its actuator and its compensator.
"""

from __future__ import annotations

import hashlib
import json
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal
from xml.etree import ElementTree as Xml

from anhyst.compilation.output import compile_actuator
from anhyst.compilation.toolchain import core_files
from anhyst.model.actuator import Model, require_core
from anhyst.model.parameters import CIRCUIT_SPECS
from anhyst.support import running_version
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError

WRAPPER_FOLDER = Path(__file__).with_name("fmu")

Causality = Literal["input", "output", "constant"]


@dataclass(frozen=True)
class Variable:
    """A real variable of a component."""

    name: str
    causality: Causality  # a constant is a parameter that can only be read
    unit: str | None  # SI unit; None if the name contains it
    text: str  # description
    start: float = 0.0  # initial value of an input; value of a constant; 0 for an output
    low: float | None = None  # limits
    high: float | None = None


@dataclass(frozen=True)
class Part:
    """A component: its variables, and the C code that computes them."""

    name: str  # name and description
    text: str
    rate: float  # ticks per second; 0 if each step of the tool is a tick
    # inputs, then outputs, then constants; the value reference is the position, from 1
    variables: Sequence[Variable]
    sources: Mapping[str, bytes]  # C files and headers by path

    def variables_with_causality(self, causality: Causality) -> list[Variable]:
        """Return the variables of one causality: inputs, outputs or constants."""
        return [variable for variable in self.variables if variable.causality == causality]

    def add_wrapper(self, wrapper: Iterable[str]) -> tuple[str, dict[str, bytes]]:
        """Return the token that identifies this component, and all files to compile."""
        common_files = ("part.h", "component.h", "component.c", *wrapper)
        files = dict(self.sources) | {name: (WRAPPER_FOLDER / name).read_bytes() for name in common_files}
        content = b"".join(files[name] for name in sorted(files))
        token = hashlib.sha256(content + repr(self.variables).encode()).hexdigest()[:32]
        files["part_values.h"] = self._values_header(token).encode()
        return token, dict(sorted(files.items()))

    def _values_header(self, token: str) -> str:
        initial_values = [0.0, *(0.0 if v.causality == "output" else v.start for v in self.variables)]
        return header_text(
            "part_values",
            {
                "PART_TOKEN": f'"{token}"',
                "PART_RATE": repr(float(self.rate)),
                "PART_INPUTS": len(self.variables_with_causality("input")),
                "PART_OUTPUTS": len(self.variables_with_causality("output")),
                "PART_VALUES": len(initial_values),
                "PART_FIRST_VALUES": c_array_literal(initial_values),
            },
        )


def c_array_literal(values: Iterable[float]) -> str:
    """Return numbers as a C initialiser; a compiler reads exactly the same numbers from it."""
    return "{" + ", ".join(repr(float(value)) for value in values) + "}"


def c_array_definition(name: str, values: Iterable[float]) -> str:
    """Return a line of C that defines an array of numbers."""
    return f"static const double {name}[] = {c_array_literal(values)};\n"


def kernel_expression(kernel: str, words: str) -> str:
    """Return the C expression that selects the kernel for a parameter block.

    Blocks of layered iron have another kernel, which the function `for_block` of the default kernel
    returns.
    """
    return f"(*({kernel}.for_block != 0 ? {kernel}.for_block({words}) : &{kernel}))"


def header_text(name: str, macros: Mapping[str, object], first_lines: str = "") -> str:
    """Return a C header: some lines, then macros."""
    guard_macro = f"{name.upper()}_H"
    lines = "".join(f"#define {key} {value}\n" for key, value in macros.items())
    return f"/* Generated. */\n#ifndef {guard_macro}\n#define {guard_macro}\n\n{first_lines}{lines}\n#endif\n"


FmiVersion = Literal["2.0", "3.0"]
MODEL_IDENTIFIER = "anhyst"
"""Name of all binaries. Two FMUs differ by their tokens."""

_BASE_UNITS = {
    "s": {"s": "1"},
    "N": {"kg": "1", "m": "1", "s": "-2"},
    "m/s": {"m": "1", "s": "-1"},
    "A": {"A": "1"},
    "m": {"m": "1"},
    "rad": {"rad": "1"},
    "rad/s": {"rad": "1", "s": "-1"},
    "N.m": {"kg": "1", "m": "2", "s": "-2"},
    "V": {"kg": "1", "m": "2", "s": "-3", "A": "-1"},
    "T": {"kg": "1", "s": "-2", "A": "-1"},
    "Wb": {"kg": "1", "m": "2", "s": "-2", "A": "-1"},
    "A/m": {"A": "1", "m": "-1"},
    "Pa": {"kg": "1", "m": "-1", "s": "-2"},
    "degC": {"K": "1", "offset": "273.15"},
    "1": {},
}


def model_description(version: FmiVersion, part: Part, token: str, sources: Sequence[str]) -> bytes:
    """Return modelDescription.xml."""
    is_fmi2 = version == "2.0"
    root = Xml.Element(
        "fmiModelDescription",
        {
            "fmiVersion": version,
            "modelName": _to_xml_text(part.name),
            "guid" if is_fmi2 else "instantiationToken": token,
            "description": _to_xml_text(part.text),
            "generationTool": f"anhyst {running_version()}",
            "variableNamingConvention": "flat",
        },
    )
    state_flag = "canGetAndSetFMUstate" if is_fmi2 else "canGetAndSetFMUState"
    serialise_flag = "canSerializeFMUstate" if is_fmi2 else "canSerializeFMUState"
    simulation_element = Xml.SubElement(
        root,
        "CoSimulation",
        {
            "modelIdentifier": MODEL_IDENTIFIER,
            "canHandleVariableCommunicationStepSize": "true",
            state_flag: "true",
            serialise_flag: "true",
        },
    )
    if is_fmi2:
        files = Xml.SubElement(simulation_element, "SourceFiles")
        for name in sources:
            Xml.SubElement(files, "File", {"name": name})
    _add_units(root, [variable.unit for variable in part.variables if variable.unit is not None])
    experiment_attributes = {"startTime": "0.0"}
    if part.rate > 0.0:  # the step of the controller
        experiment_attributes["stepSize"] = repr(1.0 / part.rate)
    Xml.SubElement(root, "DefaultExperiment", experiment_attributes)
    if is_fmi2:
        _add_variables_fmi2(root, part.variables)
    else:
        _add_variables_fmi3(root, part.variables)
    return _to_xml(root)


def _to_xml_text(text: str) -> str:
    """Replace the characters that XML cannot contain."""
    return "".join(letter if letter.isprintable() else "?" for letter in text)


def build_description(sources: Sequence[str]) -> bytes:
    """Return buildDescription.xml of FMI 3.0."""
    root = Xml.Element("fmiBuildDescription", {"fmiVersion": "3.0"})
    build = Xml.SubElement(root, "BuildConfiguration", {"modelIdentifier": MODEL_IDENTIFIER})
    files = Xml.SubElement(build, "SourceFileSet", {"language": "C99"})
    for name in sources:
        Xml.SubElement(files, "SourceFile", {"name": name})
    Xml.SubElement(files, "IncludeDirectory", {"name": "include/"})
    return _to_xml(root)


def _add_units(root: Xml.Element, symbols: Sequence[str]) -> None:
    units = Xml.SubElement(root, "UnitDefinitions")
    for symbol in dict.fromkeys([*symbols, "s"]):
        unit = Xml.SubElement(units, "Unit", {"name": symbol})
        if symbol in _BASE_UNITS:
            Xml.SubElement(unit, "BaseUnit", _BASE_UNITS[symbol])


def _common_attributes(variable: Variable, value_reference: int) -> dict[str, str]:
    is_constant = variable.causality == "constant"
    return {
        "name": variable.name,
        "valueReference": str(value_reference),
        "causality": "local" if is_constant else variable.causality,
        "variability": "constant" if is_constant else "discrete",
        "description": variable.text,
    }


def _value_attributes(variable: Variable) -> dict[str, str]:
    attributes = {"unit": variable.unit} if variable.unit is not None else {}
    if variable.low is not None and variable.high is not None:
        attributes |= {"min": repr(variable.low), "max": repr(variable.high)}
    return attributes | ({"start": repr(variable.start)} if variable.causality != "output" else {})


def _add_variables_fmi2(root: Xml.Element, variables: Sequence[Variable]) -> None:
    variables_element = Xml.SubElement(root, "ModelVariables")
    outputs = []
    for index, variable in enumerate(variables, start=1):
        scalar = Xml.SubElement(variables_element, "ScalarVariable", _common_attributes(variable, index))
        Xml.SubElement(scalar, "Real", _value_attributes(variable))
        outputs += [index] if variable.causality == "output" else []
    structure = Xml.SubElement(root, "ModelStructure")
    for tag in ("Outputs", "InitialUnknowns"):
        parent = Xml.SubElement(structure, tag)
        for index in outputs:
            Xml.SubElement(parent, "Unknown", {"index": str(index), "dependencies": ""})


def _add_variables_fmi3(root: Xml.Element, variables: Sequence[Variable]) -> None:
    variables_element = Xml.SubElement(root, "ModelVariables")
    time = {"name": "time", "valueReference": "0", "causality": "independent", "unit": "s"}
    Xml.SubElement(variables_element, "Float64", time | {"variability": "continuous"})
    outputs = []
    for index, variable in enumerate(variables, start=1):
        Xml.SubElement(
            variables_element, "Float64", _common_attributes(variable, index) | _value_attributes(variable)
        )
        outputs += [index] if variable.causality == "output" else []
    structure = Xml.SubElement(root, "ModelStructure")
    for tag in ("Output", "InitialUnknown"):
        for index in outputs:
            Xml.SubElement(structure, tag, {"valueReference": str(index), "dependencies": ""})


def _to_xml(root: Xml.Element) -> bytes:
    Xml.indent(root)
    return bytes(Xml.tostring(root, encoding="UTF-8", xml_declaration=True))


LAW_CORE_FILES = (
    *("numeric/elementary.c", "law/langevin.c", "law/circuit.c", "law/layers.c"),
    *(f"law/{name}.c" for name in ("cell_shape", "cell_table", "cells", "law_cells")),
    *(f"law/{name}.c" for name in ("branch", "operator", "lag_exact", "lag_linear", "lag_1986")),
    *("law/solver.c", "law/law_lag.c"),
)
"""C files of the core for any hysteresis law; the circuit refers to all laws."""

_STEPS = {"effective-field": "ANHYST_STEP_EXACT", "jiles-atherton-1986": "ANHYST_STEP_JA1986"}


def actuator_part(model: Model) -> Part:
    """Return an actuator as a component.

    The inputs are the drive and the scheduling variable; the outputs are the output, the flux
    density and the field. Each step of the tool is one sample, as for
    :meth:`anhyst.model.stepper.Stepper.commit`. The iron starts demagnetised. The component does
    not contain an eddy-current lag of the model.
    """
    if model.needs_fixed_gap:
        raise InputError(
            f"the iron of this model varies with its {model.schedule.name if model.schedule else ''}"
            f" ({', '.join(model.varying)}), which an exported actuator does not support; identify with the "
            "gap map scaling or reluctance",
            code="iron-varies",
        )
    valid_range = model.valid.schedule if model.valid else None
    schedule_values = valid_range or model.nodes or (0.0,)
    initial_schedule = 0.5 * (float(schedule_values[0]) + float(schedule_values[-1]))
    require_core(model, initial_schedule)
    circuit_macros, rows = _circuit_macros(model)
    macros = _law_macros(model) | circuit_macros | _creep_macros(model) | _layer_macros(model)
    files = {name: text.encode() for name, text in core_files(LAW_CORE_FILES).items()}
    files |= {name: (WRAPPER_FOLDER / name).read_bytes() for name in ("actuator.c", "curve.c", "curve.h")}
    files["actuator_numbers.h"] = header_text("actuator_numbers", macros, rows).encode()
    text = (
        f"{model.output.name.replace('_', ' ').capitalize()} of a {model.input.name}, including "
        f"hysteresis: {model.operator_law.title}"
    )
    return Part(model.name or "actuator", text, 0.0, _actuator_variables(model, initial_schedule), files)


def _law_macros(model: Model) -> dict[str, object]:
    """Return the parameters of the hysteresis law."""
    law = model.operator_law
    iron = {spec.name: float(model.interpolate_parameter(spec.name, [0.0])[0]) for spec in law.parameters}
    if law.cells is not None:
        cells = law.cells(iron)
        return {
            "ACTUATOR_HAS_CELLS": 1,
            "ACTUATOR_CELLS": cells.thresholds.size,
            "ACTUATOR_CURVES": cells.widths.size,
            "ACTUATOR_SHAPE": f"ANHYST_SHAPE_{cells.shape.upper()}",
            "ACTUATOR_THRESHOLDS": c_array_literal(cells.thresholds),
            "ACTUATOR_WIDTHS": c_array_literal(cells.widths),
            "ACTUATOR_CENTRES": c_array_literal(cells.curve_centres),
            "ACTUATOR_WEIGHTS": c_array_literal(cells.weights.ravel()),
            "ACTUATOR_INTERACTION": iron["alpha"],
        }
    return {
        "ACTUATOR_HAS_CELLS": 0,
        "ACTUATOR_STEP": _STEPS[law.name],
        "ACTUATOR_SATURATION": iron["M_s"],
        "ACTUATOR_WIDTH": iron["a"],
        "ACTUATOR_PINNING": iron["k"],
        "ACTUATOR_REVERSIBILITY": iron["c"],
        "ACTUATOR_INTERACTION": iron["alpha"],
        "ACTUATOR_PLAY": iron["r_d"],
    }


def _circuit_macros(model: Model) -> tuple[dict[str, object], str]:
    """Return the curves of the circuit parameters against the schedule, and their arrays."""
    curves, rows = [], []
    for spec in CIRCUIT_SPECS:
        curve = model.curves.get(spec.name)
        if curve is None or curve.nodes.size < 2:
            value = model.interpolate_parameter(spec.name, [0.0])
            coordinate, arrays = "PLAIN", (value, value, value, value)
        else:
            curve_heights, node_slopes = curve.straight()
            coordinate = spec.coordinate.upper()
            arrays = (curve.nodes, curve.values, curve_heights, node_slopes)
        names = [f"{spec.name}_{array_name}" for array_name in ("nodes", "values", "heights", "slopes")]
        rows += [c_array_definition(name, array) for name, array in zip(names, arrays, strict=True)]
        curves.append(f"{{{len(arrays[0])}, ANHYST_CURVE_{coordinate}, {', '.join(names)}}}")
    return {
        "ACTUATOR_POWER": model.power,
        "ACTUATOR_HAS_SCHEDULE": int(model.schedule is not None),
        "ACTUATOR_SURROUNDINGS": "{" + ", ".join(curves) + "}",
    }, "".join(rows)


def _creep_macros(model: Model) -> dict[str, object]:
    dynamics = model.dynamics
    times, shares = (dynamics.times, dynamics.shares) if dynamics is not None else ((), ())
    return {
        "ACTUATOR_CREEPS": len(times),
        "ACTUATOR_TIMES": c_array_literal(times or (1.0,)),
        "ACTUATOR_SHARES": c_array_literal(shares or (0.0,)),
    }


def _layer_macros(model: Model) -> dict[str, object]:
    if model.layers is None:
        settings = model.core_eddy_circuit or (0.0, 0.0, 0.0)
        return {
            "ACTUATOR_LAYERS": 1,
            "ACTUATOR_MEMORIES": 1 + (model.eddy_circuit.state_numbers if model.eddy_circuit else 0),
            "ACTUATOR_EDDY_CIRCUIT": ", ".join(f"{value:.17g}" for value in settings),
        }
    return {
        "ACTUATOR_LAYERS": model.layers.count,
        "ACTUATOR_MEMORIES": model.layers.state_copies,
        "ACTUATOR_SURFACE": model.layers.surface,
        "ACTUATOR_LAMINATED": model.layers.laminated,
    }


def _actuator_variables(model: Model, initial_schedule: float) -> list[Variable]:
    low, high = model.valid.input if model.valid else (None, None)
    initial_drive = 0.0 if low is None or high is None else min(max(0.0, low), high)
    text = "drive, from the beginning of a step"
    variables = [Variable(model.input.name, "input", model.input.unit, text, initial_drive, low, high)]
    if model.schedule is not None:
        schedule_range = model.valid.schedule if model.valid else None
        low, high = schedule_range or (None, None)
        text = "scheduling variable; the curves of the model are straight lines outside its nodes"
        name, unit = model.schedule.name, model.schedule.unit
        variables.append(Variable(name, "input", unit, text, initial_schedule, low, high))
    text = "output at the end of a step"
    variables.append(Variable(model.output.name, "output", model.output.unit, text))
    variables.append(
        Variable("iron_flux_density", "output", "T", "flux density of the iron, scaled as in the model")
    )
    variables.append(Variable("iron_field", "output", "A/m", "field in the iron, scaled as in the model"))
    return [*variables, *_constant_variables(model)]


def _constant_variables(model: Model) -> list[Variable]:
    """Return the parameters of the model file that do not depend on the scheduling variable."""
    units: dict[str, str] = {spec.name: spec.unit for spec in model.operator_law.parameters}
    return [
        Variable(
            model.file_keys[name][1],
            "constant",
            units.get(name),
            spec.meaning,
            float(model.interpolate_parameter(name, [0.0])[0]),
        )
        for name, spec in model.specs.items()
        if name not in model.varying
    ]


Kind = Literal["full", "simplified"]


def compensator_part(model: Model | PathLike, rate: float, kind: Kind) -> Part:
    """Return a compensator with its own rate as a component: demand and gap in, current out."""
    with tempfile.TemporaryDirectory(prefix="anhyst-part-") as scratch:
        folder = Path(scratch) / "controller"
        compiled_controller = compile_actuator(model, folder, rate=rate, kind=kind, io="q31")
        manifest, sources = compiled_sources(folder)
    sources["compensator.c"] = (WRAPPER_FOLDER / "compensator.c").read_bytes()
    sources["compensator_numbers.h"] = _compensator_header(manifest).encode()
    text = (
        f"Current of a demanded {manifest['signals']['demand']['quantity']}, hysteresis included: "
        f"compensator {compiled_controller.manifest['kind']} in fixed point"
    )
    return Part(manifest["name"], text, rate, _compensator_variables(manifest), sources)


def compiled_sources(folder: Path) -> tuple[dict[str, Any], dict[str, bytes]]:
    """Return the manifest of a compiled folder, and its C files without the example."""
    manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    paths = [path for part in ("include", "src") for path in (folder / part).rglob("*.[ch]")]
    paths += folder.glob(f"{manifest['name']}_*.[ch]")
    return manifest, {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}


def _compensator_header(manifest: Mapping[str, Any]) -> str:
    """Return the header that defines the names of this actuator for the component."""
    name, signals = manifest["name"], manifest["signals"]
    gap = signals.get("gap")
    gap_range = gap or {"low": 0.0, "high": 0.0}
    macros = {
        "COMPENSATOR_KERNEL": kernel_expression(f"{name.upper()}_KERNEL", f"{name}_parameters"),
        "COMPENSATOR_WORDS": f"{name.upper()}_PARAMETERS_WORDS",
        "COMPENSATOR_FULL_SCALE_DEMAND": float(signals["demand"]["scale"]),
        "COMPENSATOR_FULL_SCALE_CURRENT": float(signals["current"]["scale"]),
        "COMPENSATOR_HAS_GAP": int(gap is not None),
        "COMPENSATOR_GAP_LOW": float(gap_range["low"]),
        "COMPENSATOR_GAP_HIGH": float(gap_range["high"]),
        "compensator_parameters": f"{name}_parameters",
    }
    return header_text("compensator_numbers", macros, f'#include "{name}_parameters.h"\n\n')


def _compensator_variables(manifest: Mapping[str, Any]) -> list[Variable]:
    signals = manifest["signals"]
    demand, current, gap = (signals.get(name) for name in ("demand", "current", "gap"))
    low, high = demand["low"], demand["high"]
    text = f"demanded {demand['quantity']}"
    variables = [Variable("demand", "input", demand["unit"], text, max(0.0, low), low, high)]
    if gap:
        text = f"{gap['quantity']}; limited to its range"
        low, high = gap["low"], gap["high"]
        variables.append(Variable("gap", "input", gap["unit"], text, low, low, high))
    text = f"{current['quantity']} for the demand, from the last tick on"
    low, high = current["low"], current["high"]
    variables.append(Variable("current", "output", current["unit"], text, 0.0, low, high))
    return variables
