"""Calculate derived signals from expressions that the operator writes.

An expression is parsed with :mod:`ast`, and only arithmetic, signals and the functions of this
module are accepted; nothing is executed as Python. Values are calculated for every row, in SI units.
Filters keep their state from one chunk of rows to the next.
"""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.bench.protocol import Signal, column_header

MAX_DERIVED_SIGNALS = 8
"""Largest number of derived signals of a session."""

MAX_WINDOW_S = 1.0
"""Longest window of a mean or an rms, s."""

_MAX_EXPRESSION_LENGTH = 200
_PROBE_ROWS = 1000
_NAME_PATTERN = re.compile(r"[a-z][a-z0-9_]{0,29}")
_UNIT_PATTERN = re.compile(r"[A-Za-z0-9 /^_%*.()µ-]{0,16}")

_Values = Callable[[FloatArray], FloatArray]
"""Function that returns the values of an expression for rows; column 0 is the tick."""

_OPERATORS: Mapping[type[ast.AST], Callable[..., FloatArray]] = {
    ast.Add: np.add,
    ast.Sub: np.subtract,
    ast.Mult: np.multiply,
    ast.Div: np.divide,
    ast.Pow: np.power,
    ast.USub: np.negative,
    ast.UAdd: np.positive,
}
_FUNCTIONS: Mapping[str, Callable[..., FloatArray]] = {
    "abs": np.abs,
    "sqrt": np.sqrt,
    "min": np.minimum,
    "max": np.maximum,
}


class DerivedSignal(NamedTuple):
    """A signal that an expression defines."""

    name: str
    unit: str
    expression: str

    @property
    def signal(self) -> Signal:
        """Column of this signal in the rows and in recordings."""
        return Signal(self.name, self.unit, f"derived: {self.expression}")


class DerivedSignals:
    """The derived signals of a session, with the state of their filters."""

    def __init__(
        self, signals: Sequence[Signal], rate: float, definitions: Sequence[DerivedSignal] = ()
    ) -> None:
        self._signals, self._rate = tuple(signals), rate
        self.definitions: tuple[DerivedSignal, ...] = ()
        self._values: tuple[_Values, ...] = ()
        for definition in definitions:
            self.define(definition)

    def copy(self) -> DerivedSignals:
        """Return the same signals with filters that have no past."""
        return DerivedSignals(self._signals, self._rate, self.definitions)

    def define(self, definition: DerivedSignal) -> None:
        """Add a derived signal; refuse an expression that cannot be calculated."""
        name, unit, _ = definition
        if len(self.definitions) >= MAX_DERIVED_SIGNALS:
            text = f"derived: {MAX_DERIVED_SIGNALS} signals are defined already; delete one"
            raise InputError(text, code="too-many-signals", key="derived")
        if not _NAME_PATTERN.fullmatch(name):
            text = "derived: a name has at most 30 small letters, digits and _, such as power"
            raise InputError(text, code="bad-name", key="name")
        taken = {signal.name for signal in self._signals} | {one.name for one in self.definitions}
        if name in taken:
            raise InputError(
                f"derived: {name} exists already; choose another name", code="exists-already", key="name"
            )
        if not _UNIT_PATTERN.fullmatch(unit):
            text = "derived: a unit has at most 16 letters, digits and signs, such as N m/s^2"
            raise InputError(text, code="bad-unit", key="unit")
        values = self._compile(definition.expression)
        self.definitions, self._values = (*self.definitions, definition), (*self._values, values)

    def _compile(self, expression: str) -> _Values:
        """Return the function of an expression; refuse one that has no finite value for any signals."""
        random = np.random.default_rng(0)
        signals = random.normal(size=(_PROBE_ROWS, len(self._signals)))
        signals *= 10.0 ** random.uniform(-9.0, 9.0, signals.shape)
        probe = np.column_stack((np.arange(1.0, _PROBE_ROWS + 1), signals))
        compiler = _Compiler(self._signals, self._rate)
        with np.errstate(all="ignore"):
            if not np.isfinite(compiler.compile(expression)(probe)).any():
                raise _refusal("the result is never a finite number; check divisions, powers and roots")
        return compiler.compile(expression)  # Its filters have not seen the random signals.

    def delete(self, name: str) -> None:
        """Delete a derived signal."""
        index = next((n for n, one in enumerate(self.definitions) if one.name == name), None)
        if index is None:
            raise InputError(f"derived: no derived signal '{name[:40]}'", code="no-such-signal", key="name")
        self.definitions = self.definitions[:index] + self.definitions[index + 1 :]
        self._values = self._values[:index] + self._values[index + 1 :]

    def extend(self, rows: FloatArray) -> FloatArray:
        """Return rows with the columns of the derived signals; a value without a result is nan."""
        if not self._values or not len(rows):
            return rows
        with np.errstate(all="ignore"):
            columns = [np.broadcast_to(values(rows), len(rows)) for values in self._values]
        derived = np.column_stack(columns)
        return np.hstack((rows, np.where(np.isfinite(derived), derived, np.nan)))


