"""A proportional solenoid: a plunger in front of a stop with a control cone.

The iron path is in series with the sliding clearance of the plunger and with the working gap. Over
the working gap three ways lie in parallel: the flat face of the plunger, the wall of the cone, into
which the plunger dips and whose thin end saturates, and leakage that pulls at nothing. The force
follows from the coenergy of the working gap, ``F = -dW'(u, gap)/dgap`` at its magnetomotive force
``u``, so that force and flux belong to one circuit.
"""

# ruff: noqa: N815 - keys of the file carry units

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from pydantic import Field

from anhyst._core import Piece
from anhyst.rig.parts.iron import AnySteel
from anhyst.support.toml_file import NotNegative, Positive, Table
from anhyst.support.units import MU_0

_ITERATIONS = 100
_TOLERANCE = 1e-7
"""Of the ampere-turns, A."""


class FluxPath(Table):
    """What ``[iron]`` says of its shape."""

    length_m: Positive  # mean length of the flux path in iron
    area_m2: Positive


class CircuitTable(Table):
    """``[circuit]``: winding and poles."""

    turns: Annotated[int, Field(ge=1)]
    slide_reluctance_per_H: NotNegative  # of the sliding clearance
    leakage_H: NotNegative  # permeance parallel to the working gap
    face_area_m2: Positive  # flat face of the plunger
    # how far the face field reaches beyond the edge: it widens the face by ``fringe`` times the gap
    # all round
    fringe: NotNegative
    cone_diameter_m: Positive  # mean diameter of the wall of the cone
    cone_clearance_m: Positive  # radial clearance between plunger and wall
    cone_depth_m: Positive  # gap at which the plunger begins to dip into the cone
    cone_onset_m: Positive  # length over which this beginning is washed out by fringing
    tip_thickness_m: Positive  # thickness of the wall at its end
    tip_taper: NotNegative  # how much thicker it is for each metre of depth
    tip_saturation_T: Positive  # flux density at which the wall saturates


class _Gap(NamedTuple):
    """Working gap at one position: permeances, H, and what they change by for each metre."""

    face: float
    d_face: float
    cone: float
    d_cone: float
    limit: float  # flux that saturates the wall, Wb
    d_limit: float
    leakage: float

    def flux(self, mmf: float) -> tuple[float, float]:
        """Flux, Wb, and its derivative by the ampere-turns over the gap."""
        ratio = self.cone * mmf / self.limit
        root = math.sqrt(1.0 + ratio * ratio)
        straight = self.face + self.leakage
        return straight * mmf + self.cone * mmf / root, straight + self.cone / root**3

    def mmf(self, flux: float, near: float = 0.0) -> tuple[float, float]:
        """Ampere-turns that a flux needs, looked for from some near by, and their derivative by the flux.

        The flux is odd and bends towards the axis of the ampere-turns, so that Newton's steps end
        below after one, and stay below.
        """
        mmf = near
        for _ in range(_ITERATIONS):
            total, slope = self.flux(mmf)
            step = (flux - total) / slope
            mmf += step
            if abs(step) <= _TOLERANCE:
                break
        return mmf, 1.0 / self.flux(mmf)[1]

    def force(self, mmf: float) -> float:
        """Pull that closes the gap, N."""
        ratio = self.cone * mmf / self.limit
        root = math.sqrt(1.0 + ratio * ratio)
        scale = self.limit / self.cone
        by_cone = scale * scale * (root - 1.0) / root
        by_limit = scale * (root - 1.0) ** 2 / root
        return -(0.5 * mmf * mmf * self.d_face + by_cone * self.d_cone + by_limit * self.d_limit)


class Solenoid:
    """Iron and circuit together, with the memory of the iron; starts demagnetised."""

    def __init__(self, steel: AnySteel, path: FluxPath, circuit: CircuitTable) -> None:
        self.iron = Piece(steel.plant())
        self.path, self.circuit = path, circuit
        self.flux = 0.0
        """Flux in the iron after the last step, Wb; times the turns it is the flux linkage."""
        self._slope = 0.0
        self._outside = 0.0  # ampere-turns over the gap
        self.force = 0.0
        """Pull after the last step, N."""

    def step(self, current: float, gap: float) -> float:
        """Move to a current at a gap.

        Exact for a step of any size, as long as the field in the iron does not turn within it.
        """
        here = self._gap(gap)
        field, density = self._field(self.circuit.turns * current, here)
        self.flux = self.path.area_m2 * density
        self.iron.commit(field)
        self._outside = here.mmf(self.flux, self._outside)[0]
        self.force = here.force(self._outside)
        return self.force

    def _field(self, mmf: float, here: _Gap) -> tuple[float, float]:
        """Field in the iron that uses up the ampere-turns, and the flux density there.

        What is left over falls at least as fast as ``iron_length*field``, so its root is bracketed;
        Newton inside the bracket. Where the field stands nothing moves yet: the way from there is
        begun with the slope that the last way ended with.
        """
        area, length = self.path.area_m2, self.path.length_m
        slide = self.circuit.slide_reluctance_per_H
        field = self.iron.field
        low, high = -math.inf, math.inf
        least, outside = self._slope, self._outside
        for _ in range(_ITERATIONS):
            density, slope = self.iron.flux_density(field)
            slope, least = max(slope, least), 0.0
            outside, d_outside = here.mmf(area * density, outside)
            left = mmf - length * field - slide * area * density - outside
            if abs(left) <= _TOLERANCE:
                break
            end = field + left / length
            low, high = (field, min(high, end)) if left > 0.0 else (max(low, end), field)
            field += left / (length + (slide + d_outside) * area * slope)
            if not low < field < high:
                field = 0.5 * (low + high)
            self._slope = slope
        return field, density

    def _gap(self, gap: float) -> _Gap:
        shape = self.circuit
        width = math.sqrt(shape.face_area_m2) + 2.0 * shape.fringe * gap
        face = MU_0 * width * width / gap
        d_face = MU_0 * (4.0 * shape.fringe * width / gap - width * width / (gap * gap))
        dip = shape.cone_depth_m - gap
        reach = math.hypot(dip, shape.cone_onset_m)
        overlap = 0.5 * (dip + reach)
        d_overlap = -0.5 * (1.0 + dip / reach)
        around = math.pi * shape.cone_diameter_m
        by_length = MU_0 * around / shape.cone_clearance_m
        thickness = shape.tip_thickness_m + shape.tip_taper * overlap
        return _Gap(
            face=face,
            d_face=d_face,
            cone=by_length * overlap,
            d_cone=by_length * d_overlap,
            limit=shape.tip_saturation_T * around * thickness,
            d_limit=shape.tip_saturation_T * around * shape.tip_taper * d_overlap,
            leakage=shape.leakage_H,
        )
