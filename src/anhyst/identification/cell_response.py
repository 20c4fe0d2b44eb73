"""What play cells answer to the drives of a fit, with derivatives, in the gauge-free form.

The equations are those of :mod:`.response`. A settled cycle is exact after one pass.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from anhyst.identification.cell_path import CellPath, CellPaths
from anhyst.identification.fit_records import FitRecord
from anhyst.identification.response import FLATTEST, Local, ResponseForm, between
from anhyst.support.arrays import FloatArray
from anhyst.support.errors import NoResponseError

_TOGETHER = 20_000
"""Samples that are followed in one call, about; more would cost memory and gain nothing."""


class CellResponder:
    """Follows drives from the demagnetised state; remembers how they stand one after the other."""

    def __init__(self) -> None:
        self._groups: dict[tuple[int, ...], list[_Drives]] = {}
        self._grouped: Sequence[FitRecord] = ()

    def outputs(
        self, form: ResponseForm, sets: Sequence[Local], records: Sequence[FitRecord]
    ) -> list[FloatArray]:
        """Output of every drive, SI."""
        outputs = []
        for cells, drives in self._together(form, sets, records):
            omega, r, _ = drives.under(sets)
            x, m = cells.follow(omega, r, drives.begins)
            for record, part in zip(drives.records, drives.parts, strict=True):
                local = sets[record.gap]
                b = m[part] + local.h * x[part]
                outputs.append(local.gain * b**form.power + local.out_0)
        return outputs

    def derivatives(
        self, form: ResponseForm, sets: Sequence[Local], records: Sequence[FitRecord]
    ) -> Iterator[tuple[int, FloatArray, FloatArray]]:
        """Yield gap, output and derivatives by what the form names, (n, numbers), of all drives."""
        for cells, drives in self._together(form, sets, records):
            omega, r, scale = drives.under(sets)
            # What the circuit at other gaps adds through the past alone is left out.
            r_t = np.stack([-r * drives.own / scale, -drives.own / scale], axis=1)
            path = cells.with_tangents(omega, r, drives.own, r_t, drives.begins)
            path = CellPath(*(values[drives.kept] for values in path))
            output, by_local = _differentiated(form, sets, drives.gaps, path)
            for gap, part in drives.runs:
                yield gap, output[part], by_local[part]

    def _together(
        self, form: ResponseForm, sets: Sequence[Local], records: Sequence[FitRecord]
    ) -> Iterator[tuple[CellPaths, _Drives]]:
        """Give the cells of each group of drives that the same ones follow."""
        cells = _cells(form, sets)
        if records is not self._grouped:
            self._groups, self._grouped = {}, records
        alike = tuple(next(i for i, weights in enumerate(cells) if weights is own) for own in cells)
        if alike not in self._groups:
            self._groups[alike] = list(_grouped(records, alike))
        for drives in self._groups[alike]:
            yield cells[drives.records[0].gap], drives


@dataclass(frozen=True, eq=False)
class _Drives:
    """Drives one after the other, what led up to each first."""

    records: Sequence[FitRecord]
    drive: FloatArray  # SI; shape (n,)
    place: FloatArray  # place of the gap that the drive was at; shape (n,)
    own: FloatArray  # 1 at the gap of the record, else 0; shape (n,)
    begins: NDArray[np.int64]  # where each drive begins
    parts: Sequence[slice]  # where its record is

    @cached_property
    def kept(self) -> NDArray[np.bool_]:
        """Which samples are of records."""
        kept = np.zeros(self.drive.size, dtype=np.bool_)
        for part in self.parts:
            kept[part] = True
        return kept

    @cached_property
    def runs(self) -> list[tuple[int, slice]]:
        """Gaps, and where among the samples of records those at each are, one after the other."""
        spans, first = [], 0
        for gap, alike in groupby(self.records, lambda record: record.gap):
            last = first + sum(record.input.size for record in alike)
            spans.append((gap, slice(first, last)))
            first = last
        return spans

    @cached_property
    def gaps(self) -> NDArray[np.intp]:
        """Gap of each sample of a record."""
        sizes = [record.input.size for record in self.records]
        return np.repeat([record.gap for record in self.records], sizes)

    def under(self, sets: Sequence[Local]) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Put them in the terms of the cells: omega and right side; and the scale of each sample."""
        omega, scale, in_0 = between(sets, self.place)
        return omega, (self.drive - in_0) / scale, scale


def _grouped(records: Sequence[FitRecord], alike: Sequence[int]) -> Iterator[_Drives]:
    """Group drives in their order, a few thousand samples at a time; gaps with one number are alike."""
    group: list[FitRecord] = []
    for index, record in enumerate(records):
        group.append(record)
        last = index + 1 == len(records)
        if (
            last
            or alike[records[index + 1].gap] != alike[record.gap]
            or sum(record.input.size for record in group) > _TOGETHER
        ):
            yield _joined(group)
            group = []


def _joined(records: Sequence[FitRecord]) -> _Drives:
    drives, places, owns, begins, parts = [], [], [], [], []
    end = 0
    for record in records:
        before, n = record.before, record.input.size
        drives += [before.drive, record.input]
        places += [before.place, np.full(n, float(record.gap))]
        owns += [(before.place == record.gap).astype(np.float64), np.ones(n)]
        begins.append(end)
        end += before.drive.size + n
        parts.append(slice(end - n, end))
    drive, place, own = (np.concatenate(values) for values in (drives, places, owns))
    return _Drives(tuple(records), drive, place, own, np.array(begins, dtype=np.int64), parts)


def _differentiated(
    form: ResponseForm, sets: Sequence[Local], gaps: NDArray[np.intp], path: CellPath
) -> tuple[FloatArray, FloatArray]:
    """Output at each sample, and its derivatives by the numbers at its gap."""
    x, m, x_t, m_t = path
    law = len(sets[0].law)
    around = np.array([(local.h, local.scale, local.gain, local.out_0) for local in sets])
    h, scale, gain, out_0 = around[gaps].T
    b = m + h * x
    steep = gain * form.power * b ** (form.power - 1)
    through = steep[:, None] * (m_t + h[:, None] * x_t)
    jacobian = np.empty((b.size, law + 5))
    jacobian[:, : law + 2] = through[:, : law + 2]
    jacobian[:, law + 2] = b**form.power
    jacobian[:, law + 3] = through[:, law + 2]
    jacobian[:, law + 4] = 1.0
    if form.permeability > 0.0:
        jacobian[:, law + 1] += steep * x * h / scale
        jacobian[:, law + 2] -= steep * x * h / gain
    return gain * b**form.power + out_0, jacobian


def _cells(form: ResponseForm, sets: Sequence[Local]) -> list[CellPaths]:
    """Cells at each gap; those that are the same are built once."""
    assert form.cells is not None
    if max(local.h * local.omega for local in sets) > FLATTEST:
        raise NoResponseError("the curve would be all but as flat as the air core")
    try:
        return [form.cells.paths(local.law) for local in sets]
    except ValueError as error:
        raise NoResponseError(str(error)) from error
