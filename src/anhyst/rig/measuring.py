"""Loops of a virtual magnet, measured with the rig's own sensors while the armature is held."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import numpy as np

from anhyst.data.history import History
from anhyst.data.loops import Loop
from anhyst.rig.measurement_table import MeasurementTable
from anhyst.rig.parts.sensors import Sensor
from anhyst.support.numeric import FloatArray

_WHOLE = 1e-6
"""Of a step: so much more than a whole number of them is rounding."""


class Pull(Protocol):
    """A magnet with the memory of its iron, moved so slowly that nothing is induced."""

    def step(self, current: float, gap: float) -> float:
        """Move to a current, A, at a gap, m, and return the pull, N."""


@dataclass(frozen=True, slots=True)
class Sensors:
    """What measures loops: a shunt and a load cell."""

    current: Sensor
    force: Sensor
    gain: float = 1.0  # what the shunt reads at 1 A

    def read(self, current: float, force: float) -> tuple[float, float]:
        """Return what they say of a current, A, and a force, N, one sample on."""
        return self.current.read(self.gain * current), self.force.read(force)


class HeldRig(Protocol):
    """A rig whose armature is held."""

    def magnet(self) -> Pull:
        """Return what pulls, demagnetised."""

    def sensors(self, seed: list[int], sample: float) -> Sensors:
        """Return what measures; the seed of the rig file is added, a sample is so many seconds."""


def straight(turns: Sequence[float], step: float) -> FloatArray:
    """Go straight from turning point to turning point, in steps of at most this size."""
    parts = [np.array(turns[:1])]
    for begin, end in pairwise(turns):
        count = math.ceil(abs(end - begin) / step - _WHOLE)
        parts.append(np.linspace(begin, end, max(count, 1) + 1)[1:])
    return np.concatenate(parts)


def conditioning(campaign: MeasurementTable) -> list[float]:
    """Return the turning points before every record, A: the largest current, and the least of all.

    That is zero where no record goes below.
    """
    least = min(0.0, *(turn for record in campaign.records for turn in record.turns))
    high = campaign.current_max_A
    return [high, least * high] * campaign.conditioning_cycles


def take(
    magnet: Pull, sensors: Sensors, gap: float, path: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Move along currents, A, at a gap, m."""
    rows = np.array([sensors.read(current, magnet.step(current, gap)) for current in path.tolist()])
    return rows[:, 0], rows[:, 1]


def measure_path(
    magnet: Pull, sensors: Sensors, gap: float, path: FloatArray, name: str, past: Sequence[float]
) -> Loop:
    """Measure one record of a magnet that was conditioned."""
    current, force = take(magnet, sensors, gap, path)
    short, whole = f"{1e3 * gap:.2f}", f"{1e3 * gap:.6g}"
    return Loop(
        label=f"{(short if float(short) == float(whole) else whole)}mm-{name}",
        input=current,
        output=force,
        schedule=np.full(path.size, gap),
        history=History("conditioned", (0.0, *past)),
    )


def measure_place(
    held: HeldRig, campaign: MeasurementTable, index: int, magnet: Pull | None = None
) -> list[Loop]:
    """Measure all records of a campaign at one of its gaps."""
    gap, past = campaign.gaps_m[index], conditioning(campaign)
    step = campaign.sweep_A_per_s * campaign.sample_s
    loops = []
    for number, record in enumerate(campaign.records):
        specimen = held.magnet() if magnet is None else magnet
        for turn in past:
            specimen.step(turn, gap)
        path = straight([campaign.current_max_A * turn for turn in record.turns], step)
        sensors = held.sensors([index, number], campaign.sample_s)
        loops.append(measure_path(specimen, sensors, gap, path, record.name, past))
    return loops
