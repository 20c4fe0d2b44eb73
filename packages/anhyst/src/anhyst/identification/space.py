"""Convert between the coordinates of a search and the parameters at each gap.

A coordinate vector has one entry for each parameter that is common to all gaps, and one entry per
gap for each gap-dependent parameter. The entries are in the order of the names in its
:class:`ResponseForm`. Positive parameters are exponentials of their coordinates; ``omega``, with
either sign and any size, is the hyperbolic sine.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, cast

import numpy as np
from numpy.typing import NDArray

from anhyst.identification.fit_records import FitRecords
from anhyst.identification.response import CIRCUIT_NAMES, ParameterSet, ResponseForm
from anhyst.laws import LAWS
from anhyst.laws.law import FitParameter, Kernel
from anhyst.model.parameters import GapMap
from anhyst.support.numeric import FloatArray

Coordinate = Literal["log", "asinh", "plain"]

GAP_DEPENDENT = {
    "none": frozenset[str](),
    "scaling": frozenset({"scale"}),
    "reluctance": frozenset({"omega"}),
    "leakage": frozenset({"omega"}),
    "circuit": frozenset({"omega", "gain", "in_0", "out_0"}),
    "free": frozenset(CIRCUIT_NAMES),
}
"""Gap-dependent parameters of each gap map; ``free`` also includes the law's parameters. If omega
is a reluctance, the input scale depends on it: ``scale = scale_0/(1 - h*omega)``, and 1/(1 -
h*omega) = 1 + rho."""

SERIES_MAPS = frozenset({"reluctance", "leakage", "circuit"})
"""Gap maps in which omega is a reluctance in series with the iron."""

FILE_GAP_MAPS = {"leakage": "circuit"}
"""Gap map in a model file, for maps with another name in a fit.

