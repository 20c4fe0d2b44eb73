"""What an FMU or an S-function is made of, whichever kind of component is in it."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

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
