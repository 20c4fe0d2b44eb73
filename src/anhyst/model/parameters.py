"""The parameters of a model: those of its law, and those of what surrounds the iron from drive to output."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from anhyst.data.output_map import OutputMap
from anhyst.laws.law import Law, ParameterSpec
from anhyst.support.numeric import FloatArray

Parameter = float | tuple[float, ...]
GapMap = Literal["none", "scaling", "reluctance", "circuit", "free"]

GAP_MAPS: tuple[GapMap, ...] = ("none", "scaling", "reluctance", "circuit", "free")

CIRCUIT = (
    ParameterSpec("c_H", "drive of the iron for a unit of input", low=0.0, coordinate="reciprocal"),
    ParameterSpec(
        "rho",
        "reluctance of the gap over that of an air-filled iron path",
        low=0.0,
        closed=True,
        default=0.0,
    ),
    ParameterSpec("gamma", "eddy currents, 0 for none", low=0.0, closed=True, default=0.0),
    ParameterSpec(
        "c_out",
        "output for a unit of flux density (squared for a force)",
        low=0.0,
        coordinate="log",
    ),
    ParameterSpec("in_0", "offset of the input", default=0.0),
    ParameterSpec("out_0", "offset of the output", default=0.0),
)
"""What surrounds the iron, the same whatever the law; units depend on input and output."""

_SURROUNDS = frozenset({"c_out", "in_0", "out_0", "gamma"})

MAY_VARY: Mapping[GapMap, frozenset[str]] = MappingProxyType(
    {
        "none": frozenset(),
        "scaling": _SURROUNDS | {"c_H"},
        "reluctance": _SURROUNDS | {"rho"},
        "circuit": _SURROUNDS | {"rho"},
    }
)
"""What each gap map but ``free`` allows to run over the scheduling variable; ``free`` allows all."""


def specs_of(law: Law) -> dict[str, ParameterSpec]:
    """Return every parameter of a model with this law by name, in the order of the file."""
    return {spec.name: spec for spec in (*law.parameters, *CIRCUIT)}


@dataclass(frozen=True, slots=True)
class Problem:
    """One thing wrong with a set of parameters."""

    key: str
    text: str
    code: str


def find_problems(
    law: Law, parameters: Mapping[str, Parameter], nodes: Sequence[float], gap_map: GapMap
) -> list[Problem]:
    """Find everything that is wrong with a set of parameters."""
    problems = []
    if gap_map not in GAP_MAPS:
        text = f"is {gap_map!r}; use one of {', '.join(GAP_MAPS)}"
        return [Problem("gap_map", text, code="unknown-choice")]
    steps = np.diff(np.asarray(nodes, dtype=np.float64))
    if not np.isfinite(steps).all() or (steps <= 0.0).any():
        text = "must be finite and ascend, without repeats"
        problems.append(Problem("nodes", text, code="not-ascending"))
    specs = specs_of(law)
    for name, spec in specs.items():
        value = parameters.get(name)
        if value is None:
            if spec.default is None:
                problems.append(Problem(name, "is missing", code="missing"))
            continue
        values = value if isinstance(value, tuple) else (value,)
        if isinstance(value, tuple):
            if len(value) != len(nodes):
                text = f"has {len(value)} values for {len(nodes)} nodes; give one for each node"
                problems.append(Problem(name, text, code="length-differs"))
            if gap_map != "free" and name not in MAY_VARY[gap_map]:
                text = f"may not vary with the gap map '{gap_map}'; give a single number"
                problems.append(Problem(name, text, code="may-not-vary"))
        wrong = next(filter(None, (spec.problem(single) for single in values)), None)
        if wrong is not None:
            problems.append(Problem(name, wrong, code="out-of-range"))
    unknown = [name for name in parameters if name not in specs]
    problems.extend(Problem(name, "is unknown", code="extra-forbidden") for name in unknown)
    return problems


@dataclass(frozen=True, slots=True)
class Circuit:
    """What surrounds the iron, one value a sample (scheduling variable already looked up)."""

    turns: FloatArray  # c_H, A/m per unit of the input
    rho: FloatArray
    eddy: FloatArray
    c_out: FloatArray
    in_0: FloatArray
    out_0: FloatArray
    map: OutputMap

    def magnetomotive(self, drive: FloatArray) -> FloatArray:
        """Drive in units of the input -> drive of the core, A/m."""
        with np.errstate(over="ignore"):  # the core refuses what is not finite, and says where
            product: FloatArray = self.turns * (drive - self.in_0)
        return product

    def drive(self, magnetomotive: FloatArray) -> FloatArray:
        """Drive of the core, A/m -> drive in units of the input."""
        return magnetomotive / self.turns + self.in_0

    def output(self, flux_density: FloatArray) -> FloatArray:
        """Flux density, T -> output in its own unit."""
        return self.c_out * self.map.shape(flux_density) + self.out_0

    def flux_density(self, demand: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Demanded output -> flux density, T, and whether the demand can be reached.

        An even output has two answers; the positive one is taken. Below ``out_0`` it has none: the
        flux density is then zero and the flag False.
        """
        shaped = (demand - self.out_0) / self.c_out
        if not self.map.even:
            return shaped, np.ones(shaped.shape, dtype=np.bool_)
        return np.sqrt(np.maximum(shaped, 0.0)), shaped >= 0.0