class _Compiler:
    """A translator from an expression to a function of rows."""

    def __init__(self, signals: Sequence[Signal], rate: float) -> None:
        self._rate = rate
        self._columns: dict[str, int] = {}
        for column, signal in enumerate(signals, 1):
            with_unit = f"{signal.name}_{signal.unit}"
            self._columns |= dict.fromkeys((column_header(signal), with_unit, signal.name), column)

    def compile(self, expression: str) -> _Values:
        """Return the function of an expression."""
        if not 0 < len(expression) <= _MAX_EXPRESSION_LENGTH:
            text = (
                f"derived: an expression has 1 to {_MAX_EXPRESSION_LENGTH} signs, such as force_N * current_A"
            )
            raise InputError(text, code="bad-expression", key="expression")
        try:
            tree = ast.parse(expression, mode="eval")
        except (SyntaxError, ValueError, RecursionError, MemoryError):
            raise _refusal("cannot be read; check operators and parentheses") from None
        return self._build(tree.body)

    def _build(self, node: ast.expr) -> _Values:
        if isinstance(node, ast.Constant):
            constant = np.float64(_number(node))
            return lambda rows: np.full(len(rows), constant)
        if isinstance(node, ast.Name):
            return self._column(node.id)
        if isinstance(node, ast.UnaryOp) and type(node.op) in _OPERATORS:
            return self._apply(_OPERATORS[type(node.op)], [node.operand])
        if isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS:
            return self._apply(_OPERATORS[type(node.op)], [node.left, node.right])
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
            return self._call(node.func.id, node.args)
        raise _refusal("may contain numbers, signals, + - * / **, parentheses and functions")

    def _column(self, name: str) -> _Values:
        if name not in self._columns:
            raise _refusal(f"'{name[:40]}' is not a signal of this rig")
        column = self._columns[name]
        return lambda rows: rows[:, column]

    def _apply(self, function: Callable[..., FloatArray], arguments: Sequence[ast.expr]) -> _Values:
        parts = [self._build(argument) for argument in arguments]
        return lambda rows: function(*(part(rows) for part in parts))

    def _call(self, name: str, arguments: Sequence[ast.expr]) -> _Values:
        expected = {"derivative": 1, "abs": 1, "sqrt": 1}.get(name, 2)
        if name not in (*_FUNCTIONS, *_FILTERS):
            raise _refusal(f"'{name[:40]}' is not one of {', '.join((*_FILTERS, *_FUNCTIONS))}")
        if len(arguments) != expected:
            raise _refusal(f"{name} has {expected} argument{'s' if expected > 1 else ''}")
        if name in _FUNCTIONS:
            return self._apply(_FUNCTIONS[name], arguments)
        setting = _number(arguments[1]) if expected > 1 else 0.0
        limit, unit = (MAX_WINDOW_S, "s") if name in ("mean", "rms") else (0.5 * self._rate, "Hz")
        if expected > 1 and not 0.0 < setting <= limit:
            raise _refusal(f"{name}: the second argument is not within 0 to {limit:g} {unit}")
        source, state = self._build(arguments[0]), _FILTERS[name](self._rate, setting)
        return lambda rows: state(rows[:, 0], source(rows))


class _Derivative:
    """Difference to the previous row over the time between both rows."""

    def __init__(self, rate: float, _setting: float) -> None:
        self._rate = rate
        self._last = (math.nan, math.nan)

    def __call__(self, ticks: FloatArray, values: FloatArray) -> FloatArray:
        all_ticks, all_values = np.r_[self._last[0], ticks], np.r_[self._last[1], values]
        self._last = (float(ticks[-1]), float(values[-1]))
        result: FloatArray = np.diff(all_values) / np.diff(all_ticks) * self._rate
        return result


class _LowPass:
    """First-order low-pass filter that starts at its first finite value."""

    def __init__(self, rate: float, corner_Hz: float) -> None:
        self._share = -math.expm1(-math.tau * corner_Hz / rate)
        self._value = math.nan

    def __call__(self, ticks: FloatArray, values: FloatArray) -> FloatArray:
        finite = values[np.isfinite(values)]
        if not len(finite):
            return np.full(len(values), math.nan)
        if math.isnan(self._value):
            self._value = float(finite[0])
        filled = np.where(np.isfinite(values), values, self._value)
        decay = 1.0 - self._share
        filtered, _ = lfilter([self._share], [1.0, -decay], filled, zi=[decay * self._value])
        self._value = float(filtered[-1])
        result: FloatArray = filtered
        return result


class _HighPass(_LowPass):
    """Difference between the values and their low-pass."""

    def __call__(self, ticks: FloatArray, values: FloatArray) -> FloatArray:
        return values - super().__call__(ticks, values)


class _Mean:
    """Mean over the finite values of a window that ends at each row."""

    def __init__(self, rate: float, window_s: float) -> None:
        self._rows = max(1, round(window_s * rate))
        self._past = np.empty(0)

    def __call__(self, ticks: FloatArray, values: FloatArray) -> FloatArray:
        known = np.r_[self._past, values]
        is_finite = np.isfinite(known)
        sums = np.cumsum(np.r_[0.0, np.where(is_finite, known, 0.0)])
        counts = np.cumsum(np.r_[0, is_finite])
        ends = np.arange(len(self._past), len(known)) + 1
        begins = np.maximum(0, ends - self._rows)
        self._past = known[-self._rows :]
        means: FloatArray = (sums[ends] - sums[begins]) / (counts[ends] - counts[begins])
        return means


class _Rms(_Mean):
    """Root mean square over the rows of a window."""

    def __call__(self, ticks: FloatArray, values: FloatArray) -> FloatArray:
        result: FloatArray = np.sqrt(np.maximum(0.0, super().__call__(ticks, values**2)))
        return result


_FILTERS: Mapping[str, Callable[[float, float], Callable[[FloatArray, FloatArray], FloatArray]]] = {
    "derivative": _Derivative,
    "lowpass": _LowPass,
    "highpass": _HighPass,
    "mean": _Mean,
    "rms": _Rms,
}


def _number(node: ast.expr) -> float:
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        return float(node.value)
    raise _refusal("this argument must be a number")


def _refusal(reason: str) -> InputError:
    return InputError(f"derived: {reason}", code="bad-expression", key="expression")
