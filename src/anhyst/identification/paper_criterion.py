"""The criterion of eq. 16 at one gap, for one parameter set or for many at once."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from anhyst._core import Operator
from anhyst.identification.fit_records import FitRecord, FitRecords
from anhyst.identification.paper_seven import Variables, gauge_free, local_of
from anhyst.identification.response import Local, Responder, ResponseForm
from anhyst.identification.screening import OMEGA_JUMP, follow_sets
from anhyst.support.arrays import FloatArray
from anhyst.support.errors import NoResponseError

IMPOSSIBLE = 10.0
"""Cost where the law has no answer."""

_KAPPA = (2e-3, 5e2)
"""Pinning over shape that the tables of the core are made for."""


class Criterion:
    """Mean absolute deviation relative to the largest output of all gaps (eq. 16)."""

    def __init__(self, form: ResponseForm, records: FitRecords) -> None:
        self._form = form
        self._loops = records.loops
        # The square of the weight of a deviation is what its sample counts.
        total = sum(record.weight**2 * record.input.size for record in self._loops)
        self._shares = [record.weight**2 / (total * records.output_span) for record in self._loops]
        self._responder = Responder()
        self._built: tuple[tuple[float, ...], Operator] | None = None
        self.evaluations = 0

    def of_one(self, values: Mapping[str, float]) -> float:
        """Cost of one parameter set by the exact law; :data:`IMPOSSIBLE` where it has no answer."""
        self.evaluations += 1
        local = local_of(values, self._form.power)
        try:
            key = (local.kappa, local.c, local.omega if self._form.kernel.coupled else 0.0)
            if self._built is None or self._built[0] != key:
                self._built = (key, self._form.operator(local))
            operator = self._built[1]
            return sum(
                share * self._off(local, operator, record)
                for share, record in zip(self._shares, self._loops, strict=True)
            )
        except NoResponseError:
            return IMPOSSIBLE

    def of_many(self, values: Mapping[str, FloatArray]) -> FloatArray:
        """Costs of many sets by the batch of the core, shape (count,); infinite where it cannot.

        The batch steps linearly, goes round a settled cycle three times only, knows no jumps, and
        takes the effective-field law for that of 1986: good enough to see which parents to keep.
        """
        form = gauge_free(values, self._form.power)
        sane = (form["omega"] > 0.01 - OMEGA_JUMP) & (_KAPPA[0] < form["kappa"])
        sane &= form["kappa"] < _KAPPA[1]
        costs = np.full(sane.size, np.inf)
        self.evaluations += sane.size
        kept = {name: array[sane] for name, array in form.items()}
        in_0, out_0 = values["in_0"][sane], values["out_0"][sane]
        sets = np.stack([kept["kappa"], kept["c"], kept["omega"], kept["scale"]])
        criteria = np.zeros(in_0.size)
        for share, record in zip(self._shares, self._loops, strict=True):
            m, xi = follow_sets(record, np.arange(record.input.size), sets, in_0)
            output = kept["gain"] * (m + kept["h"] * xi) ** self._form.power + out_0
            criteria += share * np.abs(output - record.output[:, None]).sum(axis=0)
        costs[sane] = criteria
        return costs

    def _off(self, local: Local, operator: Operator, record: FitRecord) -> float:
        output = self._responder.output(self._form, local, operator, record)
        return float(np.abs(output - record.output).sum())


def mean_deviation(records: FitRecords, outputs: FloatArray) -> float:
    """Criterion of eq. 16 for outputs that are known already."""
    measured = np.concatenate([record.output for record in records.loops])
    counts = np.concatenate([np.full(d.output.size, d.weight**2) for d in records.loops])
    return float(np.average(np.abs(outputs - measured), weights=counts) / records.output_span)


def simplex(
    cost: Callable[[FloatArray], float],
    variables: Variables,
    start: FloatArray,
    most: int,
    step: float = 0.05,
) -> tuple[FloatArray, float]:
    """Nelder and Mead's simplex, begun again at its end until that gains nothing more."""
    # Only here: importing it takes longer than the default search, which does without.
    from scipy.optimize import minimize

    best, lowest = start, cost(start)
    span = variables.high - variables.low
    while most > variables.size + 1:
        corners = np.tile(best, (variables.size + 1, 1))
        places = np.arange(variables.size)
        inward = np.where(best + step * span > variables.high, -step, step)
        corners[places + 1, places] += inward * span
        minimum = minimize(
            cost,
            best,
            method="Nelder-Mead",
            bounds=list(zip(variables.low, variables.high, strict=True)),
            options={
                "adaptive": variables.size > 1,
                "initial_simplex": corners,
                "maxfev": most,
                "maxiter": most,
                "xatol": 1e-5,
                "fatol": 1e-8,
            },
        )
        most -= minimum.nfev
        step *= 0.25
        gained = lowest - minimum.fun
        if gained > 0.0:
            best, lowest = np.asarray(minimum.x), float(minimum.fun)
        if gained < 1e-3 * lowest:
            break
    return best, lowest
