"""The parameters of a model: their names, which may vary over the gap, and what is wrong with them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

import numpy as np

Parameter = float | tuple[float, ...]
Law = Literal["effective-field", "jiles-atherton-1986"]
GapMap = Literal["none", "scaling", "reluctance", "circuit", "free"]

LAWS: tuple[Law, ...] = ("effective-field", "jiles-atherton-1986")
GAP_MAPS: tuple[GapMap, ...] = ("none", "scaling", "reluctance", "circuit", "free")

OPERATOR = ("M_s", "a", "k", "c", "alpha", "r_d")
"""Parameters of the iron itself. While one of them changes, the state has no meaning."""

DEFAULTS: Mapping[str, float] = MappingProxyType(
    {"alpha": 0.0, "r_d": 0.0, "rho": 0.0, "gamma": 0.0, "in_0": 0.0, "out_0": 0.0}
)
"""Parameters that may be left out, and what they are then."""

PARAMETERS = ("M_s", "a", "k", "c", "alpha", "r_d", "c_H", "rho", "gamma", "c_out", "in_0", "out_0")
"""Every parameter, in the order of the file."""

MAY_VARY: Mapping[GapMap, frozenset[str]] = MappingProxyType(
    {
        "none": frozenset(),
        "scaling": frozenset({"c_H", "c_out", "in_0", "out_0", "gamma"}),
        "reluctance": frozenset({"rho", "c_out", "in_0", "out_0", "gamma"}),
        "circuit": frozenset({"rho", "c_out", "in_0", "out_0", "gamma"}),
        "free": frozenset(PARAMETERS),
    }
)
"""What each gap map allows to run over the scheduling variable."""


@dataclass(frozen=True, slots=True)
class Problem:
    """One thing wrong with a set of parameters."""

    key: str
    text: str


def range_problem(name: str, value: float) -> str | None:
    """Return what is wrong with one value of a parameter, if anything is."""
    if not np.isfinite(value):
        return "is not a finite number"
    if name in {"M_s", "a", "k", "c_H", "c_out"} and value <= 0.0:
        return f"must be above 0, is {value:g}"
    if name in {"r_d", "gamma", "rho"} and value < 0.0:
        return f"must not be negative, is {value:g}"
    if name == "c" and not 0.0 <= value <= 1.0:
        return f"must lie within 0 and 1, is {value:g}"
    if name == "alpha" and value >= 1.0:
        return f"must be below 1, is {value:g}"
    return None


def find_problems(
    parameters: Mapping[str, Parameter], nodes: Sequence[float], gap_map: GapMap
) -> list[Problem]:
    """Find everything that is wrong with a set of parameters.

    Parameters
    ----------
    parameters : mapping of str to float or tuple of float
        As in :class:`ActuatorModel`.
    nodes : sequence of float
        Nodes of the scheduling variable, SI.
    gap_map : str
        One of :data:`GAP_MAPS`.

    Returns
    -------
    list of Problem
        Empty if nothing is wrong. The key is a parameter, ``"nodes"`` or ``"gap_map"``.
    """
    problems = []
    if gap_map not in GAP_MAPS:
        return [Problem("gap_map", f"is {gap_map!r}; use one of {', '.join(GAP_MAPS)}")]
    steps = np.diff(np.asarray(nodes, dtype=np.float64))
    if not np.isfinite(steps).all() or (steps <= 0.0).any():
        problems.append(Problem("nodes", "must be finite and ascend, without repeats"))
    for name in PARAMETERS:
        value = parameters.get(name)
        if value is None:
            if name not in DEFAULTS:
                problems.append(Problem(name, "is missing"))
            continue
        values = value if isinstance(value, tuple) else (value,)
        if isinstance(value, tuple):
            if len(value) != len(nodes):
                text = f"has {len(value)} values for {len(nodes)} nodes; give one for each node"
                problems.append(Problem(name, text))
            if name not in MAY_VARY[gap_map]:
                text = f"may not vary with the gap map '{gap_map}'; give a single number"
                problems.append(Problem(name, text))
        texts = (range_problem(name, single) for single in values)
        problems.extend([Problem(name, text) for text in texts if text][:1])
    problems.extend(Problem(name, "is unknown") for name in parameters if name not in PARAMETERS)
    return problems
