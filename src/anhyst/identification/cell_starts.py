"""Where a search for play cells starts: sets drawn in scaled units, each placed on the loops.

Drawn is what can be seen in a loop: how far the cells are driven, in widths of their curve; how far
they are pinned and how alike; how much answers reversibly; and which part of the drive the iron takes,
which leaves the rest to the gap. Scale, gain and what the map lets differ from gap to gap then
follow in closed form: the model passes through the largest output at every gap.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from anhyst.identification.cell_kernel import CellKernel
from anhyst.identification.default import reference_gap
from anhyst.identification.response import FLATTEST, Local
from anhyst.identification.screening import evenly
from anhyst.identification.space import IN_SERIES, CoordinateSpace
from anhyst.laws.cells import Shape
from anhyst.support.numeric import FloatArray

SLOPES: dict[Shape, float] = {"tanh": 1.0, "langevin": 1.0 / 3.0}
"""Slope of each curve at its middle."""

_REACH = (0.4, 8.0)
"""Largest effective field, in widths of the first population that the slope at its middle gives."""

_PINNED = (0.02, 1.0)
"""Pinning of a population, in parts of the largest effective field."""

_SPREAD = (0.7, 5.0)
_REVERSIBLE = (0.02, 1.5)
"""Share of the reversible part, of the first population."""

_REVERSIBLE_WIDTH = (0.3, 6.0)
_SHARE = (0.1, 1.5)
_WIDTH = (0.2, 8.0)
"""Share and width of a further population, of the first."""

_BEHIND_GAP, _CLOSED = (0.02, 0.9), (0.3, 4.0)
"""Part of the drive that the iron takes behind a gap; and without one, where interaction of the iron
may add to the drive."""

_BEFORE_JUMPS = 0.8
"""Interaction, in parts of that at which the magnetisation would jump, at most."""

_CURVE = 200


class CellStart(NamedTuple):
    """Numbers of the law, largest effective field in its units, part of the drive for the iron."""

    law: tuple[float, ...]
    reach: float
    part: float


def draw_starts(kernel: CellKernel, count: int, seed: int, gapped: bool) -> list[CellStart]:
    """Draw starts evenly over the logarithms of their ranges (:func:`.screening.evenly`)."""
    own = [_REVERSIBLE, _REVERSIBLE_WIDTH, _PINNED, _SPREAD]
    further = [_SHARE, _WIDTH, _PINNED, _SPREAD]
    ranges = [_REACH, _BEHIND_GAP if gapped else _CLOSED, *own, *further * (kernel.populations - 1)]
    low, high = np.log(np.array(ranges)).T[:, :, None]
    drawn = low + (high - low) * evenly(len(ranges), count, seed)
    starts = []
    for steep_reach, part, *law in np.exp(drawn).T.tolist():
        reach = steep_reach / SLOPES[kernel.shape]
        law[2::4] = [pinned * reach for pinned in law[2::4]]
        starts.append(CellStart(tuple(law), reach, part))
    return starts


def placed(space: CoordinateSpace, start: CellStart) -> list[Local]:
    """Return the sets at each gap that pass through the largest output there."""
    form = space.form
    field = np.linspace(0.0, 3.0 * start.reach, _CURVE)
    assert space.form.cells is not None
    field, curve = space.form.cells.paths(start.law).follow(np.zeros(field.size), field)
    drives, outputs = _largest(space)
    home = reference_gap(space.records)
    top = float(np.interp(start.reach, field, curve))
    omega = start.reach * (1.0 / start.part - 1.0) / top
    omega = max(omega, -_BEFORE_JUMPS / float(np.max(np.diff(curve) / np.diff(field))))
    scale = drives[home] / (start.reach + omega * top)
    gain = outputs[home] / top**form.power
    sets = []
    for drive, output in zip(drives, outputs, strict=True):
        m = (output / gain) ** (1.0 / form.power)
        x = float(np.interp(m, curve, field))
        own = (omega, scale)
        if space.gap_map in IN_SERIES:
            own = (max((drive / scale - x) / m, 0.0), scale)
        elif len(drives) > 1:
            own = (omega, drive / (x + omega * m))
        sets.append(form.with_h(Local(start.law, *own, gain, 0.0, 0.0, 0.0)))
    return sets


def possible(sets: Sequence[Local]) -> bool:
    """Whether the scales of a start are those of a drive and an output."""
    return all(own.scale > 0.0 and own.gain > 0.0 and own.h * own.omega < FLATTEST for own in sets)


def _largest(space: CoordinateSpace) -> tuple[FloatArray, FloatArray]:
    """Drive and output where the output is largest, at each gap; absolute values."""
    drives, outputs = np.zeros(space.records.gaps), np.zeros(space.records.gaps)
    for record in space.records.loops:
        at = int(np.argmax(np.abs(record.output)))
        if abs(record.output[at]) > outputs[record.gap]:
            drives[record.gap] = abs(record.input[at])
            outputs[record.gap] = abs(record.output[at])
    return drives, outputs
