"""Simulate a Jiles-Atherton law along one input record, with derivatives, in the gauge-free form.

The equations at one gap, in units of the law (docs/theory.md), are::

    xi + omega*m(xi) = (input - in_0)/scale,    output = gain*(m + h*xi)**power + out_0

``m`` is the law for ``M_s = a = 1``. The slope of the air core ``h`` is not fitted: with measured
field and flux density, it follows from ``scale`` and ``gain``; otherwise, no data determine it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from anhyst._core import Operator, demagnetised, langevin
from anhyst.identification.cell_kernel import CellKernel, CellPath, WeightKernel, require_solution
from anhyst.identification.fit_records import FitRecord, InputHistory
from anhyst.laws import DEFAULT_LAW, LAWS
from anhyst.laws.law import Kernel
from anhyst.support.errors import NoResponseError
from anhyst.support.numeric import FloatArray

CIRCUIT_NAMES = ("omega", "scale", "gain", "in_0", "out_0")
"""Parameters of the circuit around the law, in the order of the derivatives."""

PARAMETER_NAMES = ("kappa", "c", *CIRCUIT_NAMES)
"""Gauge-free parameters of a Jiles-Atherton law at one gap, in the same order."""

_DERIVATIVE_COUNT = 5  # kappa, c, omega, scale, in_0; derivatives computed by the core
_START_DERIVATIVE = 5  # index of the derivative with respect to a cycle's start state
_CLOSED_TOLERANCE = 1e-10
_NEARLY_CLOSED_TOLERANCE = 1e-5
_MAX_PASSES = 80
MAX_FLATNESS = 0.95
_PASSES_PER_EXTRAPOLATION = 4  # passes before each extrapolation to the steady state
_MAX_FIELD = 1e3  # effective field, in units of a, above that of any loop
_MAX_MAGNETISATION = 1.0 - 1e-6  # magnetisation below which x is within _MAX_FIELD


@dataclass(frozen=True, slots=True)
class ParameterSet:
    """Gauge-free parameters at one gap."""

    law: tuple[float, ...]  # parameters of the law, in the order of its kernel, dimensionless
    omega: float  # interaction of the law with the circuit, dimensionless
    scale: float  # input per unit of effective field, SI
    gain: float  # output at saturation, SI
    in_0: float  # offsets of input and output, SI
    out_0: float
    h: float  # slope of the air core, dimensionless

    @property
    def kappa(self) -> float:
        """Ratio k/a of pinning and shape parameter of a Jiles-Atherton law."""
        return self.law[0]

    @property
    def c(self) -> float:
        """Reversibility of a Jiles-Atherton law."""
        return self.law[1]


@dataclass(frozen=True, slots=True)
class ResponseForm:
    """Exponent of the output, hysteresis law, and rule for the slope ``h`` of the air core."""

    power: int  # 2 for a force, else 1
    law: str = DEFAULT_LAW  # name of a law with a kernel, or of play cells
    # parametrisation of play cells; None for another law
    cells: CellKernel | WeightKernel | None = None
    # mu_0 if field and flux density are measured, so that ``h = mu_0*scale/gain``; else 0
    permeability: float = 0.0
    h: float = 1e-3  # value of h if field or flux density is not measured
    # fixed half-width of the play before the irreversible part, relative to the pinning
    dead_band: float = 0.0

    @property
    def kernel(self) -> Kernel | CellKernel | WeightKernel:
        """Functions for simulating the law."""
        if self.cells is not None:
            return self.cells
        kernel = LAWS[self.law].kernel
        assert kernel is not None
        return kernel

    @property
    def names(self) -> tuple[str, ...]:
        """Gauge-free parameters at one gap, in the order of the derivatives."""
        return (*(number.name for number in self.kernel.fit_parameters), *CIRCUIT_NAMES)

    def named_values(self, parameter_set: ParameterSet) -> dict[str, float]:
        """Return the parameters of a set by name."""
        circuit_values = (getattr(parameter_set, name) for name in CIRCUIT_NAMES)
        return dict(zip(self.names, (*parameter_set.law, *circuit_values), strict=True))

    def make_set(self, values: Sequence[float]) -> ParameterSet:
        """Return a parameter set from values in the order of the names; ``h`` follows from them."""
        *law, omega, scale, gain, in_0, out_0 = values
        h = self.permeability * scale / gain if self.permeability > 0.0 else self.h
        return ParameterSet(tuple(law), omega, scale, gain, in_0, out_0, h)

    def make_operator(self, parameter_set: ParameterSet) -> Operator:
        """Build the law for a parameter set; in the law of 1986, interaction enters twice."""
        require_steepness([parameter_set])
        kernel = self.kernel
        assert isinstance(kernel, Kernel)
        try:
            play = self.dead_band * parameter_set.kappa
            return kernel.make_operator(parameter_set.kappa, parameter_set.c, play, parameter_set.omega)
        except ValueError as error:
            raise NoResponseError(str(error)) from error


def require_steepness(sets: Sequence[ParameterSet]) -> None:
    """Raise an error for sets whose curve would be almost as flat as the air core."""
    if max(parameter_set.h * parameter_set.omega for parameter_set in sets) > MAX_FLATNESS:
        raise NoResponseError("the curve would be almost as flat as the air core")


class Responder:
    """Simulator of records; it starts steady-state cycles from their last known start state."""

    def __init__(self) -> None:
        self._starts: dict[int, FloatArray] = {}

    def outputs(
        self, form: ResponseForm, sets: Sequence[ParameterSet], records: Sequence[FitRecord]
    ) -> list[FloatArray]:
        """Return the output of every record, SI."""
        operators = _make_operators(form, sets)
        return [self.output(form, sets[d.gap], operators[d.gap], d, sets) for d in records]

    def derivatives(
        self, form: ResponseForm, sets: Sequence[ParameterSet], records: Sequence[FitRecord]
    ) -> Iterator[tuple[int, FloatArray, FloatArray]]:
        """Yield gap, output and derivatives by :data:`PARAMETER_NAMES`, (n, 7), of every record."""
        operators = _make_operators(form, sets)
        for record in records:
            yield record.gap, *self.with_derivatives(form, sets, operators[record.gap], record)

    def output(
        self,
        form: ResponseForm,
        parameter_set: ParameterSet,
        operator: Operator,
        record: FitRecord,
        sets: Sequence[ParameterSet] = (),
    ) -> FloatArray:
        """Return the output of one record, shape (n,), SI, without derivatives.

        Without the sets of all gaps, the history counts as if it had happened at the record's gap.
        """
        r = (record.input - parameter_set.in_0) / parameter_set.scale
        omega = np.full(r.size, parameter_set.omega)
        state = demagnetised()
        if record.history.inputs.size and not record.is_cycle:
            omega_before, r_before = history_inputs(sets or (parameter_set,), record.history)
            _, _, state, status, _ = operator.run(omega_before, r_before, state)
            require_solution(status)
        elif record.is_cycle and id(record) in self._starts:
            state = _make_valid_state(self._starts[id(record)], form, parameter_set, float(r[-1]))
        x, m, final_state, status, _ = operator.run(omega, r, state)
        require_solution(status)
        cycle_ends = [float(state[1])]
        while (
            record.is_cycle
            and abs(final_state[1] - state[1]) > _CLOSED_TOLERANCE
            and len(cycle_ends) < _MAX_PASSES
        ):
            cycle_ends.append(float(final_state[1]))
            state = final_state
            if len(cycle_ends) % _PASSES_PER_EXTRAPOLATION == 0:
                state = _make_valid_state(
                    _extrapolate_cycle(final_state, cycle_ends), form, parameter_set, float(r[-1])
                )
            x, m, final_state, status, _ = operator.run(omega, r, state)
            require_solution(status)
        if record.is_cycle:
            self._starts[id(record)] = final_state
        return np.asarray(parameter_set.gain * (m + parameter_set.h * x) ** form.power + parameter_set.out_0)

    def with_derivatives(
        self, form: ResponseForm, sets: Sequence[ParameterSet], operator: Operator, record: FitRecord
    ) -> tuple[FloatArray, FloatArray]:
        """Return output, (n,), and derivatives by :data:`PARAMETER_NAMES`, (n, 7), of a record."""
        parameter_set = sets[record.gap]
        if record.is_cycle:
            path = self._follow_cycle(form, parameter_set, operator, record)
        else:
            path = _follow_record(form, sets, operator, record)
        return output_derivatives(form, [parameter_set], np.zeros(record.input.size, dtype=np.intp), path)

    def _follow_cycle(
        self, form: ResponseForm, parameter_set: ParameterSet, operator: Operator, record: FitRecord
    ) -> CellPath:
        """Close the cycle by Newton's method on the state y before the first sample."""
        terms = _SolverInputs(form, parameter_set, record.input, _DERIVATIVE_COUNT + 1)
        state = self._starts.get(id(record))
        if state is None:
            _, _, state, status, _ = operator.run(terms.omega, terms.r, demagnetised())
            require_solution(status)
        state = _make_valid_state(state, form, parameter_set, float(terms.r[-1]))
        for _ in range(_MAX_PASSES):
            tangents = _start_derivatives(form, parameter_set, terms, state)
            x, m, x_t, m_t, final_state, tangents_after, status, _ = operator.sensitivity(
                terms.omega, terms.r, terms.omega_t, terms.r_t, terms.law_t, state, tangents
            )
            require_solution(status)
            remaining_share = min(float(tangents_after[_START_DERIVATIVE, 1]), 0.999)
            mismatch = (final_state[1] - state[1]) / (1.0 - remaining_share)
            if abs(mismatch) < _NEARLY_CLOSED_TOLERANCE:
                break
            start = final_state + remaining_share * mismatch * tangents[_START_DERIVATIVE]
            state = _make_valid_state(start, form, parameter_set, float(terms.r[-1]))
        # The remaining mismatch is so small that the derivatives correct it without another pass.
        x += mismatch * x_t[:, _START_DERIVATIVE]
        m += mismatch * m_t[:, _START_DERIVATIVE]
        self._starts[id(record)] = final_state + remaining_share * mismatch * tangents[_START_DERIVATIVE]
        start_t = tangents_after[:_DERIVATIVE_COUNT, 1] / (1.0 - remaining_share)
        m_t[:, :_DERIVATIVE_COUNT] += m_t[:, _START_DERIVATIVE, None] * start_t
        x_t[:, :_DERIVATIVE_COUNT] += x_t[:, _START_DERIVATIVE, None] * start_t
        return CellPath(x, m, x_t, m_t)


