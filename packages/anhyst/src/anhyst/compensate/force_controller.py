"""Run compensators from Python in SI units, with the same C that a controller runs.

A compensator calculates the current for a demanded output (`solve`), and updates its hysteresis
state with the applied current (`commit`). This module defines the common interface `Compensator`.
`ForceController` runs any method for one magnet of a position controller. `FixedTwin` and
`RealTwin` run a compiled parameter block, in fixed or in floating point.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from anhyst import _core
from anhyst._core import Compensator as CompensatorF64
from anhyst._core import CompensatorF32, FixedCompensator
from anhyst.compensate.block import Block, make_real_core
from anhyst.support.block_words import Scales
from anhyst.support.kinds import MethodName, NumberFormat
from anhyst.support.numeric import FloatArray, to_q31


class Compensator(ABC):
    """Calculates the current for a demanded output, sample by sample.

    :meth:`solve` may be called any number of times. Then apply a current, and call :meth:`commit`
    once with the current that was really applied, after limits and the amplifier. Demands and
    outputs are in units of the model's output, N for a force. Currents are in units of its input,
    A. The scheduling variable is SI, m for a gap. Values beyond the limits of a compensator are
    limited, not rejected.
    """

    @abstractmethod
    def solve(self, demand: float, gap: float | None = None) -> float:
        """Return the current for `demand`; the state does not change."""

    @abstractmethod
    def commit(self, applied: float, gap: float | None = None) -> float:
        """Update the state with the applied current; return the expected output."""

    @abstractmethod
    def reset_copy(self) -> Self:
        """Return a compensator with the same parameters in the initial state.

        Two magnets need two compensators, and each simulation run needs its own.
        """

    def run(self, demand: ArrayLike, gap: ArrayLike | None = None) -> FloatArray:
        """Call solve and commit for each sample; return the currents."""
        demands = np.array(demand, dtype=np.float64, ndmin=1)
        gaps = np.broadcast_to(np.asarray(gap), demands.shape).tolist()
        currents = []
        for demand_now, gap_now in zip(demands.tolist(), gaps, strict=True):
            current = self.solve(demand_now, gap_now)
            self.commit(current, gap_now)
            currents.append(current)
        return np.array(currents)


Native = _core.ForceController | _core.ForceControllerF32 | _core.FixedForceController

REAL_CONTROLLERS: Mapping[NumberFormat, type[_core.ForceController] | type[_core.ForceControllerF32]] = {
    "f64": _core.ForceController,
    "f32": _core.ForceControllerF32,
}

_Q31 = 2.0**31
_FLUX_NOT_MEASURED = -(2**31)


class MethodParameters(Protocol):
    """The parameters of a method, from which a force controller is made."""

    @property
    def scales(self) -> Scales:
        """Full-scale force and current, and the range of the gap."""

    @property
    def flux_full_scale(self) -> float:
        """Flux density that 1.0 represents in fixed point, T; 1 if the method measures none."""

    @property
    def constants(self) -> Mapping[str, float]:
        """Constants by name with unit, for reports."""

    def native(self, number_format: NumberFormat) -> Native:
        """Return a new force controller of the core, in the initial state."""


@dataclass(frozen=True)
class ForceController(Compensator):
    """Compensator of one magnet, as a position controller runs it.

    `native` contains the hysteresis state of the applied currents.
    """

    method: MethodName  # method that calculates the current
    format: NumberFormat  # number format
    parameters: MethodParameters  # fitted parameters of the method

    @cached_property
    def native(self) -> Native:
        """Force controller of the core; initially demagnetised, with an integral of 0."""
        return self.parameters.native(self.format)

    @property
    def scales(self) -> Scales:
        """Full-scale force and current, and the range of the gap."""
        return self.parameters.scales

    def reset_copy(self) -> ForceController:
        """Return a force controller with the same parameters in the initial state."""
        return replace(self)

    def __getstate__(self) -> dict[str, Any]:
        """Omit the object of the core; another process makes a new one in the initial state."""
        return {name: value for name, value in self.__dict__.items() if name != "native"}

    def solve(self, demand: float, gap: float | None = None, flux: float = math.nan) -> float:
        """Return the current for a force, A; the state does not change.

        `flux` is the measured flux density, T; NaN: not measured.
        """
        native, scales = self.native, self.scales
        used_gap = scales.gap_low if gap is None else gap
        if not isinstance(native, _core.FixedForceController):
            return native.solve(demand, used_gap, flux)
        flux_full_scale = self.parameters.flux_full_scale
        flux_code = _FLUX_NOT_MEASURED if math.isnan(flux) else to_q31(flux / flux_full_scale)
        code = native.solve(to_q31(demand / scales.demand), to_q31(scales.gap_fraction(used_gap)), flux_code)
        return code / _Q31 * scales.current

    def commit(self, applied: float, gap: float | None = None) -> float:
        """Update the state with the applied current, A; return the expected force, N."""
        native, scales = self.native, self.scales
        used_gap = scales.gap_low if gap is None else gap
        if not isinstance(native, _core.FixedForceController):
            return native.commit(applied, used_gap)
        expected_force = native.commit(
            to_q31(applied / scales.current), to_q31(scales.gap_fraction(used_gap))
        )
        return expected_force / _Q31 * scales.demand

    def follow(self, applied: FloatArray, gap: FloatArray) -> FloatArray:
        """Update the state along a path of applied currents, A; return the expected forces, N."""
        native, scales = self.native, self.scales
        if not isinstance(native, _core.FixedForceController):
            return native.follow(applied, gap)
        shares = applied / scales.current, scales.gap_fraction(gap)
        codes = [np.clip(np.rint(part * _Q31), -_Q31, _Q31 - 1.0) for part in shares]
        return np.asarray(native.follow(*codes) / _Q31 * scales.demand)


CodeArray = NDArray[np.int32]
RealSignalFormat = Literal["f32", "f64"]
SignalFormat = Literal["q15", "q31", "f32", "f64"]


class Twin(Compensator):
    """Compiled compensator that calculates bit for bit what a controller calculates."""

    _core: FixedCompensator | CompensatorF32 | CompensatorF64

    @property
    @abstractmethod
    def output(self) -> float:
        """Expected output after the last commit."""

    @property
    def flags(self) -> int:
        """Flags of the last solve and its commit, as in ``anhyst/compensator/flags.h``."""
        return self._core.flags

    @property
    def memory(self) -> NDArray[Any]:
        """Hysteresis state; see ``anhyst_memory`` in compensator.h."""
        return self._core.memory

    @abstractmethod
    def set_memory(self, memory: ArrayLike) -> None:
        """Set the hysteresis state."""

    def run_start_up(self, gap: float | None = None) -> FloatArray:
        """Run the start-up sequence; return its currents."""
        currents = self._start_up_currents()
        for current in currents.tolist():
            self.commit(current, gap)
        return currents

    @abstractmethod
    def _start_up_currents(self) -> FloatArray:
        """Return the currents of the start-up sequence."""


Step = Callable[[Any, Any], Any]
"""Function solve or commit of the core, which takes a demand or a current, and a gap."""


def select_steps(core: FixedCompensator, io: str) -> tuple[Step, Step]:
    """Return the functions solve and commit of a fixed-point compensator for a signal format."""
    if io == "q15":
        return core.solve_q15, core.commit_q15
    return core.solve_q31, core.commit_q31


def _run_with_losses(
    solve: Step, commit: Step, inputs: Iterable[NDArray[Any]], limits: Sequence[float]
) -> FloatArray:
    """Run solve and commit; return the solved currents.

    The inputs are demands, gaps and deviations of the amplifier. If the deviation of a tick is not
    0, the applied current is the solved current plus the deviation, limited to `limits`.
    """
    low, high = limits
    currents = []
    for demand, gap, loss in zip(*(row.tolist() for row in inputs), strict=True):
        current = solve(demand, gap)
        if loss:
            current = min(max(current + loss, low), high)
        commit(current, gap)
        currents.append(current)
    return np.array(currents, dtype=np.float64)


class FixedTwin(Twin):
    """Compensator in fixed point.

    Demands, currents and gaps are rounded to the signal format, as an interface to a converter
    does. Values beyond the format are saturated.
    """

    def __init__(self, block: Block, io: str = "q31") -> None:
        self.block = block
        self.code_of_one = 2.0**15 if io == "q15" else 2.0**31
        self.io = io
        self._core: FixedCompensator = FixedCompensator(block.kind, block.words)

    def reset_copy(self) -> Self:
        """Return a compensator of the same block, demagnetised."""
        return type(self)(self.block, self.io)

    def _codes(self, values: ArrayLike, low: float, scale: float) -> CodeArray:
        share = (np.atleast_1d(np.asarray(values, dtype=np.float64)) - low) / scale
        return np.clip(np.rint(share * self.code_of_one), -self.code_of_one, self.code_of_one - 1.0).astype(
            np.int32
        )

    def demand_codes(self, demand: ArrayLike) -> CodeArray:
        """Convert demands in units of the output to codes."""
        return self._codes(demand, 0.0, self.block.scales.demand)

    def current_codes(self, current: ArrayLike) -> CodeArray:
        """Convert currents in units of the input to codes."""
        return self._codes(current, 0.0, self.block.scales.current)

    def gap_codes(self, gap: ArrayLike | None, size: int = 1) -> CodeArray:
        """Convert the scheduling variable, SI, to codes; 0 if the model does not need it."""
        scales = self.block.scales
        span = scales.gap_high - scales.gap_low
        if gap is None or span <= 0.0:
            return np.zeros(size, dtype=np.int32)
        return np.broadcast_to(self._codes(gap, scales.gap_low, span), (size,)).copy()

    def solve(self, demand: float, gap: float | None = None) -> float:
        """Return the current for `demand`; the state does not change."""
        solve, _ = select_steps(self._core, self.io)
        code: int = solve(int(self.demand_codes(demand)[0]), int(self.gap_codes(gap)[0]))
        return code / self.code_of_one * self.block.scales.current

    def commit(self, applied: float, gap: float | None = None) -> float:
        """Update the state with the applied current; return the expected output."""
        _, commit = select_steps(self._core, self.io)
        commit(int(self.current_codes(applied)[0]), int(self.gap_codes(gap)[0]))
        return self.output

    @property
    def output(self) -> float:
        """Expected output after the last commit."""
        code = self._core.output_q15() if self.io == "q15" else self._core.output_q31()
        return code / self.code_of_one * self.block.scales.demand

    def set_memory(self, memory: ArrayLike) -> None:
        """Set the hysteresis state; give three words if the last reversal is not known."""
        self._core.set_memory(np.array(memory, dtype=np.int32))

    def run(self, demand: ArrayLike, gap: ArrayLike | None = None) -> FloatArray:
        """Run solve and commit for each sample, in C; return the currents."""
        codes = self.demand_codes(demand)
        currents = self._core.run(codes, self.gap_codes(gap, codes.size), self.io == "q15")
        return currents / self.code_of_one * self.block.scales.current

    def run_with_losses(self, demand: FloatArray, gap: FloatArray | None, loss: FloatArray) -> FloatArray:
        """Run with an amplifier whose current deviates by `loss`, as a fraction of its range."""
        limits = self.current_codes(self.block.limits.current).tolist()
        losses = ((limits[1] - limits[0]) * loss).round().astype(int)
        inputs = self.demand_codes(demand), self.gap_codes(gap, loss.size), losses
        codes = _run_with_losses(*select_steps(self._core, self.io), inputs, limits)
        return codes / self.code_of_one * self.block.scales.current

    def _start_up_currents(self) -> FloatArray:
        ticks = range(self._core.conditioning_length())
        codes = [self._core.conditioning_q15(tick) for tick in ticks]
        return np.array(codes) / 2.0**15 * self.block.scales.current


class RealTwin(Twin):
    """Compensator in floating point."""

    def __init__(self, block: Block) -> None:
        self.block = block
        self._core: CompensatorF32 | CompensatorF64 = make_real_core(block)

    def reset_copy(self) -> Self:
        """Return a compensator of the same block, demagnetised."""
        return type(self)(self.block)

    def _gap_or_lowest(self, gap: float | None) -> float:
        return self.block.scales.gap_low if gap is None else gap

    def solve(self, demand: float, gap: float | None = None) -> float:
        """Return the current for `demand`; the state does not change."""
        return self._core.solve(demand, self._gap_or_lowest(gap))

    def commit(self, applied: float, gap: float | None = None) -> float:
        """Update the state with the applied current; return the expected output."""
        self._core.commit(applied, self._gap_or_lowest(gap))
        return self.output

    @property
    def output(self) -> float:
        """Expected output after the last commit."""
        return self._core.output()

    def set_memory(self, memory: ArrayLike) -> None:
        """Set the hysteresis state: ``x``, ``y``, ``p``, ``turn`` and ``level``."""
        self._core.set_memory(np.array(memory, dtype=np.float64))

    def run(self, demand: ArrayLike, gap: ArrayLike | None = None) -> FloatArray:
        """Run solve and commit for each sample, in C; return the currents."""
        demands = np.array(demand, dtype=np.float64, ndmin=1)
        gaps = self.block.scales.gap_low if gap is None else gap
        at = np.broadcast_to(np.asarray(gaps, dtype=np.float64), demands.shape).copy()
        return self._core.run(demands, at)

    def run_with_losses(self, demand: FloatArray, gap: FloatArray | None, loss: FloatArray) -> FloatArray:
        """Run with an amplifier whose current deviates by `loss`, as a fraction of its range."""
        low, high = self.block.limits.current
        gaps = np.full(loss.size, self._gap_or_lowest(None)) if gap is None else gap
        inputs = demand, gaps, (high - low) * loss
        return _run_with_losses(self._core.solve, self._core.commit, inputs, (low, high))

    def _start_up_currents(self) -> FloatArray:
        ticks = range(self._core.conditioning_length())
        return np.array([self._core.conditioning(tick) for tick in ticks])


def make_twin(block: Block, io: SignalFormat) -> FixedTwin | RealTwin:
    """Return a demagnetised compensator for a block."""
    return FixedTwin(block, io) if block.is_fixed else RealTwin(block)
