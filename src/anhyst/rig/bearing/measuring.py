"""Loops of the magnet of a virtual bearing, its armature held."""

from __future__ import annotations

from anhyst.data import Loops
from anhyst.rig.bearing.file import BearingRig
from anhyst.rig.bearing.plant import make_magnet
from anhyst.rig.measuring import Sensors, measure_place
from anhyst.rig.parts.magnet import Electromagnet
from anhyst.rig.parts.sensors import Converter, Sensor
from anhyst.support.units import QUANTITIES


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


def loop_texts(loops: Loops, notes: str) -> dict[str, str]:
    """Return the text of each file of loops of force and current, by name; notes stand on top."""
    rows = [
        f"{current:.6f},{force:.4f},{gap:.5f},{loop.label}\n"
        for loop in loops.loops
        if loop.schedule is not None
        for current, force, gap in zip(
            loop.input.tolist(), loop.output.tolist(), loop.schedule.tolist(), strict=True
        )
    ]
    return {
        "loops.csv": notes + "I_A,F_N,gap_m,loop\n" + "".join(rows),
        "loops.toml": f'history = "{loops.loops[0].history}"\n',
    }


def measure_loops(rig: BearingRig) -> Loops:
    """Measure what ``[measurement]`` of the rig file asks for.

    Before every record the current goes to its maximum and back, as often as the file says; sensors
    read one sample at a time, quasi-statically.
    """
    held, campaign = HeldBearing(rig), rig.settings.measurement
    places = range(len(campaign.gaps_m))
    loops = [loop for place in places for loop in measure_place(held, campaign, place)]
    return Loops(tuple(loops), QUANTITIES["current"], QUANTITIES["force"], QUANTITIES["gap"])