def output_derivatives(
    form: ResponseForm, sets: Sequence[ParameterSet], gaps: NDArray[np.intp], path: CellPath
) -> tuple[FloatArray, FloatArray]:
    """Return the output at each sample, and its derivatives by the parameters at its gap."""
    x, m, x_t, m_t = path
    law = len(sets[0].law)
    scalars = np.array(
        [
            (parameter_set.h, parameter_set.scale, parameter_set.gain, parameter_set.out_0)
            for parameter_set in sets
        ]
    )
    h, scale, gain, out_0 = scalars[gaps].T
    b = m + h * x
    slope = gain * form.power * b ** (form.power - 1)
    input_derivatives = slope[:, None] * (m_t + h[:, None] * x_t)
    jacobian = np.empty((b.size, law + 5))
    jacobian[:, : law + 2] = input_derivatives[:, : law + 2]
    jacobian[:, law + 2] = b**form.power
    jacobian[:, law + 3] = input_derivatives[:, law + 2]
    jacobian[:, law + 4] = 1.0
    if form.permeability > 0.0:
        jacobian[:, law + 1] += slope * x * h / scale
        jacobian[:, law + 2] -= slope * x * h / gain
    return gain * b**form.power + out_0, jacobian


def _make_operators(form: ResponseForm, sets: Sequence[ParameterSet]) -> list[Operator]:
    """Return the law at each gap; equal laws are built once."""
    operators_by_key: dict[tuple[float, ...], Operator] = {}
    operators = []
    for parameter_set in sets:
        key = (
            (*parameter_set.law, parameter_set.omega)
            if form.kernel.includes_interaction
            else parameter_set.law
        )
        if key not in operators_by_key:
            operators_by_key[key] = form.make_operator(parameter_set)
        operators.append(operators_by_key[key])
    return operators


