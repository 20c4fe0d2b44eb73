"""What an FMU or an S-function is made of, and what an FMU says of itself."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal
from xml.etree import ElementTree as Xml

from anhyst.support.version import running_version

WRAPPER = Path(__file__).with_name("fmu")

Causality = Literal["input", "output", "constant"]


@dataclass(frozen=True)
class Variable:
    """A real variable of a component."""

    name: str
    causality: Causality  # ``input``, ``output`` or ``constant``: a parameter, to be read
    unit: str | None  # SI; None where the name says it
    text: str  # what it is
    start: float = 0.0  # of an input; what a constant is; of an output nothing
    low: float | None = None  # range
    high: float | None = None


@dataclass(frozen=True)
class Part:
    """A component: its variables, and the C that computes them."""

    name: str  # of the model, and what it is
    text: str
    rate: float  # ticks a second; 0 where each step of the tool is one
    # inputs, then outputs, then constants; the reference of each is its place, from 1
    variables: Sequence[Variable]
    sources: Mapping[str, bytes]  # C files and headers by their path

    def named(self, causality: Causality) -> list[Variable]:
        """Return the variables of one kind."""
        return [variable for variable in self.variables if variable.causality == causality]

    def complete(self, wrapper: Iterable[str]) -> tuple[str, dict[str, bytes]]:
        """Return the token that tells this component from any other, and everything to compile."""
        common = ("part.h", "component.h", "component.c", *wrapper)
        files = dict(self.sources) | {name: (WRAPPER / name).read_bytes() for name in common}
        content = b"".join(files[name] for name in sorted(files))
        token = hashlib.sha256(content + repr(self.variables).encode()).hexdigest()[:32]
        files["part_values.h"] = self._values(token).encode()
        return token, dict(sorted(files.items()))

    def _values(self, token: str) -> str:
        first = [0.0, *(0.0 if v.causality == "output" else v.start for v in self.variables)]
        return header(
            "part_values",
            {
                "PART_TOKEN": f'"{token}"',
                "PART_RATE": repr(float(self.rate)),
                "PART_INPUTS": len(self.named("input")),
                "PART_OUTPUTS": len(self.named("output")),
                "PART_VALUES": len(first),
                "PART_FIRST_VALUES": row(first),
            },
        )


def row(values: Iterable[float]) -> str:
    """Return numbers as C reads them back, bit for bit."""
    return "{" + ", ".join(repr(float(value)) for value in values) + "}"


def array(name: str, values: Iterable[float]) -> str:
    """Return a line that defines a row of numbers."""
    return f"static const double {name}[] = {row(values)};\n"


def kernel_of(kernel: str, words: str) -> str:
    """Return the C of the kernel that a block runs on, which with layers is one beside its kind's own."""
    return f"(*({kernel}.for_block != 0 ? {kernel}.for_block({words}) : &{kernel}))"


def header(name: str, defined: Mapping[str, object], before: str = "") -> str:
    """Return a header: lines before, then definitions."""
    guard = f"{name.upper()}_H"
    lines = "".join(f"#define {key} {value}\n" for key, value in defined.items())
    return f"/* Generated. */\n#ifndef {guard}\n#define {guard}\n\n{before}{lines}\n#endif\n"


FmiVersion = Literal["2.0", "3.0"]
MODEL = "anhyst"
"""Of all binaries; what distinguishes two FMUs is their token."""

