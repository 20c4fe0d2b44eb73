"""The path of play cells along drives, with tangents: what a fit of them runs on."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from anhyst._core import CellOperator, status_text
from anhyst.laws.cells import CellWeights, Tangents
from anhyst.support.arrays import FloatArray
from anhyst.support.errors import NoResponseError

EXACT = 1e-12
"""Error of tables that a model is computed with, in parts of the saturation."""


_STEEPER = 1.03
"""Largest slope over that at the nodes of tables that aim at less: what responds with them must do so
with exact ones."""


_AT_ONCE = np.zeros(1, dtype=np.int64)
"""Where drives begin, of a single one."""


class CellPath(NamedTuple):
    """Effective field and magnetisation along a drive, and their derivatives, (n,) and (n, d)."""

    x: FloatArray
    m: FloatArray
    x_t: FloatArray
    m_t: FloatArray


@dataclass(frozen=True, eq=False)
class CellPaths:
    """Demagnetised cells ready to be driven."""

    cells: CellWeights  # thresholds, widths, weights
    tangents: Tangents  # derivatives of weights, widths and thresholds by the numbers of the law
    aim: float = EXACT  # error of the tables, in parts of the saturation

    @cached_property
    def _operator(self) -> CellOperator:
        cells = self.cells
        try:
            return CellOperator(
                cells.thresholds, cells.widths, cells.weights, cells.shape, self.aim
            )
        except ValueError as error:
            raise NoResponseError(str(error)) from error

    def follow(
        self, omega: FloatArray, r: FloatArray, begins: NDArray[np.int64] = _AT_ONCE
    ) -> tuple[FloatArray, FloatArray]:
        """Return effective field and magnetisation where ``x + omega*M(x) = r``, all of shape (n,).

        Drives stand one after the other; at each begin the cells are demagnetised.
        """
        self._refuse_jumps(omega)
        x, m, status = self._operator.run(omega, r, begins)
        _refuse(status)
        return x, m

    def with_tangents(
        self,
        omega: FloatArray,
        r: FloatArray,
        own: FloatArray,
        r_t: FloatArray,
        begins: NDArray[np.int64],
    ) -> CellPath:
        """Return them with derivatives: by the numbers of the law, omega, and what moves r."""
        self._refuse_jumps(omega)
        law = self.tangents.widths.shape[-1]
        directions = law + 1 + r_t.shape[1]
        omega_t, moved = np.zeros((r.size, directions)), np.zeros((r.size, directions))
        omega_t[:, law] = own
        moved[:, law + 1 :] = r_t
        weights_t, widths_t, thresholds_t = (
            np.concatenate([by, np.zeros((*by.shape[:-1], directions - law))], axis=-1)
            for by in self.tangents
        )
        x, m, x_t, m_t, status = self._operator.sensitivity(
            omega, r, omega_t, moved, weights_t, widths_t, thresholds_t, begins
        )
        _refuse(status)
        return CellPath(x, m, x_t, m_t)

    def _refuse_jumps(self, omega: FloatArray) -> None:
        steepest = self._operator.steepest * (1.0 if self.aim == EXACT else _STEEPER)
        if 1.0 + float(omega.min()) * steepest <= 0.0:
            raise NoResponseError("the magnetisation may jump")


def _refuse(status: int) -> None:
    if status != 0:
        raise NoResponseError(status_text(status))
