"""Data of a model: law, parameters over the gap, circuit, history, valid range and origin.

A hysteresis law relates the field ``H`` to the flux density ``B`` of the iron. The magnetic circuit
connects them to the input and the output (docs/theory.md)::

    c_H(gap) * (input - in_0) = H + rho(gap) * B / mu0 + gamma * dB/dt
    output                    = c_out(gap) * B**power + out_0

``c_H`` and ``c_out`` are scale factors, ``in_0`` and ``out_0`` offsets, ``rho`` the reluctance of
the gap, and ``gamma`` the effect of eddy currents. ``power`` is 2 for a force and magnetostriction,
else 1. A parameter is a number, or one number for each node of the scheduling variable
(interpolation: :mod:`anhyst.model.parameters`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, lru_cache, partial
from types import MappingProxyType
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from anhyst.data.output_map import output_map
from anhyst.data.path import History
from anhyst.laws import DEFAULT_LAW, LAWS, get_law
from anhyst.laws.cells import CellWeights
from anhyst.laws.law import IronOperator, Law, ParameterSpec
from anhyst.model import schema
from anhyst.model.dynamics import Dynamics, EddyCircuit, Layers
from anhyst.model.flux_map import FluxMap
from anhyst.model.parameters import (
    CIRCUIT_SPECS,
    Circuit,
    Curve,
    GapMap,
    Parameter,
    find_problems,
    parameter_specs,
)
from anhyst.support.errors import InputError, wrong_key
from anhyst.support.numeric import FloatArray
from anhyst.support.units import Quantity

MAX_CACHED_SAMPLES = 1 << 13
MAX_CACHED_ROWS = 32
"""Largest number of samples of a cached look-up over the scheduling variable, and number of cached
look-ups."""

MAX_COMPILED_LAYERS = 4
"""Largest number of layers of a compensator."""
MIN_SLOPE = 1e-3
"""Smallest slope of the drive over the field, relative to the slope without iron. No measured loop
and no 16-bit word can distinguish smaller values from a jump."""


@lru_cache(maxsize=256)
def _cached_iron(
    law: Law, eddy_settings: Layers | tuple[float, float, float] | None, *parameters: float
) -> IronOperator:
    from anhyst._core import AnyIron

    try:
        iron = law.iron(*parameters)
        if eddy_settings is not None:
            if not isinstance(iron, AnyIron):
                raise ValueError(f"layers and eddy circuits need a law of the core, not {law.name}")
            if isinstance(eddy_settings, Layers):
                iron.make_solid(eddy_settings.count, eddy_settings.surface, eddy_settings.laminated)
            else:
                iron.set_eddy_circuit(*eddy_settings)
        return iron
    except ValueError as error:
        raise InputError(
            f"model parameters: {error}", code="parameters-out-of-range", key="parameters"
        ) from error


@dataclass(frozen=True)
class ModelData:
    """A complete model: law, parameters, gap map, output map, history, valid range, origin.

    Parameters
    ----------
    name : str
        Free text.
    law : str
        Name of the law, one of :data:`anhyst.laws.LAWS`.
    input, output : Quantity
        Quantities of the drive and of the output.
    parameters : mapping of str to float or tuple of float
        SI; a tuple has one value for each node. Those of the law, and ``rho``, a pure number,
        ``c_H`` in A/m per unit of the input, ``gamma`` in A s/(m T), ``c_out`` in units of the
        output per T (per T^2 for a force), ``in_0, out_0`` in units of input and output.
        Parameters with a default may be missing.
    gap_map : str
        ``"none"``, ``"scaling"``, ``"reluctance"``, ``"circuit"`` or ``"free"``.
    schedule : Quantity or None
        The scheduling variable.
    nodes : tuple of float
        Scheduling values at which parameters were found, ascending, SI.
    history : History
        Default history before the first sample.
    valid : ValidRange or None
        Measured ranges.
    fit, uncertainty, reduction, provenance
        Records of the identification; see :mod:`anhyst.model.schema`.
    cells : CellWeights or None
        Cells of a law with cells, instead of the parameters that describe them.
    dynamics : Dynamics or None
        Lag and creep; None for an actuator without them.
    layers : Layers or None
        Layers of solid iron; None if the field is the same throughout.
    eddy_circuit : EddyCircuit or None
        Leakage and excess loss of the eddy currents in iron without layers, with a constant
        ``gamma`` above 0; None if the eddy currents are a single lag.

    Raises
    ------
    InputError
        A parameter is missing, unknown, out of range or has the wrong number of values.
    """

    name: str
    input: Quantity
    output: Quantity
    parameters: Mapping[str, Parameter]
    law: str = DEFAULT_LAW
    gap_map: GapMap = "none"
    schedule: Quantity | None = None
    nodes: tuple[float, ...] = ()
    history: History = field(default_factory=lambda: History("demagnetised"))
    valid: schema.ValidRange | None = None
    fit: schema.FitFigures | None = None
    uncertainty: schema.Uncertainty | None = None
    reduction: tuple[schema.ReductionStep, ...] = ()
    provenance: schema.Provenance = field(default_factory=schema.Provenance)
    cells: CellWeights | None = None
    dynamics: Dynamics | None = None
    layers: Layers | None = None
    eddy_circuit: EddyCircuit | None = None
    flux: FluxMap | None = None

    def __post_init__(self) -> None:
        parameters: dict[str, Parameter] = {}
        for name, value in self.parameters.items():
            numbers = np.asarray(value, dtype=np.float64)
            parameters[name] = tuple(numbers.tolist()) if numbers.ndim else float(numbers)
        nodes = tuple(float(node) for node in self.nodes)
        object.__setattr__(self, "nodes", nodes)
        if self.law not in LAWS:
            raise wrong_key("law", f"is {self.law!r}; use one of {', '.join(LAWS)}", code="unknown-choice")
        try:
            law = self.operator_law
        except ValueError as error:
            raise InputError(f"model cells: {error}", code="cells-out-of-range", key="cells") from error
        problems = find_problems(law, parameters, nodes, self.gap_map)
        if problems:
            text = f"model parameter {problems[0].key}: {problems[0].text}"
            raise InputError(text, code=problems[0].code, key=problems[0].key)
        if nodes and self.schedule is None:
            raise wrong_key("model", "there are nodes but no scheduling variable; add it", code="no-schedule")
        complete_parameters = {
            name: parameters.get(name, 0.0 if spec.default is None else spec.default)
            for name, spec in self.specs.items()
        }
        object.__setattr__(self, "parameters", MappingProxyType(complete_parameters))

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle by value: caches and the read-only view of the parameters cannot be pickled."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return partial(type(self), **values | {"parameters": dict(self.parameters)}), ()

    @cached_property
    def specs(self) -> Mapping[str, ParameterSpec]:
        """Every parameter by name, in the order of the file."""
        return parameter_specs(self.operator_law)

    @cached_property
    def operator_law(self) -> Law:
        """The law, with the play cells of the model if it has any."""
        return get_law(self.law, self.cells)

    @property
    def states(self) -> int:
        """Number of states of the iron; all are zero in the demagnetised state."""
        copies = self.layers.state_copies if self.layers else 1
        return self.operator_law.states * copies + (
            self.eddy_circuit.state_numbers if self.eddy_circuit else 0
        )

    @cached_property
    def file_keys(self) -> schema.Names:
        """Keys of the parameters in a file, without and with their unit."""
        return schema.parameter_names(self.operator_law, self.input, self.output)

    @property
    def power(self) -> int:
        """Power of the flux density in the output."""
        return output_map(self.output).power

    @cached_property
    def varying(self) -> tuple[str, ...]:
        """Names of the parameters whose values differ between nodes."""
        return tuple(
            name
            for name, value in self.parameters.items()
            if isinstance(value, tuple) and len(set(value)) > 1
        )

    @cached_property
    def needs_fixed_gap(self) -> bool:
        """Whether the scheduling variable must be constant in a run (gap map ``free``)."""
        law_names = {spec.name for spec in self.operator_law.parameters}
        return not law_names.isdisjoint(self.varying)

    @property
    def needs_schedule(self) -> bool:
        """Whether a run needs the values of the scheduling variable."""
        return bool(self.varying)

    @property
    def needs_time(self) -> bool:
        """Whether a run needs the times of its samples."""
        has_dynamics = self.dynamics is not None and self.dynamics.needs_time
        return has_dynamics or self.has_eddy_currents

    @cached_property
    def has_eddy_currents(self) -> bool:
        """Whether the iron has eddy currents."""
        return bool(np.any(self.parameters["gamma"]))

    @property
    def has_lag(self) -> bool:
        """Whether eddy currents are those of one layer, which every kind of compensator supports."""
        return self.has_eddy_currents and self.layers is None

    @property
    def has_layers(self) -> bool:
        """Whether a compensator supports the layers of the iron.

        There is no air gap between layers, so iron that jumps without an air gap is not supported.
        """
        law = self.operator_law
        if self.layers is None or law.cells is None or law.least_slope is None:
            return False
        if self.layers.count > MAX_COMPILED_LAYERS or self.needs_fixed_gap or "gamma" in self.varying:
            return False
        return not self.can_jump_without_gap

    @property
    def can_jump_without_gap(self) -> bool:
        """Whether the flux of the iron would jump without an air gap."""
        slope_function = self.operator_law.least_slope
        iron = self.parameters_at(self.first_node)
        return slope_function is not None and float(slope_function(iron, np.zeros(1)).min()) < MIN_SLOPE

    @property
    def valid_range(self) -> schema.ValidRange:
        """The valid range; a model without one raises `InputError`."""
        if self.valid is None:
            text = "the model has no valid range ([valid]); identify it from loops"
            raise InputError(text, code="no-valid-range", key="valid")
        return self.valid

    @property
    def first_node(self) -> float | None:
        """Scheduling value for evaluating constant parameters; None without nodes."""
        return self.nodes[0] if self.nodes else None

    @property
    def at_rest(self) -> Self:
        """The quasi-static model: without lag, creep and eddy currents."""
        if self.dynamics is None and not self.has_eddy_currents:
            return self
        parameters = dict(self.parameters) | {"gamma": 0.0}
        return replace(self, parameters=parameters, layers=None, eddy_circuit=None, dynamics=None)

    @cached_property
    def curves(self) -> Mapping[str, Curve]:
        """Curves over the scheduling variable of all varying parameters."""
        nodes = np.array(self.nodes)
        return {
            name: Curve(name, nodes, np.array(self.parameters[name]), self.specs[name].coordinate)
            for name in self.varying
        }

    def interpolate_parameter(self, name: str, schedule: ArrayLike) -> FloatArray:
        """Return a parameter of :attr:`specs` at scheduling values; all in SI, shape (n,).

        `InputError` is raised if extrapolation beyond the nodes leaves the range of the parameter.
        """
        query = np.atleast_1d(np.asarray(schedule, dtype=np.float64))
        if name in self.curves and query.size:
            values = self.curves[name](query)
            for extreme_value in (values.min(), values.max()):
                if problem := self.specs[name].find_problem(float(extreme_value)):
                    raise InputError(
                        f"{name} {problem}, in the extrapolation beyond the nodes "
                        f"{self.nodes[0]:g} to {self.nodes[-1]:g}; stay closer to them",
                        code="too-far-beyond-nodes",
                        key=name,
                    )
            return values
        value = self.parameters[name]
        return np.full(query.shape, value[0] if isinstance(value, tuple) else value)

    def parameters_at(self, schedule: float | None = None) -> dict[str, float]:
        """Return all parameters at one value of the scheduling variable, SI.

        The value may be omitted if no parameter varies; otherwise, `InputError` is raised.
        """
        gap = np.array([self.schedule_or_default(schedule)])
        return {name: float(self.interpolate_parameter(name, gap)[0]) for name in self.specs}

    def schedule_or_default(self, schedule: float | None) -> float:
        """Return the scheduling value; raise `InputError` if it is missing but needed."""
        if schedule is not None:
            return float(schedule)
        if self.needs_schedule:
            assert self.schedule is not None
            raise InputError(
                f"the model depends on {self.schedule.name}: give its values, in a file as column "
                f"{self.schedule.column}",
                code="schedule-missing",
                key=self.schedule.column,
            )
        return self.nodes[0] if self.nodes else 0.0

    def iron_at(self, schedule: float | None = None) -> IronOperator:
        """Return the iron at a scheduling value (SI); it has no state, so users can share it."""
        if self.needs_fixed_gap:
            return self._iron(self.schedule_or_default(schedule))
        return self._iron_everywhere

    @cached_property
    def _iron_everywhere(self) -> IronOperator:
        return self._iron(0.0)

    def _iron(self, schedule: float) -> IronOperator:
        gap, law = np.array([schedule]), self.operator_law
        values = (float(self.interpolate_parameter(spec.name, gap)[0]) for spec in law.parameters)
        return _cached_iron(law, self.core_eddy_circuit or self.layers, *values)

    @property
    def core_eddy_circuit(self) -> tuple[float, float, float] | None:
        """The numbers of `AnyIron.set_eddy_circuit`, or None without an eddy circuit.

        `InputError` is raised if ``gamma`` varies or is 0, and for layers.
        """
        if self.eddy_circuit is None:
            return None
        gamma = self.parameters["gamma"]
        if isinstance(gamma, tuple) or not gamma > 0.0 or self.layers is not None:
            raise InputError(
                "an eddy circuit needs one gamma above 0 and no layers",
                code="out-of-range",
                key="eddy_circuit",
            )
        return self.eddy_circuit.core_settings(gamma)

    def circuit(self, schedule: FloatArray | None, eddy_rate: FloatArray) -> Circuit:
        """Return the circuit at each sample; ``eddy_rate`` is 1/dt, 0 without eddy currents."""
        gaps = schedule
        if gaps is None:
            gaps = np.full(eddy_rate.shape, self.schedule_or_default(None))
        # Searches evaluate the same few scheduling values repeatedly.
        key, cache = gaps.tobytes() if gaps.size <= MAX_CACHED_SAMPLES else b"", self._cached_rows
        rows = cache.get(key) or tuple(self.interpolate_parameter(spec.name, gaps) for spec in CIRCUIT_SPECS)
        if key and key not in cache:
            for values in rows:
                values.flags.writeable = False
            if len(cache) >= MAX_CACHED_ROWS:
                cache.clear()
            cache[key] = rows
        c_h, rho, gamma, c_out, in_0, out_0 = rows
        return Circuit(c_h, rho, gamma * eddy_rate, c_out, in_0, out_0, output_map(self.output))

    @cached_property
    def _cached_rows(self) -> dict[bytes, tuple[FloatArray, ...]]:
        """Cached circuit parameters by rows of the scheduling variable."""
        return {}
