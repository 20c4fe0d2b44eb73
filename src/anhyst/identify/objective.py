"""The deviation between measured and modelled loops, over all loops and gaps at once."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from anhyst.identify.response import Local, NoResponse, Responder
from anhyst.identify.space import Space

Floats = NDArray[np.float64]

_IMPOSSIBLE = 10.0
"""Deviation, in units of the largest output, where the law has no answer."""


@dataclass
class Objective:
    """Weighted deviations as a function of the coordinates of a space.

    The sum of squares is the mean square deviation relative to the largest output, as far as the
    weights make all samples equal. ``evaluations`` counts calls.
    """

    space: Space
    evaluations: int = 0
    _responder: Responder = field(default_factory=Responder)

    def __post_init__(self) -> None:
        drives = self.space.records.drives
        self.measured = np.concatenate([drive.output for drive in drives])
        self.weights = np.concatenate([np.full(d.output.size, d.weight) for d in drives])

    @property
    def impossible(self) -> Floats:
        """Deviations that stand for parameters without an answer."""
        return _IMPOSSIBLE * self.space.records.output_span * self.weights

    def outputs(self, sets: list[Local]) -> Floats:
        """Modelled outputs of all drives, one after the other, SI."""
        self.evaluations += 1
        form = self.space.form
        built: dict[tuple[float, float, float], object] = {}
        parts = []
        for drive in self.space.records.drives:
            local = sets[drive.gap]
            key = (local.kappa, local.c, local.omega if form.law != "effective-field" else 0.0)
            operator = built.setdefault(key, None) or form.operator(local)
            built[key] = operator
            parts.append(self._responder.output(form, local, operator, drive))  # type: ignore[arg-type]
        return np.concatenate(parts)

    def deviations(self, theta: Floats) -> Floats:
        """Weighted deviations, shape (samples,)."""
        try:
            found = self.outputs([local for local, _ in self.space.unpack(theta)])
        except NoResponse:
            return self.impossible
        return (found - self.measured) * self.weights

    def with_jacobian(self, theta: Floats) -> tuple[Floats, Floats]:
        """Weighted deviations and their derivatives, shapes (samples,) and (samples, size)."""
        self.evaluations += 1
        form = self.space.form
        sets = self.space.unpack(theta)
        operators: dict[tuple[float, float], object] = {}
        values, rows = [], []
        for drive in self.space.records.drives:
            local, by_theta = sets[drive.gap]
            key = (local.kappa, local.c)
            if key not in operators:
                operators[key] = form.operator(local)
            output, by_local = self._responder.with_derivatives(
                form,
                local,
                operators[key],  # type: ignore[arg-type]
                drive,
            )
            values.append((output - drive.output) * drive.weight)
            rows.append((by_local * drive.weight) @ by_theta)
        return np.concatenate(values), np.concatenate(rows)
