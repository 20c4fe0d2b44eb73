"""Measure virtual magnets by ``anhyst excite --voltage``, with warming and errors of the instruments.

The resistance of the winding rises by about 2 % in a record. The voltage has an offset of a thousandth
of the resistive voltage and noise, and the gaps have the zero error of the measurement.
"""

from __future__ import annotations

import math
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np

from anhyst.data.loops import Loops
from anhyst.data.reading import read_loops
from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.measuring import HeldMagnet
from anhyst_rigs.rig.sensor_table import NoisySensor, Sensors
from anhyst_rigs.study.excite.design import Bound, MeasuredCoil, Specimen, Winding
from anhyst_rigs.study.excite.excite import write_excitation
from anhyst_rigs.study.excite.voltage import measure_voltage
from flux_circuit import Magnet
from flux_magnets import gap_zero_of

TIME_CONSTANT_S = 0.03
"""Largest flux linkage divided by the resistive voltage of the largest current."""
CONTINUOUS_SHARE, THERMAL_S, RISE_K = 0.5, 60.0, 80.0
VOLTAGE_OFFSET, VOLTAGE_NOISE, CURRENT_NOISE = 1e-3, 3e-4, 2e-4
VOLTAGE_RANGE = 3.0
"""Range of the voltage sensor, relative to the resistive voltage of the largest current."""
CONVERTER_STEPS = 65535
HOLD_STEPS = 12


class _Held:
    """A magnet whose armature is held at the gap that the sensor reads."""

    def __init__(self, magnet: Magnet, gap_zero: float) -> None:
        self._running, self._gap_zero, self._current = magnet.start(), gap_zero, 0.0

    def hold(self, current: float, gap: float) -> float:
        """Move slowly to a current, A, and return the force, N."""
        path = np.linspace(self._current, current, HOLD_STEPS + 1)[1:]
        return float(self.run(path, np.full(path.size, gap))[-1, 0])

    def run(self, current: FloatArray, gap: FloatArray, seconds: float = math.inf) -> FloatArray:
        """Return force, N, and flux linkage, Wb, along a path; the iron is laminated."""
        del seconds
        states = self._running.run(current, gap - self._gap_zero)
        self._current = float(current[-1])
        return np.column_stack([states.force, states.psi])


@dataclass(frozen=True)
class _Rig:
    """A rig with one magnet, a current source of both signs, and a voltmeter at the coil."""

    file: Magnet
    seed: int
    resistance: float  # ohm

    def magnet(self) -> HeldMagnet:
        """Return the demagnetised magnet."""
        return cast(Any, _Held(self.file, gap_zero_of(self.seed)))  # type: ignore[no-any-return]

    def sensors(self, seed: list[int], sample: float) -> Sensors:
        """Return the sensors of current and voltage."""
        del sample
        largest = self.file.current_max
        voltage = self.resistance * largest
        instruments = {
            "current": (1.2 * largest, 0.0, CURRENT_NOISE * largest),
            "voltage": (VOLTAGE_RANGE * voltage, VOLTAGE_OFFSET * voltage, VOLTAGE_NOISE * voltage),
        }
        return {
            name: NoisySensor(
                {"low": -limit, "high": limit, "step": 2.0 * limit / CONVERTER_STEPS, "gain": 1.0,
                 "offset": offset, "noise": noise, "share": 1.0, "delay": 0},
                [20261134, self.seed, *seed, number],
            )
            for number, (name, (limit, offset, noise)) in enumerate(instruments.items())
        }  # fmt: skip


def voltage_records(magnet: Magnet, seed: int) -> Loops:
    """Return the loops that are read from the records of ``excite --voltage``."""
    largest = magnet.current_max
    path = largest * np.linspace(0.0, 1.0, 50)
    psi = float(magnet.run(path, magnet.gap_range[0])[0][-1])
    resistance = psi / (largest * TIME_CONSTANT_S)
    zero = gap_zero_of(seed)
    specimen = Specimen(
        held_rig=_Rig(magnet, seed, resistance),
        gaps=tuple(gap + zero for gap in magnet.gap_range),
        operating_force=Bound(0.0, "none"),
        max_current=Bound(largest, "source"),
        max_rate=Bound(math.inf, "source"),
        max_force=Bound(math.inf, "none"),
        min_current=-largest,
        winding=Winding(CONTINUOUS_SHARE * largest, THERMAL_S, RISE_K),
        sweep_rate=largest,
        sample_s=0.01,
        conditioning_cycles=2,
        pause_s=60.0,
        coil=MeasuredCoil(magnet.turns, resistance, None),
    )
    excitation = measure_voltage(specimen)
    with tempfile.TemporaryDirectory(prefix="anhyst-flux-") as folder:
        file = Path(folder) / "coil.csv"
        write_excitation(excitation, Path("virtual"), file)
        return read_loops(file)
