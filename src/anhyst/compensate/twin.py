"""The compensator in Python: the C that runs on a controller, in SI units around it."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from anhyst._core import FixedCompensator
from anhyst.compensate.block import Block
from anhyst.support.arrays import FloatArray

CodeArray = NDArray[np.int32]


class Twin:
    """A compensator in use; bit for bit what the controller computes.

    Parameters
    ----------
    block : Block
        Its parameters.
    io : str, optional
        Format of the signals, ``"q15"`` or ``"q31"``.

    Notes
    -----
    Demands, currents and gaps are rounded to the format on the way in, as an interface to a
    converter would; what lies beyond the format is saturated.
    """

    def __init__(self, block: Block, io: str = "q31") -> None:
        self.block = block
        self.one = 2.0**15 if io == "q15" else 2.0**31
        self.io = io
        self._core = FixedCompensator(block.kind, block.words)

    def _codes(self, values: ArrayLike, low: float, scale: float) -> CodeArray:
        part = (np.atleast_1d(np.asarray(values, dtype=np.float64)) - low) / scale
        codes = np.clip(np.rint(part * self.one), -self.one, self.one - 1.0)
        return codes.astype(np.int32)

    def demand_codes(self, demand: ArrayLike) -> CodeArray:
        """Demand in units of the output -> what the controller is given."""
        return self._codes(demand, 0.0, self.block.scales.demand)

    def current_codes(self, current: ArrayLike) -> CodeArray:
        """Drive in units of the input -> what the controller is given."""
        return self._codes(current, 0.0, self.block.scales.current)

    def gap_codes(self, gap: ArrayLike | None, size: int = 1) -> CodeArray:
        """Scheduling variable, SI -> what the controller is given; 0 where it does not matter."""
        scales = self.block.scales
        span = scales.gap_high - scales.gap_low
        if gap is None or span <= 0.0:
            return np.zeros(size, dtype=np.int32)
        return np.broadcast_to(self._codes(gap, scales.gap_low, span), (size,)).copy()

    def solve(self, demand: float, gap: float | None = None) -> float:
        """Return the drive that gives `demand` now; the memory is not touched."""
        solve = self._core.solve_q15 if self.io == "q15" else self._core.solve_q31
        code = solve(int(self.demand_codes(demand)[0]), int(self.gap_codes(gap)[0]))
        return code / self.one * self.block.scales.current

    def commit(self, applied: float, gap: float | None = None) -> float:
        """Advance the memory with the drive that was applied; return the expected output."""
        commit = self._core.commit_q15 if self.io == "q15" else self._core.commit_q31
        commit(int(self.current_codes(applied)[0]), int(self.gap_codes(gap)[0]))
        return self.output

    @property
    def output(self) -> float:
        """Output that the compensator expects after the last commit."""
        code = self._core.output_q15() if self.io == "q15" else self._core.output_q31()
        return code / self.one * self.block.scales.demand

    @property
    def flags(self) -> int:
        """Bits of the last solve: 1 demand limited, 2 current limited, 4 flux limited."""
        return self._core.flags

    @property
    def memory(self) -> NDArray[np.int32]:
        """What the iron remembers; see ``anhyst_memory`` in compensator.h."""
        return self._core.memory

    def start_from(self, memory: ArrayLike) -> None:
        """Set what the iron remembers; three words where the last turn is not known."""
        self._core.set_memory(np.array(memory, dtype=np.int32))

    def run(self, demand: ArrayLike, gap: ArrayLike | None = None) -> FloatArray:
        """Solve and commit sample by sample.

        Parameters
        ----------
        demand : array_like, shape (n,)
            In units of the output.
        gap : array_like, shape (n,) or scalar, optional
            Scheduling variable, SI.

        Returns
        -------
        ndarray, shape (n,)
            Drive in units of the input.
        """
        codes = self.demand_codes(demand)
        currents = self._core.run(codes, self.gap_codes(gap, codes.size), self.io == "q15")
        return currents / self.one * self.block.scales.current

    def condition(self, gap: float | None = None) -> FloatArray:
        """Run the start-up sequence; return its currents."""
        ticks = self._core.conditioning_length()
        codes = [self._core.conditioning_q15(tick) for tick in range(ticks)]
        currents = np.array(codes) / 2.0**15 * self.block.scales.current
        for current in currents.tolist():
            self.commit(current, gap)
        return currents
