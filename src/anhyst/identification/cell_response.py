"""What play cells answer to the drives of a fit, with derivatives, in the gauge-free form.

The equations are those of :mod:`.response`. A settled cycle is exact after one pass.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from anhyst.identification.cell_path import CellPaths
from anhyst.identification.fit_records import FitRecord
from anhyst.identification.no_response import NoResponseError
from anhyst.identification.response import FLATTEST, Local, ResponseForm, driven_before
from anhyst.support.arrays import FloatArray


class CellResponder:
    """Follows drives from the demagnetised state."""

    def outputs(
        self, form: ResponseForm, sets: Sequence[Local], records: Sequence[FitRecord]
    ) -> list[FloatArray]:
        """Output of every drive, SI."""
        cells = _cells(form, sets)
        found = []
        for record in records:
            local = sets[record.gap]
            omega, r, first = _driven(sets, record)
            x, m = cells[record.gap].follow(omega, r)
            b = (m + local.h * x)[first:]
            found.append(local.gain * b**form.power + local.out_0)
        return found

    def derivatives(
        self, form: ResponseForm, sets: Sequence[Local], records: Sequence[FitRecord]
    ) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Yield the output of every drive, and its derivatives by what the form names, (n, numbers)."""
        cells = _cells(form, sets)
        for record in records:
            yield _differentiated(form, sets, cells[record.gap], record)


def _differentiated(
    form: ResponseForm, sets: Sequence[Local], cells: CellPaths, record: FitRecord
) -> tuple[FloatArray, FloatArray]:
    local = sets[record.gap]
    law = len(local.law)
    omega, r, first = _driven(sets, record)
    # What the circuit at other gaps adds through the past alone is left out of the derivatives.
    own = np.ones(r.size)
    own[:first] = record.before.place == record.gap
    r_t = np.stack([-r / local.scale, np.full(r.size, -1.0 / local.scale)], axis=1)  # scale, in_0
    r_t *= own[:, None]
    x, m, x_t, m_t = (values[first:] for values in cells.with_tangents(omega, r, own, r_t))
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


def _driven(sets: Sequence[Local], record: FitRecord) -> tuple[FloatArray, FloatArray, int]:
    """Put a drive in the terms of the cells, what led up to it first; and say how long that is."""
    local = sets[record.gap]
    omega, lead = driven_before(sets, record.before)
    r = (record.input - local.in_0) / local.scale
    return (
        np.concatenate([omega, np.full(r.size, local.omega)]),
        np.concatenate([lead, r]),
        lead.size,
    )