def interpolate_over_gaps(sets: Sequence[ParameterSet], gap: FloatArray) -> tuple[FloatArray, ...]:
    """Return omega, scale and in_0 at gap positions, also between the gaps."""
    indices = np.arange(len(sets))
    return tuple(
        np.interp(gap, indices, values)
        for values in zip(
            *((parameter_set.omega, parameter_set.scale, parameter_set.in_0) for parameter_set in sets),
            strict=True,
        )
    )


def history_inputs(sets: Sequence[ParameterSet], history: InputHistory) -> tuple[FloatArray, FloatArray]:
    """Return omega and right side of the equation for a history, at its gaps."""
    omega, scale, in_0 = interpolate_over_gaps(sets, history.gap_position)
    return omega, (history.inputs - in_0) / scale


class _SolverInputs:
    """Solver inputs for a record, and their derivatives by kappa, c, omega, scale, in_0."""

    def __init__(
        self, form: ResponseForm, parameter_set: ParameterSet, inputs: FloatArray, directions: int
    ) -> None:
        n = inputs.size
        self.r = (inputs - parameter_set.in_0) / parameter_set.scale
        self.omega = np.full(n, parameter_set.omega)
        self.omega_t = np.zeros((n, directions))
        self.omega_t[:, 2] = 1.0
        self.r_t = np.zeros((n, directions))
        self.r_t[:, 3] = -self.r / parameter_set.scale
        self.r_t[:, 4] = -1.0 / parameter_set.scale
        self.law_t = np.zeros((directions, 3))
        self.law_t[0, 0] = 1.0
        self.law_t[0, 2] = form.dead_band
        self.law_t[1, 1] = 1.0


