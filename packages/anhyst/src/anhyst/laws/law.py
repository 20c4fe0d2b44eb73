"""What the rest of anhyst knows of a hysteresis law: its parameters, and how to run and to fit it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Protocol

if TYPE_CHECKING:
    from anhyst._core import Operator
    from anhyst.laws.cells import CellWeights
    from anhyst.support.numeric import FloatArray

Coordinate = Literal["reciprocal", "log", "plain"]
"""In what a parameter is nearest to straight over a gap, and a search moves it."""

Role = Literal["saturation", "pinning", "reversible", "dead band", ""]
"""What a parameter is for whoever does not know its law: what drifts, what a rig may widen."""


@dataclass(frozen=True, slots=True)
class ParameterSpec:
    """One parameter of a model."""

    name: str  # as in a model file, without its unit
    meaning: str  # in a few words
    unit: str = "1"  # SI; "1" for a pure number
    low: float = -math.inf  # Range. ``closed`` says whether the ends belong to it.
    high: float = math.inf
    closed: bool = False
    default: float | None = None  # what it is where it is left out; None: it must be given
    coordinate: Coordinate = "plain"  # of the curve over the scheduling variable
    # range of a search without a kernel in the core, of ``A/m`` in parts of the largest field that
    # is applied; None: held at its default
    search: tuple[float, float] | None = None
    role: Role = ""  # what it is for whoever does not know the law

    def find_problem(self, value: float) -> str | None:
        """Return what is wrong with a value, if anything is."""
        if not math.isfinite(value):
            return "is not a finite number"
        inside = self.low <= value <= self.high if self.closed else self.low < value < self.high
        if inside:
            return None
        if math.isfinite(self.low) and math.isfinite(self.high):
            return f"must lie within {self.low:g} and {self.high:g}, is {value:g}"
        if math.isfinite(self.high):
            return f"must be below {self.high:g}, is {value:g}"
        if self.closed:
            return f"must not be negative, is {value:g}"
        return f"must be above {self.low:g}, is {value:g}"


class IronOperator(Protocol):
    """The iron of a model over whole records; `anhyst._core.Iron` is one.

    ``rho`` is the reluctance ratio of the gap and ``eddy`` the rate ``gamma/dt`` of each sample.
    Status 0 is success, other codes those of the core; ``index`` is the first sample without a
    result.
    """

    def forward(
        self, drive: FloatArray, rho: FloatArray, eddy: FloatArray, state: FloatArray, /
    ) -> tuple[FloatArray, FloatArray, FloatArray, int, int]:
        """From the drive, A/m: return flux density (T), field (A/m), state after, status, index."""

    def inverse(
        self, flux_density: FloatArray, rho: FloatArray, eddy: FloatArray, state: FloatArray, /
    ) -> tuple[FloatArray, FloatArray, FloatArray, int, int]:
        """From the flux density, T: return drive (A/m), field (A/m), state after, status, index."""

    def settle(
        self,
        inputs: FloatArray,
        rho: FloatArray,
        eddy: FloatArray,
        state: FloatArray,
        inverse: bool = False,
        max_cycles: int = 10000,
        tol: float = 1e-12,
        /,
    ) -> tuple[FloatArray, int, int]:
        """Repeat a cycle till it closes; return state, cycles, status."""


@dataclass(frozen=True, slots=True)
class FitParameter:
    """One number that a fit moves."""

    name: str  # of the number; the meaning in the symbols of a model file, or in words
    meaning: str
    low: float  # bounds of a search, in units of ``of``
    high: float
    # in which it is moved: its logarithm, its inverse hyperbolic sine, or itself over its unit
    coordinate: Literal["log", "asinh", "plain"] = "plain"
    # its unit is the span of the measured input or output; nothing for a pure number
    unit_of: Literal["input", "output", ""] = ""
    # what it is to be expected at, where loops leave it open; None: nothing is expected
    prior_mean: float | None = None
    prior_std: float = 1.5  # standard deviation of the coordinate around that


@dataclass(frozen=True, slots=True)
class Kernel:
    """How the core follows a law of Jiles and Atherton where ``M_s = a = 1``, for the fast fit."""

    # builds it from ``kappa = k/a``, ``c``, the half-width of its play and ``omega``
    make_operator: Callable[[float, float, float, float], Operator]
    fit_parameters: tuple[
        FitParameter, ...
    ]  # what a fit moves of the law itself: ``kappa`` and ``c``
    has_derivatives: bool  # whether the core gives its derivatives; else differences stand for them
    # whether the interaction enters the law itself: then a reluctance in series with the iron is
    # not the same as less interaction
    is_coupled: bool

    def iron_parameters(
        self, saturation: float, width: float, law: tuple[float, ...], alpha: float
    ) -> dict[str, float]:
        """Return the parameters of an iron, from its scales and what was fitted."""
        kappa, c = law
        return {"M_s": saturation, "a": width, "k": kappa * width, "c": c, "alpha": alpha}

    def scale_internal_field(self, iron: dict[str, float], part: float) -> None:
        """Take the field inside an iron without interaction to a part of itself, by interaction."""
        iron["alpha"] = 1.0 - part
        iron["a"] *= part
        iron["k"] *= part

    def dead_band_parameter(self, iron: Mapping[str, float], part: float) -> dict[str, float]:
        """Return the parameter of a dead band that is a part of the pinning."""
        return {"r_d": part * iron["k"]}


@dataclass(frozen=True, slots=True)
class Law:
    """A hysteresis law."""

    name: str  # as in model files and on the command line
    title: str  # for a reader
    parameters: tuple[ParameterSpec, ...]  # of the iron, in the order of the file
    # builds the iron from its parameters, in that order; ValueError where they are refused
    iron: Callable[..., IronOperator]
    states: int = 3  # Numbers that the iron remembers; all are zero where it is demagnetised
    # for the fast fit; without one, any law is fitted through its iron, by differences
    kernel: Kernel | None = None
    # From the parameters of the iron and the reluctance ratios of the gap: the least slope of the
    # drive over the field, in that without iron. Without it there is no compensator.
    least_slope: Callable[[Mapping[str, float], FloatArray], FloatArray] | None = None
    # why there is none, to complete the sentence "cannot be compiled: ..."
    obstacle: str = "there is no compensator for it"
    # The same law with its cells given, in place of the parameters that describe them; None for a
    # law without cells. ValueError where they are none of its own.
    of_cells: Callable[[CellWeights], Law] | None = None
    # the cells of an iron by its parameters; None for a law without cells
    cells: Callable[[Mapping[str, float]], CellWeights] | None = None
    # whether a cycle, however often it is run, leaves in memory what was larger than it
    remembers: bool = False

    def with_role(self, role: Role) -> tuple[ParameterSpec, ...]:
        """Return the parameters that play a role."""
        return tuple(spec for spec in self.parameters if spec.role == role)
