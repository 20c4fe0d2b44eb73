"""Provide random irons of every law in the core, equal in every run."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from anhyst import _core
from anhyst.laws.cells import CellWeights, Population, Shape, discretise_populations
from anhyst.laws.play_cells import make_iron
from anhyst.support.numeric import FloatArray
from tests.oracles.effective_field import StepKind
from tests.oracles.iron import LawName

from . import core
from .sets import log_uniform, random_cases

JILES_ATHERTON: dict[str, tuple[LawName, StepKind, bool, float]] = {
    "effective-field": ("effective-field", "exact", False, 1.0),
    "effective-field, dead band": ("effective-field", "exact", True, 1.0),
    "effective-field, linear step": ("effective-field", "linear", False, 1.0),
    "jiles-atherton-1986": ("jiles-atherton-1986", "exact", False, 0.01),
}
"""Law, step, dead band, and fraction of the parameter sets that is tested for reasons of time."""

PLAY_CELLS: dict[str, Shape] = {"play-cells": "tanh", "play-cells-langevin": "langevin"}

EVERY = [*JILES_ATHERTON, *PLAY_CELLS]


class Sample(NamedTuple):
    """An iron, and the amplitude of the field to drive it with, A/m."""

    core: _core.AnyIron
    saturation: float
    alpha: float
    steepest: float
    states: int
    amplitude: float

    @property
    def demagnetised(self) -> FloatArray:
        return np.zeros(self.states)

    def forward(
        self,
        drive: FloatArray,
        rho: FloatArray | float = 0.0,
        eddy: FloatArray | float = 0.0,
        state: FloatArray | None = None,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return flux density, field and final state from the core."""
        return self._record(self.core.forward, drive, rho, eddy, state)

    def inverse(
        self,
        flux_density: FloatArray,
        rho: FloatArray | float = 0.0,
        eddy: FloatArray | float = 0.0,
        state: FloatArray | None = None,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return drive, field and final state from the core."""
        return self._record(self.core.inverse, flux_density, rho, eddy, state)

    def _record(
        self,
        call: Callable[
            [FloatArray, FloatArray, FloatArray, FloatArray],
            tuple[FloatArray, FloatArray, FloatArray, int, int],
        ],
        given: FloatArray,
        rho: FloatArray | float,
        eddy: FloatArray | float,
        state: FloatArray | None,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        size = np.zeros(given.size)
        start = self.demagnetised if state is None else state
        found, field, after, status, index = call(given, np.add(rho, size), np.add(eddy, size), start)
        assert status == 0, (_core.status_text(status), index, self)
        return found, field, after


def random_cells(rng: np.random.Generator, shape: Shape) -> CellWeights:
    """Return one to three populations; fields and pinning vary over decades."""
    saturation, width = log_uniform(rng, 1e4, 2e6), log_uniform(rng, 1.0, 1e4)
    shares = rng.uniform(0.2, 1.0, rng.integers(1, 4))
    reversible = float(rng.choice([0.0, rng.uniform(0.0, 0.5)], p=[0.1, 0.9]))
    shares *= saturation * (1.0 - reversible) / shares.sum()
    pinned = [
        Population(
            share,
            width * log_uniform(rng, 0.5, 3.0),
            width * log_uniform(rng, 0.1, 3.0),
            rng.uniform(0.7, 4.0),
        )
        for share in shares.tolist()
    ]
    return discretise_populations((reversible * saturation, width * rng.uniform(0.5, 2.0)), pinned, shape)


def _cells(rng: np.random.Generator, shape: Shape, *, jumping: bool) -> Sample | None:
    cells = random_cells(rng, shape)
    steepest = make_iron(cells, 0.0).steepest
    smallest = 1.0 if shape == "tanh" else 1.0 / 3.0
    reversible = float(cells.weights[0] @ (smallest / cells.widths))
    if jumping:
        coupling = rng.uniform(1.05, 6.0)
    else:
        coupling = rng.choice([rng.uniform(-10.0, 0.0), rng.uniform(0.0, 0.95)])
    alpha = float(coupling) / steepest
    if alpha >= 1.0 or alpha * reversible > 0.95:
        return None
    sheared = float(cells.widths.max()) + max(-alpha, 0.0) * cells.saturation
    amplitude = log_uniform(rng, 0.3, 30.0) * sheared
    if amplitude < cells.saturation / 3e5:
        return None
    return Sample(make_iron(cells, alpha), cells.saturation, alpha, steepest,
                  cells.thresholds.size, amplitude)  # fmt: skip


def samples(law: str, count: int, seed: int, *, jumping: bool = False) -> list[Sample]:
    """Return irons of every kind of a law; with `jumping`, ``alpha*A`` is above 1."""
    if law in JILES_ATHERTON:
        name, step, play, part = JILES_ATHERTON[law]
        many = max(4, int(part * count))
        cases = random_cases(many, seed, law=name, step=step, jumping=jumping, play=play)
        return [
            Sample(core.core_of(one), one.m_s, one.alpha,
                   one.operator.largest_slope * one.m_s / one.a, 3, amplitude)
            for one, amplitude in cases
        ]  # fmt: skip
    rng = np.random.default_rng(seed)
    found: list[Sample] = []
    while len(found) < count:
        sample = _cells(rng, PLAY_CELLS[law], jumping=jumping)
        found += [sample] if sample else []
    return found
