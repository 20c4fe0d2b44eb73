"""Loops of a virtual magnet, measured with the rig's own sensors while the armature is held."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from anhyst._core import Coil
from anhyst.data import LoopSet
from anhyst.data.history import History
from anhyst.data.loop_set import Loop
from anhyst.rig.bearing.file import BearingRig
from anhyst.rig.bearing.plant import make_magnet
from anhyst.rig.parts.sensors import Converter, Sensor
from anhyst.support.arrays import FloatArray
from anhyst.support.units import QUANTITIES


def measure_loops(rig: BearingRig) -> LoopSet:
    """Measure what ``[measurement]`` of the rig file asks for.

    Before every record the current goes to its maximum and back, as often as the file says; sensors
    read one sample at a time, quasi-statically.

    Parameters
    ----------
    rig : BearingRig
        Noise begins with the seed of its file: the same file gives the same loops.

    Returns
    -------
    LoopSet
        Force over current; the current is the true one behind its sensor.
    """
    campaign = rig.settings.measurement
    step = campaign.sweep_A_per_s * campaign.sample_s
    past = [0.0, *[campaign.current_max_A, 0.0] * campaign.conditioning_cycles]
    magnet = make_magnet(rig)
    gain = 1.0 + rig.settings.current_sensor.gain_error
    loops = []
    for place, gap in enumerate(campaign.gaps_m):
        for number, record in enumerate(campaign.records):
            coil = Coil(magnet)
            for current in past:
                coil.hold(current, gap)
            drive = _path([campaign.current_max_A * turn for turn in record.turns], step)
            force = coil.run(drive, np.full(drive.size, gap))[:, 0]
            shunt, cell = _sensors(rig, [rig.settings.seed, place, number])
            loops.append(
                Loop(
                    label=f"{gap * 1e3:.2f}mm-{record.name}",
                    input=np.array([shunt.read(gain * value) for value in drive.tolist()]),
                    output=np.array([cell.read(value) for value in force.tolist()]),
                    schedule=np.full(drive.size, gap),
                    history=History("conditioned", tuple(past)),
                )
            )
    return LoopSet(tuple(loops), QUANTITIES["current"], QUANTITIES["force"], QUANTITIES["gap"])


def _path(turns: list[float], step: float) -> FloatArray:
    """Go straight from turning point to turning point, in steps of at most about this size."""

    def parts() -> Iterator[FloatArray]:
        yield np.array(turns[:1])
        for begin, end in pairwise(turns):
            yield np.linspace(begin, end, max(round(abs(end - begin) / step), 1) + 1)[1:]

    return np.concatenate(list(parts()))


def _sensors(rig: BearingRig, seed: list[int]) -> tuple[Sensor, Sensor]:
    current, force = rig.settings.current_sensor, rig.settings.force_sensor
    dt = rig.settings.measurement.sample_s
    return (
        Sensor(
            Converter(current.low_A, current.high_A, current.adc_bits),
            current.noise_A,
            [*seed, 0],
            dt,
        ),
        Sensor(
            Converter(force.low_N, force.high_N, force.adc_bits),
            force.noise_N,
            [*seed, 1],
            dt,
            bandwidth=force.bandwidth_Hz,
        ),
    )
