"""What play cells answer to the drives of a fit, with derivatives, in the gauge-free form.

The equations are those of :mod:`.response`. A settled cycle is exact after one pass.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from anhyst.identification.cell_path import CellPath, CellPaths
from anhyst.identification.fit_records import FitRecord
from anhyst.identification.no_response import NoResponseError
from anhyst.identification.response import FLATTEST, Local, ResponseForm, driven_before
from anhyst.support.arrays import FloatArray

_TOGETHER = 20_000
"""Samples that are followed in one call, about; more would cost memory and gain nothing."""


class CellResponder:
    """Follows drives from the demagnetised state."""

    def outputs(
        self, form: ResponseForm, sets: Sequence[Local], records: Sequence[FitRecord]
    ) -> list[FloatArray]:
        """Output of every drive, SI."""
        found = []
        for cells, drives in _together(form, sets, records):
            x, m = cells.follow(drives.omega, drives.r, drives.begins)
            for record, part in zip(drives.records, drives.parts, strict=True):
                local = sets[record.gap]
                b = m[part] + local.h * x[part]
                found.append(local.gain * b**form.power + local.out_0)
        return found

    def derivatives(
        self, form: ResponseForm, sets: Sequence[Local], records: Sequence[FitRecord]
    ) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Yield the output of every drive, and its derivatives by what the form names, (n, numbers)."""
        for cells, drives in _together(form, sets, records):
            path = cells.with_tangents(
                drives.omega, drives.r, drives.own, drives.r_t, drives.begins
            )
            for record, part in zip(drives.records, drives.parts, strict=True):
                yield _differentiated(form, sets[record.gap], CellPath(*(v[part] for v in path)))


@dataclass(frozen=True, eq=False)
class _Drives:
    """Drives one after the other in the terms of the cells, what led up to each first.

    ``own`` is 1 where the circuit is the one of the record's gap, else 0; ``r_t`` are the derivatives
    of ``r`` by scale and in_0; ``begins`` is where each drive begins, ``parts`` where its record is.
    """

    records: Sequence[FitRecord]
    omega: FloatArray
    r: FloatArray
    own: FloatArray
    r_t: FloatArray
    begins: Sequence[int]
    parts: Sequence[slice]


def _together(
    form: ResponseForm, sets: Sequence[Local], records: Sequence[FitRecord]
) -> Iterator[tuple[CellPaths, _Drives]]:
    """Group drives that the same cells follow, a few thousand samples at a time, in their order."""
    cells = _cells(form, sets)
    group: list[FitRecord] = []
    for place, record in enumerate(records):
        group.append(record)
        last = place + 1 == len(records)
        if (
            last
            or cells[records[place + 1].gap] is not cells[record.gap]
            or sum(one.input.size for one in group) > _TOGETHER
        ):
            yield cells[record.gap], _joined(sets, group)
            group = []


def _joined(sets: Sequence[Local], records: Sequence[FitRecord]) -> _Drives:
    omegas, rights, owns, scales, begins, parts = [], [], [], [], [], []
    end = 0
    for record in records:
        local, before = sets[record.gap], record.before
        omega, lead = driven_before(sets, before)
        n = record.input.size
        omegas += [omega, np.full(n, local.omega)]
        rights += [lead, (record.input - local.in_0) / local.scale]
        # What the circuit at other gaps adds through the past alone is left out of the derivatives.
        owns += [(before.place == record.gap).astype(np.float64), np.ones(n)]
        scales.append(np.full(lead.size + n, local.scale))
        begins.append(end)
        end += lead.size + n
        parts.append(slice(end - n, end))
    r, own, scale = (np.concatenate(values) for values in (rights, owns, scales))
    r_t = np.stack([-r * own / scale, -own / scale], axis=1)
    return _Drives(records, np.concatenate(omegas), r, own, r_t, begins, parts)


def _differentiated(
    form: ResponseForm, local: Local, path: CellPath
) -> tuple[FloatArray, FloatArray]:
    x, m, x_t, m_t = path
    law = len(local.law)
    b = m + local.h * x
    steep = local.gain * form.power * b ** (form.power - 1)
    through = steep[:, None] * (m_t + local.h * x_t)
    jacobian = np.empty((b.size, law + 5))
    jacobian[:, : law + 2] = through[:, : law + 2]
    jacobian[:, law + 2] = b**form.power
    jacobian[:, law + 3] = through[:, law + 2]
    jacobian[:, law + 4] = 1.0
    if form.permeability > 0.0:
        jacobian[:, law + 1] += steep * x * local.h / local.scale
        jacobian[:, law + 2] -= steep * x * local.h / local.gain
    return local.gain * b**form.power + local.out_0, jacobian


def _cells(form: ResponseForm, sets: Sequence[Local]) -> list[CellPaths]:
    """Cells at each gap; those that are the same are built once."""
    assert form.cells is not None
    if max(local.h * local.omega for local in sets) > FLATTEST:
        raise NoResponseError("the curve would be all but as flat as the air core")
    try:
        return [form.cells.paths(local.law) for local in sets]
    except ValueError as error:
        raise NoResponseError(str(error)) from error