With a leakage path of permeance P parallel to the gap, the iron sees the reluctance ``omega = R/(1
+ P*R)``, and the gap carries the fraction ``1/(1 + P*R) = 1 - P*omega`` of its flux. One parameter
then gives the gain at every gap, ``gain_0*(1 - P*omega)**power``. The map ``circuit`` has one gain
per gap.
"""

LEAKAGE_PARAMETER = FitParameter(
    "leakage", "part of the flux beside the widest gap", -0.5, 0.9, prior_mean=0.0, prior_std=0.2
)
"""Fringing fields at the gap have the opposite effect, so the value may be negative."""

_MIN_OMEGA = 1e-6

MIN_GAP_FLUX_SHARE = 0.05  # smallest fraction of the iron's flux that passes the gap

CIRCUIT_PARAMETERS = (
    FitParameter("omega", "(w*M_s)/a", -30.0, 9e2, "asinh"),
    FitParameter("scale", "a/c_H", 1e-5, 1e2, "log", "input"),
    FitParameter("gain", "output at saturation", 1e-3, 1e4, "log", "output"),
    FitParameter("in_0", "input offset", -2.0, 2.0, unit_signal="input"),
    FitParameter("out_0", "output offset", -2.0, 2.0, unit_signal="output"),
)
"""Fit parameters of the circuit around the law."""


@dataclass(frozen=True)
class CoordinateSpace:
    """Coordinates of one identification."""

    gap_map: str  # key of :data:`GAP_DEPENDENT`
    records: FitRecords  # the fitted loops
    form: ResponseForm  # equations of the measured quantities
    # parameters fixed at zero: ``in_0``, ``out_0``, ``omega``
    fixed: frozenset[str] = frozenset()
    # parameters that are the same at every gap although the map allows different values
    common: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        if self.gap_map in SERIES_MAPS | {"scaling"}:
            # With a gap, the measured field is not the field in the iron and does not determine h.
            object.__setattr__(self, "form", replace(self.form, permeability=0.0))

    @cached_property
    def entries(self) -> tuple[tuple[str, int | None], ...]:
        """Name and gap of each coordinate; gap None if it is common to all gaps."""
        entries: list[tuple[str, int | None]] = []
        gap_dependent = GAP_DEPENDENT[self.gap_map] - self.common
        if self.gap_map == "free":
            gap_dependent |= {number.name for number in self.form.kernel.fit_parameters} - self.common
        for name in (*self.form.names, *(("leakage",) if self.gap_map == "leakage" else ())):
            if name in self.fixed:
                continue
            if name in gap_dependent:
                entries.extend((name, gap) for gap in range(self.records.gap_count))
            else:
                entries.append((name, None))
        return tuple(entries)

    def to_coordinate(self, name: str, value: float) -> float:
        """Return the coordinate of a parameter value, SI."""
        number = self.fit_parameters[name]
        if number.coordinate == "log":
            return float(np.log(value))
        return float(np.arcsinh(value)) if number.coordinate == "asinh" else value / self.unit(name)

    def to_parameters(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the parameters at coordinates, SI, and their derivatives."""
        log, asinh, units = self._coordinate_kinds
        values, slopes = theta * units, units.copy()
        values[log] = slopes[log] = np.exp(theta[log])
        values[asinh], slopes[asinh] = np.sinh(theta[asinh]), np.cosh(theta[asinh])
        return values, slopes

    @cached_property
    def _coordinate_kinds(self) -> tuple[NDArray[np.intp], NDArray[np.intp], FloatArray]:
        """Indices of logarithmic and inverse hyperbolic sine coordinates; units of all."""
        kinds = np.array([self.fit_parameters[name].coordinate for name, _ in self.entries])
        units = np.array([self.unit(name) for name, _ in self.entries])
        return np.flatnonzero(kinds == "log"), np.flatnonzero(kinds == "asinh"), units

    @cached_property
    def _coordinate_indices(self) -> NDArray[np.intp]:
        """Index of the coordinate of each parameter at each gap; -1 if it is fixed at zero."""
        column_of = {entry: index for index, entry in enumerate(self.entries)}
        return np.array(
            [
                [column_of.get((name, gap), column_of.get((name, None), -1)) for name in self.form.names]
                for gap in range(self.records.gap_count)
            ]
        )

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the coordinates, with the index of the gap in brackets if gap-dependent."""
        return tuple(n if gap is None else f"{n}[{gap}]" for n, gap in self.entries)

    @property
    def file_gap_map(self) -> GapMap:
        """Gap map of the model of a fit."""
        return cast("GapMap", FILE_GAP_MAPS.get(self.gap_map, self.gap_map))

    def leakage(self, theta: FloatArray) -> float:
        """Return the leakage per unit of omega, as a fraction of the iron's flux."""
        values, _ = self.to_parameters(theta)
        widest_gap_index = self.names.index(f"omega[{self.records.gap_count - 1}]")
        return float(values[self.names.index("leakage")] / max(values[widest_gap_index], _MIN_OMEGA))

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return len(self.entries)

    @cached_property
    def fit_parameters(self) -> dict[str, FitParameter]:
        """Fit parameters by name."""
        return {
            number.name: number
            for number in (*self.form.kernel.fit_parameters, *CIRCUIT_PARAMETERS, LEAKAGE_PARAMETER)
        }

    def unit(self, name: str) -> float:
        """Return the unit of a parameter in SI: range of the input or output, or 1."""
        spans = {"input": self.records.input_span, "output": self.records.output_span}
        return spans.get(self.fit_parameters[name].unit_signal, 1.0)

    @cached_property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds of the coordinates."""
        low, high = [], []
        for name, _ in self.entries:
            number, unit = self.fit_parameters[name], self.unit(name)
            low.append(self.to_coordinate(name, number.low * unit))
            high.append(self.to_coordinate(name, number.high * unit))
        return np.array(low), np.array(high)

    def pack(self, sets: list[ParameterSet]) -> FloatArray:
        """Return the coordinates of parameters at each gap; common ones are from the first gap."""
        theta = []
        gain, leakage = self._gain_and_leakage(sets)
        for name, gap in self.entries:
            parameter_set = sets[gap or 0]
            values = self.form.named_values(parameter_set) | {"leakage": leakage}
            value = gain if (name, self.gap_map) == ("gain", "leakage") else values[name]
            if name == "scale" and self.gap_map in SERIES_MAPS:
                value *= 1.0 - self.form.h * parameter_set.omega
            theta.append(self.to_coordinate(name, value))
        return np.asarray(np.clip(np.array(theta), *self.bounds))

    def _gain_and_leakage(self, sets: Sequence[ParameterSet]) -> tuple[float, float]:
        """Return gain without leakage, and leakage, that fit the gains of all gaps best."""
        omega = np.array([parameter_set.omega for parameter_set in sets])
        roots = np.array([parameter_set.gain for parameter_set in sets]) ** (1.0 / self.form.power)
        centred = omega - omega.mean()
        spread = float(centred @ centred)
        slope = float(centred @ roots) / spread if spread > 0.0 else 0.0
        closed_gap_root = float(roots.mean() - slope * omega.mean())
        if closed_gap_root <= 0.0 or slope == 0.0:
            return float(roots.mean()) ** self.form.power, 0.0
        return closed_gap_root**self.form.power, -slope / closed_gap_root * max(sets[-1].omega, _MIN_OMEGA)

    def without_gaps(self, withheld: Collection[int]) -> tuple[CoordinateSpace, NDArray[np.intp]]:
        """Return the space without some gaps, and the indices of its coordinates in this space."""
        indices = [index for index, (_, gap) in enumerate(self.entries) if gap not in withheld]
        return replace(self, records=self.records.without_gaps(withheld)), np.array(indices)

    def with_fixed(self, names: frozenset[str]) -> tuple[CoordinateSpace, NDArray[np.intp]]:
        """Return the space with more parameters fixed at zero, and its coordinate indices."""
        indices = [index for index, (name, _) in enumerate(self.entries) if name not in names]
        return replace(self, fixed=self.fixed | names), np.array(indices)

    def unpack(self, theta: FloatArray) -> list[tuple[ParameterSet, FloatArray]]:
        """Return the parameters at each gap, and their derivatives, shape (parameters, size)."""
        values, slopes = self.to_parameters(theta)
        parameter_sets = []
        for columns, at_gap in zip(
            self._coordinate_indices, np.append(values, 0.0)[self._coordinate_indices].tolist(), strict=True
        ):
            rows = np.flatnonzero(columns >= 0)
            jacobian = np.zeros((columns.size, theta.size))
            jacobian[rows, columns[rows]] = slopes[columns[rows]]
            if self.gap_map == "leakage":
                self._subtract_leakage(at_gap, jacobian, values, slopes)
            if self.gap_map in SERIES_MAPS:
                omega_row, row, _ = self._row_indices
                ratio = 1.0 / (1.0 - min(self.form.h * at_gap[omega_row], 0.99))
                at_gap[row] *= ratio
                jacobian[row] *= ratio
                jacobian[row] += at_gap[row] * ratio * self.form.h * jacobian[omega_row]
            parameter_sets.append((self.form.make_set(at_gap), jacobian))
        return parameter_sets

    @cached_property
    def _row_indices(self) -> tuple[int, int, int]:
        """Indices of omega, scale and gain among the parameters at one gap."""
        omega, scale, gain = (self.form.names.index(name) for name in ("omega", "scale", "gain"))
        return omega, scale, gain

    def _subtract_leakage(
        self, at_gap: list[float], jacobian: FloatArray, values: FloatArray, slopes: FloatArray
    ) -> None:
        """Apply the leakage to the gain of one gap, in place."""
        omega_row, _, row = self._row_indices
        power, leakage, widest = (self.form.power, len(values) - 1, self._coordinate_indices[-1, omega_row])
        omega = float(values[widest])
        ratio = at_gap[omega_row] / max(omega, _MIN_OMEGA)
        gap_share = max(1.0 - float(values[leakage]) * ratio, MIN_GAP_FLUX_SHARE)
        at_gap[row] *= gap_share**power
        jacobian[row] *= gap_share**power
        if gap_share > MIN_GAP_FLUX_SHARE and omega > _MIN_OMEGA:
            gain_derivative = power * at_gap[row] / gap_share
            jacobian[row] -= gain_derivative * values[leakage] / omega * jacobian[omega_row]
            jacobian[row, widest] += gain_derivative * values[leakage] * ratio / omega * slopes[widest]
            jacobian[row, leakage] -= gain_derivative * ratio * slopes[leakage]


def coordinate_kind(law: str, quantity: str) -> Coordinate:
    """Return the kind of coordinate of a quantity; the logarithm if its law does not state one."""
    kernel = LAWS[law].kernel
    numbers = (*(kernel.fit_parameters if isinstance(kernel, Kernel) else ()), *CIRCUIT_PARAMETERS)
    coordinates = {number.meaning: number.coordinate for number in numbers}
    meaning = max((m for m in coordinates if f"{quantity} ".startswith(f"{m} ")), key=len, default="")
    return coordinates.get(meaning, "log")