def _follow_record(
    form: ResponseForm, sets: Sequence[ParameterSet], operator: Operator, record: FitRecord
) -> CellPath:
    skipped_samples = record.history.inputs.size
    input_values = np.concatenate([record.history.inputs, record.input])
    terms = _SolverInputs(form, sets[record.gap], input_values, _DERIVATIVE_COUNT)
    terms.omega[:skipped_samples], terms.r[:skipped_samples] = history_inputs(sets, record.history)
    # The effect of the circuit at other gaps through the history is neglected in the derivatives.
    is_at_other_gap = np.flatnonzero(record.history.gap_position != record.gap)
    terms.omega_t[is_at_other_gap] = terms.r_t[is_at_other_gap] = 0.0
    inputs = terms.omega, terms.r, terms.omega_t, terms.r_t, terms.law_t
    tangents = np.zeros((_DERIVATIVE_COUNT, 3))
    *path, _, _, status, _ = operator.sensitivity(*inputs, demagnetised(), tangents)
    require_solution(status)
    return CellPath(*(values[skipped_samples:] for values in path))


def _start_derivatives(
    form: ResponseForm, parameter_set: ParameterSet, terms: _SolverInputs, state: FloatArray
) -> FloatArray:
    """Return the derivatives of the state before the first sample, where x depends on y.

    The play has the same relative position in its width as after a drive has moved it.
    """
    x, y, p = state.tolist()
    kappa, c = parameter_set.law
    anhysteretic, slope = _langevin(x)
    steepness = 1.0 + parameter_set.omega * c * slope
    x_t = terms.r_t[-1] - terms.omega_t[-1] * ((1.0 - c) * y + c * anhysteretic)
    x_t = x_t - parameter_set.omega * (anhysteretic - y) * terms.law_t[:, 1]
    x_t[_START_DERIVATIVE] = -parameter_set.omega * (1.0 - c)
    tangents = np.zeros((_DERIVATIVE_COUNT + 1, 3))
    tangents[:, 0] = tangents[:, 2] = x_t / steepness
    tangents[0, 2] += (p - x) / kappa if form.dead_band else 0.0
    tangents[_START_DERIVATIVE, 1] = 1.0
    return tangents


def _langevin(x: float) -> tuple[float, float]:
    """Return the Langevin function and its slope at one field."""
    value, slope = langevin(np.array([x]))
    return value.item(), slope.item()


def _make_valid_state(
    state: FloatArray, form: ResponseForm, parameter_set: ParameterSet, r: float
) -> FloatArray:
    """Convert a state of other parameters to a valid state before the first sample.

    y is limited. For constant y, ``x + omega*((1-c)*y + c*L(x)) = r`` is smooth in x.
    """
    x, y, p = state.tolist()
    kappa, c = parameter_set.law
    omega, play = parameter_set.omega, form.dead_band * kappa
    play_offset = min(max(p - x, -play), play)
    for _ in range(4):
        anhysteretic, slope = _langevin(x)
        mismatch = x + omega * ((1.0 - c) * y + c * anhysteretic) - r
        x -= mismatch / (1.0 + omega * c * slope)
    x = min(max(x, -_MAX_FIELD), _MAX_FIELD)  # y of other parameters could make x arbitrarily large
    p = x + play_offset
    anhysteretic, _ = _langevin(p)
    max_distance = kappa / 3.0
    y = min(
        max(y, anhysteretic - max_distance, -_MAX_MAGNETISATION),
        anhysteretic + max_distance,
        _MAX_MAGNETISATION,
    )
    return np.array([x, y, p])


def _extrapolate_cycle(state: FloatArray, cycle_ends: list[float]) -> FloatArray:
    """Extrapolate the states after the last three passes; small loops need hundreds of passes."""
    first_step, second_step = cycle_ends[-2] - cycle_ends[-3], cycle_ends[-1] - cycle_ends[-2]
    if abs(second_step) >= abs(first_step):
        return state
    return np.array(
        [state[0], cycle_ends[-1] - second_step * second_step / (second_step - first_step), state[2]]
    )
