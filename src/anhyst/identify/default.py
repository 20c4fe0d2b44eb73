"""The default search: screen one gap widely, descend from the best, then join the gaps.

1. Thousands of sets over the loops of the gap with the largest output (:mod:`.screening`).
2. Least squares from the few best that differ, at that gap alone.
3. For a gap map, the parameter that the map ties to the gap is scanned at every other gap with the
   rest held, and all gaps are fitted together.

Everything random comes from the seed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from anhyst.identify.drives import Records
from anhyst.identify.fitting import descend
from anhyst.identify.objective import Objective
from anhyst.identify.response import Form, Local
from anhyst.identify.screening import screen, starts
from anhyst.identify.space import OMEGA_JUMP, Space

Floats = NDArray[np.float64]

SCREENED = 256
KEPT = 3
_SHORT = 6
"""Evaluations of a first descent: enough to tell a good valley from a bad one."""

_SCAN = 64


@dataclass(frozen=True, eq=False)
class Found:
    """Outcome of a search under one gap map: coordinates, weighted sum of squares, evaluations."""

    space: Space
    theta: Floats
    cost: float
    evaluations: int

    @property
    def sets(self) -> list[Local]:
        """Gauge-free parameters at each gap."""
        return [local for local, _ in self.space.unpack(self.theta)]

    @property
    def plain(self) -> dict[str, Any]:
        """What a checkpoint keeps."""
        return {
            "theta": self.theta.tolist(),
            "cost": self.cost,
            "evaluations": self.evaluations,
        }

    @classmethod
    def from_plain(cls, space: Space, plain: dict[str, Any]) -> Found:
        """Rebuild from what a checkpoint kept."""
        return cls(space, np.array(plain["theta"]), plain["cost"], plain["evaluations"])


def follow(space: Space, theta: Floats, tolerance: float = 1e-10, most: int = 200) -> Found:
    """Descend from a start and count."""
    objective = Objective(space)
    fit = descend(objective, theta, tolerance, most)
    return Found(space, fit.theta, fit.cost, objective.evaluations)


def reference_gap(records: Records) -> int:
    """Gap with the largest output: there the iron is driven furthest and shows most."""
    sizes = np.zeros(records.gaps)
    for drive in records.drives:
        sizes[drive.gap] = max(sizes[drive.gap], float(np.max(np.abs(drive.output))))
    return int(np.argmax(sizes))


def search_one_gap(form: Form, records: Records, seed: int, offsets: bool) -> list[Found]:
    """Fit one gap from scratch.

    Parameters
    ----------
    form : Form
        Equations of the measured quantities.
    records : Records
        Loops at a single gap.
    seed : int
        Seed of the screening.
    offsets : bool
        Whether offsets are fitted.

    Returns
    -------
    list of Found
        The valleys found, best first; the best is followed to its end, the rest are not.
    """
    space = Space("none", records, form, offsets)
    found = [
        follow(space, space.pack([start]), 1e-4, _SHORT)
        for start in starts(space, SCREENED, KEPT, seed)
    ]
    found.sort(key=lambda one: one.cost)
    best = follow(space, found[0].theta)
    return [replace(best, evaluations=best.evaluations + found[0].evaluations), *found[1:]]


def _scan(space: Space, gap: int, known: Local) -> Local:
    """Best value at one gap of the parameter that the map ties to it, the rest held."""
    spread = np.linspace(-1.0, 1.0, _SCAN)
    if space.gap_map == "reluctance":
        omega = np.exp(np.linspace(np.log(0.05), np.log(300.0), _SCAN)) - OMEGA_JUMP
        unscaled = known.scale * (1.0 - known.h * known.omega)
        scale = unscaled / np.maximum(1.0 - known.h * omega, 0.01)
    else:
        omega = np.full(_SCAN, known.omega)
        scale = known.scale * 5.0**spread
    sets = np.stack([np.full(_SCAN, known.kappa), np.full(_SCAN, known.c), omega, scale])
    cost, _, _ = screen(space.form, space.records.at(gap), sets, known)
    best = int(np.argmin(cost))
    return replace(known, omega=float(omega[best]), scale=float(scale[best]))


def join_gaps(
    form: Form, records: Records, gap_map: str, known: list[Local], offsets: bool
) -> Found:
    """Fit all gaps together under one map, from what is known at the reference gap.

    Parameters
    ----------
    form, records, offsets
        As in :func:`search_one_gap`, with the loops of all gaps.
    gap_map : str
        ``scaling``, ``reluctance`` or ``free``.
    known : list of Local
        Sets to begin with; the map's scan is made from each.

    Returns
    -------
    Found
    """
    space = Space(gap_map, records, form, offsets)
    home = reference_gap(records)
    tried = []
    for local in known:
        sets = [local if gap == home else _scan(space, gap, local) for gap in range(records.gaps)]
        tried.append(follow(space, space.pack(sets), 1e-4, 2 * _SHORT))
    best = min(tried, key=lambda one: one.cost)
    final = follow(space, best.theta)
    return replace(final, evaluations=final.evaluations + sum(one.evaluations for one in tried))