_UNITS = {
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
    second = version == "2.0"
    root = Xml.Element(
        "fmiModelDescription",
        {
            "fmiVersion": version,
            "modelName": _printable(part.name),
            "guid" if second else "instantiationToken": token,
            "description": _printable(part.text),
            "generationTool": f"anhyst {running_version()}",
            "variableNamingConvention": "flat",
        },
    )
    state = "canGetAndSetFMUstate" if second else "canGetAndSetFMUState"
    serial = "canSerializeFMUstate" if second else "canSerializeFMUState"
    simulation = Xml.SubElement(
        root,
        "CoSimulation",
        {
            "modelIdentifier": MODEL,
            "canHandleVariableCommunicationStepSize": "true",
            state: "true",
            serial: "true",
        },
    )
    if second:
        files = Xml.SubElement(simulation, "SourceFiles")
        for name in sources:
            Xml.SubElement(files, "File", {"name": name})
    _units(root, [variable.unit for variable in part.variables if variable.unit is not None])
    experiment = {"startTime": "0.0"}
    if part.rate > 0.0:  # a step of the length of a tick is what the controller does
        experiment["stepSize"] = repr(1.0 / part.rate)
    Xml.SubElement(root, "DefaultExperiment", experiment)
    if second:
        _variables_2(root, part.variables)
    else:
        _variables_3(root, part.variables)
    return _text(root)


def _printable(text: str) -> str:
    """Return a text without the characters that no XML holds."""
    return "".join(letter if letter.isprintable() else "?" for letter in text)


def build_description(sources: Sequence[str]) -> bytes:
    """Return buildDescription.xml of FMI 3.0."""
    root = Xml.Element("fmiBuildDescription", {"fmiVersion": "3.0"})
    build = Xml.SubElement(root, "BuildConfiguration", {"modelIdentifier": MODEL})
    files = Xml.SubElement(build, "SourceFileSet", {"language": "C99"})
    for name in sources:
        Xml.SubElement(files, "SourceFile", {"name": name})
    Xml.SubElement(files, "IncludeDirectory", {"name": "include/"})
    return _text(root)


def _units(root: Xml.Element, symbols: Sequence[str]) -> None:
    units = Xml.SubElement(root, "UnitDefinitions")
    for symbol in dict.fromkeys([*symbols, "s"]):
        unit = Xml.SubElement(units, "Unit", {"name": symbol})
        if symbol in _UNITS:
            Xml.SubElement(unit, "BaseUnit", _UNITS[symbol])


def _head(variable: Variable, reference: int) -> dict[str, str]:
    constant = variable.causality == "constant"
    return {
        "name": variable.name,
        "valueReference": str(reference),
        "causality": "local" if constant else variable.causality,
        "variability": "constant" if constant else "discrete",
        "description": variable.text,
    }


def _numbers(variable: Variable) -> dict[str, str]:
    numbers = {"unit": variable.unit} if variable.unit is not None else {}
    if variable.low is not None and variable.high is not None:
        numbers |= {"min": repr(variable.low), "max": repr(variable.high)}
    return numbers | ({"start": repr(variable.start)} if variable.causality != "output" else {})


def _variables_2(root: Xml.Element, variables: Sequence[Variable]) -> None:
    listed = Xml.SubElement(root, "ModelVariables")
    outputs = []
    for index, variable in enumerate(variables, start=1):
        scalar = Xml.SubElement(listed, "ScalarVariable", _head(variable, index))
        Xml.SubElement(scalar, "Real", _numbers(variable))
        outputs += [index] if variable.causality == "output" else []
    structure = Xml.SubElement(root, "ModelStructure")
    for tag in ("Outputs", "InitialUnknowns"):
        parent = Xml.SubElement(structure, tag)
        for index in outputs:
            Xml.SubElement(parent, "Unknown", {"index": str(index), "dependencies": ""})


def _variables_3(root: Xml.Element, variables: Sequence[Variable]) -> None:
    listed = Xml.SubElement(root, "ModelVariables")
    time = {"name": "time", "valueReference": "0", "causality": "independent", "unit": "s"}
    Xml.SubElement(listed, "Float64", time | {"variability": "continuous"})
    outputs = []
    for index, variable in enumerate(variables, start=1):
        Xml.SubElement(listed, "Float64", _head(variable, index) | _numbers(variable))
        outputs += [index] if variable.causality == "output" else []
    structure = Xml.SubElement(root, "ModelStructure")
    for tag in ("Output", "InitialUnknown"):
        for index in outputs:
            Xml.SubElement(structure, tag, {"valueReference": str(index), "dependencies": ""})


def _text(root: Xml.Element) -> bytes:
    Xml.indent(root)
    return bytes(Xml.tostring(root, encoding="UTF-8", xml_declaration=True))
