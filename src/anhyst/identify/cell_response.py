"""What play cells answer to the drives of a fit, with derivatives, in the gauge-free form.

The equations are those of :mod:`.response`. A settled cycle is exact after one pass.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from anhyst.identify.cell_kernel import CellKernel, WeightKernel
from anhyst.identify.cell_path import CellPaths, DrivenCells, Path, turns
from anhyst.identify.fit_records import FitRecord
from anhyst.identify.no_response import NoResponseError
from anhyst.identify.response import FLATTEST, Local, ResponseForm
from anhyst.support.arrays import FloatArray


class CellResponder:
    """Follows all drives at once."""

    def outputs(
        self, form: ResponseForm, sets: Sequence[Local], records: Sequence[FitRecord]
    ) -> list[FloatArray]:
        """Output of every drive, SI."""
        found = []
        for local, path in zip(*_followed(form, sets, records, tangents=False), strict=True):
            b = path.m + local.h * path.x
            found.append(local.gain * b**form.power + local.out_0)
        return found

    def derivatives(
        self, form: ResponseForm, sets: Sequence[Local], records: Sequence[FitRecord]
    ) -> list[tuple[FloatArray, FloatArray]]:
        """Output of every drive, and its derivatives by what the form names, shape (n, numbers)."""
        found = []
        for local, path in zip(*_followed(form, sets, records, tangents=True), strict=True):
            law = len(local.law)
            b = path.m + local.h * path.x
            steep = local.gain * form.power * b ** (form.power - 1)
            through = steep[:, None] * (path.m_t + local.h * path.x_t)
            jacobian = np.empty((b.size, law + 5))
            jacobian[:, : law + 2] = through[:, : law + 2]
            jacobian[:, law + 2] = b**form.power
            jacobian[:, law + 3] = through[:, law + 2]
            jacobian[:, law + 4] = 1.0
            if form.permeability > 0.0:
                jacobian[:, law + 1] += steep * path.x * local.h / local.scale
                jacobian[:, law + 2] -= steep * path.x * local.h / local.gain
            found.append((local.gain * b**form.power + local.out_0, jacobian))
        return found


def _followed(
    form: ResponseForm,
    sets: Sequence[Local],
    records: Sequence[FitRecord],
    *,
    tangents: bool,
) -> tuple[list[Local], list[Path]]:
    """Drive the cells of every distinct law along all its records, in their order."""
    kernel = form.cells
    assert kernel is not None
    locals_ = [sets[record.gap] for record in records]
    if max(local.h * local.omega for local in sets) > FLATTEST:
        raise NoResponseError("the curve would be all but as flat as the air core")
    paths: dict[int, Path] = {}
    for law in dict.fromkeys(local.law for local in locals_):
        places = [place for place, local in enumerate(locals_) if local.law == law]
        cells = _ready(kernel, law, tangents=tangents)
        drives = [_driven(locals_[place], records[place]) for place in places]
        for place, drive, path in zip(places, drives, cells.follow(drives), strict=True):
            paths[place] = Path(*(values[drive.kept :] for values in path))
    return locals_, [paths[place] for place in range(len(records))]


def _driven(local: Local, record: FitRecord) -> DrivenCells:
    """Put a drive in the terms of the cells; derivatives by law, omega, scale, in_0."""
    law = len(local.law)
    # Of a pass that came before, the ends of its runs say all.
    lead = record.input[turns(record.input)[1:] - 1] if record.settled else record.lead
    r = (np.concatenate([lead, record.input]) - local.in_0) / local.scale
    omega_t = np.zeros(law + 3)
    omega_t[law] = 1.0
    r_t = np.zeros((r.size, law + 3))
    r_t[:, law + 1] = -r / local.scale
    r_t[:, law + 2] = -1.0 / local.scale
    return DrivenCells(local.omega, r, lead.size, omega_t, r_t)


def _ready(
    kernel: CellKernel | WeightKernel, law: tuple[float, ...], *, tangents: bool
) -> CellPaths:
    try:
        return kernel.paths_with_tangents(law) if tangents else kernel.paths(law)
    except ValueError as error:
        raise NoResponseError(str(error)) from error
