"""Loops of the magnet of a virtual bearing, its armature held."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from anhyst.data import Loops
from anhyst.data.loops import Loop
from anhyst.rig.bearing.file import BearingRig
from anhyst.rig.bearing.plant import make_magnet
from anhyst.rig.measurement_table import CampaignTable
from anhyst.rig.measuring import Sensors, conditioning, measure_path, measure_place, straight
from anhyst.rig.parts.magnet import Electromagnet
from anhyst.rig.parts.sensors import Converter, Sensor
from anhyst.support.units import QUANTITIES

FAST_SAMPLES, FAST_CYCLES = 200, 2
"""Of a fast cycle, and how many of them are recorded."""


class HeldBearing:
    """A bearing whose armature is held; of a pair, the magnet that closes the gap pulls alone."""

    def __init__(self, rig: BearingRig) -> None:
        self._rig = rig
        self._magnet = make_magnet(rig)

    def magnet(self) -> Electromagnet:
        """Return what pulls, demagnetised."""
        return Electromagnet(self._magnet)

    def sensors(self, seed: list[int], sample: float) -> Sensors:
        """Return what measures; the seed of the rig file is added, a sample is so many seconds."""
        settings = self._rig.settings
        current, force = settings.current_sensor, settings.force_sensor
        own = [settings.seed, *seed]
        shunt = Converter.of_bits(current.low_A, current.high_A, current.adc_bits)
        cell = Converter.of_bits(force.low_N, force.high_N, force.adc_bits)
        return Sensors(
            Sensor(shunt, current.noise_A, [*own, 0], sample),
            Sensor(cell, force.noise_N, [*own, 1], sample, bandwidth=force.bandwidth_Hz),
            1.0 + current.gain_error,
        )


def _measure_in_time(held: HeldBearing, campaign: CampaignTable, index: int) -> list[Loop]:
    """Measure all records at one gap and full cycles at every fast speed, with what speed induces."""
    gap, past, high = campaign.gaps_m[index], conditioning(campaign), campaign.current_max_A
    runs = [
        (
            record.name,
            [high * turn for turn in record.turns],
            campaign.sweep_A_per_s,
            campaign.sample_s,
        )
        for record in campaign.records
    ]
    cycles = [0.0, *[high, 0.0] * FAST_CYCLES]
    runs += [
        (f"{speed:g}A/s", cycles, speed, 2.0 * high / (speed * FAST_SAMPLES))
        for speed in campaign.fast_A_per_s
    ]
    loops = []
    for number, (name, turns, speed, sample) in enumerate(runs):
        magnet = held.magnet()
        for turn in past:
            magnet.step(turn, gap)
        magnet.seconds = sample
        path = straight(turns, speed * sample)
        loop = measure_path(magnet, held.sensors([index, number], sample), gap, path, name, past)
        loops.append(replace(loop, time=np.arange(path.size, dtype=np.float64) * sample))
    return loops


def loop_texts(loops: Loops, notes: str) -> dict[str, str]:
    """Return the text of each file of loops of force and current, by name; notes stand on top."""
    timed = loops.loops[0].time is not None
    rows = []
    for loop in loops.loops:
        assert loop.schedule is not None
        columns = [loop.input, loop.output, loop.schedule]
        form = f"%.6f,%.4f,%.5f,{loop.label}\n"
        if loop.time is not None:
            columns.insert(0, loop.time)
            form = f"%.7g,{form}"
        rows += [form % row for row in zip(*(column.tolist() for column in columns), strict=True)]
    header = f"{'t_s,' * timed}I_A,{loops.output.symbol}_N,gap_m,loop\n"
    return {
        "loops.csv": notes + header + "".join(rows),
        "loops.toml": f'history = "{loops.loops[0].history}"\n',
    }


def measure_loops(rig: BearingRig) -> Loops:
    """Measure what ``[measurement]`` of the rig file asks for.

    Before every record the current goes to its maximum and back, as often as the file says; sensors
    read one sample at a time, quasi-statically, or in time where fast cycles are asked for too.
    """
    held, campaign = HeldBearing(rig), rig.settings.measurement
    places = range(len(campaign.gaps_m))
    measure = _measure_in_time if campaign.fast_A_per_s else measure_place
    loops = [loop for index in places for loop in measure(held, campaign, index)]
    output = QUANTITIES[rig.settings.magnet.output]
    return Loops(tuple(loops), QUANTITIES["current"], output, QUANTITIES["gap"])
