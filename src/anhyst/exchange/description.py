"""What an FMU says of itself: the files modelDescription.xml and buildDescription.xml."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal
from xml.etree import ElementTree as Xml

FmiVersion = Literal["2.0", "3.0"]
MODEL = "anhyst"
"""Of all binaries; what distinguishes two FMUs is their token."""

_UNITS = {
    "N": {"kg": "1", "m": "1", "s": "-2"},
    "A": {"A": "1"},
    "m": {"m": "1"},
    "V": {"kg": "1", "m": "2", "s": "-3", "A": "-1"},
    "T": {"kg": "1", "s": "-2", "A": "-1"},
    "Wb": {"kg": "1", "m": "2", "s": "-2", "A": "-1"},
    "A/m": {"A": "1", "m": "-1"},
    "Pa": {"kg": "1", "m": "-1", "s": "-2"},
    "1": {},
}


@dataclass(frozen=True)
class Variable:
    """A real variable of an FMU.

    Parameters
    ----------
    name : str
    reference : int
        As in ``component.h``.
    causality : str
        ``input`` or ``output``.
    unit : str
        SI.
    low, high : float
        Range.
    start : float
    text : str
        What it is.
    """

    name: str
    reference: int
    causality: Literal["input", "output"]
    unit: str
    low: float
    high: float
    start: float
    text: str


@dataclass(frozen=True)
class Described:
    """What stands in the description besides the variables.

    Parameters
    ----------
    name, text, tool : str
        Of the model, what it is, what made it.
    token : str
        Distinguishes this FMU from any other.
    rate : float
        Ticks a second.
    sources : sequence of str
        C files in ``sources/``.
    """

    name: str
    text: str
    tool: str
    token: str
    rate: float
    sources: Sequence[str]


def model_description(
    version: FmiVersion, about: Described, variables: Sequence[Variable]
) -> bytes:
    """Return modelDescription.xml."""
    second = version == "2.0"
    root = Xml.Element(
        "fmiModelDescription",
        {
            "fmiVersion": version,
            "modelName": about.name,
            "guid" if second else "instantiationToken": about.token,
            "description": about.text,
            "generationTool": about.tool,
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
        for name in about.sources:
            Xml.SubElement(files, "File", {"name": name})
    _units(root, [one.unit for one in variables])
    # A step of the length of a tick is what the controller does.
    Xml.SubElement(
        root, "DefaultExperiment", {"startTime": "0.0", "stepSize": repr(1.0 / about.rate)}
    )
    if second:
        _variables_2(root, variables)
    else:
        _variables_3(root, variables)
    return _text(root)


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
        Xml.SubElement(unit, "BaseUnit", {"s": "1"} if symbol == "s" else _UNITS[symbol])


def _numbers(one: Variable) -> dict[str, str]:
    found = {"unit": one.unit, "min": repr(one.low), "max": repr(one.high)}
    return found | ({"start": repr(one.start)} if one.causality == "input" else {})


def _variables_2(root: Xml.Element, variables: Sequence[Variable]) -> None:
    listed = Xml.SubElement(root, "ModelVariables")
    outputs = []
    for place, one in enumerate(variables, start=1):
        head = {"name": one.name, "valueReference": str(one.reference)}
        kinds = {"causality": one.causality, "variability": "discrete", "description": one.text}
        Xml.SubElement(
            Xml.SubElement(listed, "ScalarVariable", head | kinds), "Real", _numbers(one)
        )
        outputs += [place] if one.causality == "output" else []
    structure = Xml.SubElement(root, "ModelStructure")
    for tag in ("Outputs", "InitialUnknowns"):
        parent = Xml.SubElement(structure, tag)
        for place in outputs:
            Xml.SubElement(parent, "Unknown", {"index": str(place), "dependencies": ""})


def _variables_3(root: Xml.Element, variables: Sequence[Variable]) -> None:
    listed = Xml.SubElement(root, "ModelVariables")
    time = {"name": "time", "valueReference": "0", "causality": "independent", "unit": "s"}
    Xml.SubElement(listed, "Float64", time | {"variability": "continuous"})
    structure = Xml.Element("ModelStructure")
    for one in variables:
        head = {"name": one.name, "valueReference": str(one.reference)}
        kinds = {"causality": one.causality, "variability": "discrete", "description": one.text}
        Xml.SubElement(listed, "Float64", head | kinds | _numbers(one))
        if one.causality == "output":
            said = {"valueReference": str(one.reference), "dependencies": ""}
            Xml.SubElement(structure, "Output", said)
    for one in variables:
        if one.causality == "output":
            said = {"valueReference": str(one.reference), "dependencies": ""}
            Xml.SubElement(structure, "InitialUnknown", said)
    root.append(structure)


def _text(root: Xml.Element) -> bytes:
    Xml.indent(root)
    return bytes(Xml.tostring(root, encoding="UTF-8", xml_declaration=True))
