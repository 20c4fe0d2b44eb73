"""Define the interface of a hysteresis law: its parameters, its simulation and its fit.

A :class:`Law` describes its parameters and makes an iron object, which simulates whole records. A
law with a :class:`Kernel` has a fast fit in gauge-free (not redundant) parameters. A law without a
kernel is fitted by simulating its iron object.
"""

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
"""Coordinate in which a parameter is interpolated over the gap and varied in a search."""

Role = Literal["saturation", "pinning", "reversible", "dead band", ""]
"""Physical role of a parameter in any law: used to simulate drift, and to widen a dead band."""


@dataclass(frozen=True, slots=True)
class ParameterSpec:
    """One parameter of a model."""

    name: str  # name in a model file, without its unit
    meaning: str  # meaning of the parameter in a few words
    unit: str = "1"  # SI unit; "1" for a pure number
    low: float = -math.inf  # range; ``includes_bounds`` states whether it includes its ends
    high: float = math.inf
    includes_bounds: bool = False
    default: float | None = None  # default of a missing value; None: a value is required
    coordinate: Coordinate = "plain"  # coordinate for interpolation over the scheduling variable
    # search range for laws without a kernel, in ``A/m`` relative to the largest applied field;
    # None: fixed at its default
    search: tuple[float, float] | None = None
    role: Role = ""  # physical role of the parameter

    def find_problem(self, value: float) -> str | None:
        """Return the fault of a parameter value, or None."""
        if not math.isfinite(value):
            return "is not a finite number"
        is_in_range = self.low <= value <= self.high if self.includes_bounds else self.low < value < self.high
        if is_in_range:
            return None
        if math.isfinite(self.low) and math.isfinite(self.high):
            return f"must lie within {self.low:g} and {self.high:g}, is {value:g}"
        if math.isfinite(self.high):
            return f"must be below {self.high:g}, is {value:g}"
        if self.includes_bounds:
            return f"must not be negative, is {value:g}"
        return f"must be above {self.low:g}, is {value:g}"


class IronOperator(Protocol):
    """The iron of a model for whole records; `anhyst._core.Iron` is one.

    ``rho`` is the reluctance ratio of the gap and ``eddy`` the rate ``gamma/dt`` of each sample.
    Status 0 is success, other values are the codes of the core; ``index`` is the first sample
    without a result.
    """

    def forward(
        self, drive: FloatArray, rho: FloatArray, eddy: FloatArray, state: FloatArray, /
    ) -> tuple[FloatArray, FloatArray, FloatArray, int, int]:
        """Return flux density (T), field (A/m), final state, status and index for a drive, A/m."""

    def inverse(
        self, flux_density: FloatArray, rho: FloatArray, eddy: FloatArray, state: FloatArray, /
    ) -> tuple[FloatArray, FloatArray, FloatArray, int, int]:
        """Return drive (A/m), field (A/m), final state, status and index for a flux density, T."""

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
        """Repeat a cycle until it closes; return state, cycles, status."""


@dataclass(frozen=True, slots=True)
class FitParameter:
    """One parameter of a fit, with its bounds and its prior."""

    name: str  # name, and meaning in symbols of a model file or in words
    meaning: str
    low: float  # bounds of a search, in the unit of the parameter
    high: float
    # coordinate: logarithm, inverse hyperbolic sine, or value relative to its unit
    coordinate: Literal["log", "asinh", "plain"] = "plain"
    # signal whose measured range is the unit of the parameter; empty for a pure number
    unit_signal: Literal["input", "output", ""] = ""
    # prior mean, if loops do not determine the value; None: no prior
    prior_mean: float | None = None
    prior_std: float = 1.5  # prior standard deviation of the coordinate


@dataclass(frozen=True, slots=True)
class Kernel:
    """Functions of the core for a Jiles-Atherton law with ``M_s = a = 1``, for the fast fit."""

    # builds the law from ``kappa = k/a``, ``c``, the half-width of its play and ``omega``
    make_operator: Callable[[float, float, float, float], Operator]
    fit_parameters: tuple[FitParameter, ...]  # fit parameters of the law itself: ``kappa`` and ``c``
    has_derivatives: bool  # whether the core computes derivatives; otherwise, finite differences are used
    # whether the interaction enters the law itself; a series reluctance is then not equivalent to
    # less interaction
    includes_interaction: bool

    def iron_parameters(
        self, saturation: float, width: float, law: tuple[float, ...], alpha: float
    ) -> dict[str, float]:
        """Return the physical parameters of the iron, from its scales and the fitted parameters."""
        pinning_ratio, c = law
        return {"M_s": saturation, "a": width, "k": pinning_ratio * width, "c": c, "alpha": alpha}

    def scale_internal_field(self, iron: dict[str, float], factor: float) -> None:
        """Scale the internal field of an iron without interaction by adding interaction."""
        iron["alpha"] = 1.0 - factor
        iron["a"] *= factor
        iron["k"] *= factor

    def dead_band_parameter(self, iron: Mapping[str, float], ratio: float) -> dict[str, float]:
        """Return the parameter of a dead band whose half-width is a fraction of the pinning."""
        return {"r_d": ratio * iron["k"]}


@dataclass(frozen=True, slots=True)
class Law:
    """A hysteresis law."""

    name: str  # name in model files and on the command line
    title: str  # name in reports
    parameters: tuple[ParameterSpec, ...]  # parameters of the iron, in the order of the file
    # function that makes the iron from parameters in that order; ValueError if they are invalid
    iron: Callable[..., IronOperator]
    states: int = 3  # number of states; all are zero in the demagnetised state
    # kernel of the fast fit; None: the fit simulates the iron object and uses finite differences
    kernel: Kernel | None = None
    # smallest slope of the applied drive (A/m) over the field, relative to that without iron, for
    # iron parameters and reluctance ratios of the gap; None: the law has no compensator
    least_slope: Callable[[Mapping[str, float], FloatArray], FloatArray] | None = None
    # reason for the missing compensator, to complete the sentence "cannot be compiled: ..."
    no_compensator_reason: str = "there is no compensator for it"
    # function that makes the law with given cells instead of parameters, or raises ValueError if
    # they do not fit the law; None for a law without cells
    make_with_cells: Callable[[CellWeights], Law] | None = None
    # function that returns the cells for given parameters; None for a law without cells
    cells: Callable[[Mapping[str, float]], CellWeights] | None = None
    # whether large reversals remain in memory after any number of smaller cycles (return-point
    # memory)
    has_return_point_memory: bool = False

    def parameters_with_role(self, role: Role) -> tuple[ParameterSpec, ...]:
        """Return the parameters with a role."""
        return tuple(spec for spec in self.parameters if spec.role == role)
