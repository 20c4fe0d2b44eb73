"""Loops of a virtual magnet, measured with the rig's own sensors while the armature is held."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Protocol

import numpy as np

from anhyst._core import Coil
from anhyst.data import Loops
from anhyst.data.loops import Loop
from anhyst.data.path import History
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst.support.units import QUANTITIES
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.measurement_table import MeasurementTable
from anhyst_rigs.rig.piezo import PiezoRig
from anhyst_rigs.rig.sensor_table import NoisySensor, Sensors

_STEP_COUNT_ROUNDING = 1e-6
"""Of a step: so much more than a whole number of them is rounding."""


HeldMagnet = Coil
"""A magnet with the memory of its iron, held at currents and gaps or moved in time."""
Seed = int | list[int]
"""Of noise."""


class HeldRig(Protocol):
    """A rig whose armature is held."""

    def magnet(self) -> HeldMagnet:
        """Return what pulls, demagnetised."""

    def sensors(self, seed: list[int], sample: float) -> Sensors:
        """Return what measures; the seed of the rig file is added, a sample is so many seconds."""


def sweep_path(reversals: Sequence[float], step: float) -> FloatArray:
    """Go straight from turning point to turning point, in steps of at most this size."""
    parts = [np.array(reversals[:1])]
    for begin, end in pairwise(reversals):
        count = math.ceil(abs(end - begin) / step - _STEP_COUNT_ROUNDING)
        parts.append(np.linspace(begin, end, max(count, 1) + 1)[1:])
    return np.concatenate(parts)


def conditioning_path(campaign: MeasurementTable) -> list[float]:
    """Return the turning points before every record, A: the largest current, and the least of all.

    That is zero where no record goes below.
    """
    least = min(0.0, *(turn for record in campaign.records for turn in record.turns))
    high = campaign.current_max_A
    return [high, least * high] * campaign.conditioning_cycles


def measure_path(
    magnet: HeldMagnet, sensors: Sensors, gap: float, path: FloatArray, seconds: float = math.inf
) -> tuple[FloatArray, FloatArray]:
    """Move along currents, A, at a gap, m: slowly, or in so many seconds each."""
    force = magnet.run(path, np.full(path.size, gap), seconds)[:, 0]
    return sensors["current"].read(path), sensors["force"].read(force)


def measure_stack_displacement(
    rig: PiezoRig, voltage: FloatArray, sample: float, seed: Seed
) -> FloatArray:
    """Return the displacements, m, that the sensor of a piezo stage reads, from long rest at 0 V."""
    sensor = rig.settings.position_sensor
    noise = sensor.noise_m * np.random.default_rng(seed).standard_normal(voltage.size)
    read = rig.make_motion(sample).run(voltage) + noise
    if not np.abs(read).max() < 1.0:
        raise InputError(
            f"{rig.path}: stack[1]: stretches beyond 1 m where its loops are measured; correct its "
            "numbers",
            code="stack-leaves-all-bounds",
            key="stack[1]",
        )
    return np.asarray(np.round(read / sensor.step_m) * sensor.step_m if sensor.step_m else read)


SAMPLES_PER_FAST_CYCLE = 200
FAST_CYCLES = 2
"""Number of recorded cycles at each fast rate."""


def measure_at_gap(
    held: HeldRig,
    campaign: MeasurementTable,
    index: int,
    magnet: HeldMagnet | None = None,
    fast_rates: Sequence[float] = (),
) -> list[Loop]:
    """Measure all records of a campaign at one of its gaps.

    With speeds, A/s, all of them in time, and full cycles at each of these besides.
    """
    gap, past, high = campaign.gaps_m[index], conditioning_path(campaign), campaign.current_max_A
    pace, sample_s = campaign.sweep_A_per_s, campaign.sample_s
    runs = [
        (record.name, [high * turn for turn in record.turns], pace, sample_s)
        for record in campaign.records
    ]
    cycles = [0.0, *[high, 0.0] * FAST_CYCLES]
    short, whole = f"{1e3 * gap:.2f}", f"{1e3 * gap:.6g}"
    runs += [
        (f"{speed:g}A/s", cycles, speed, 2.0 * high / (speed * SAMPLES_PER_FAST_CYCLE))
        for speed in fast_rates
    ]
    loops = []
    for number, (name, turns, speed, sample) in enumerate(runs):
        specimen = held.magnet() if magnet is None else magnet
        for turn in past:
            specimen.hold(turn, gap)
        path, sensors = sweep_path(turns, speed * sample), held.sensors([index, number], sample)
        current, force = measure_path(
            specimen, sensors, gap, path, sample if fast_rates else math.inf
        )
        loop = Loop(
            label=f"{(short if float(short) == float(whole) else whole)}mm-{name}",
            input=current,
            output=force,
            schedule=np.full(path.size, gap),
            time=np.arange(path.size, dtype=np.float64) * sample if fast_rates else None,
            history=History("conditioned", (0.0, *past)),
        )
        loops.append(loop)
    return loops


class HeldBearing:
    """A bearing whose armature is held; of a pair, the magnet that closes the gap pulls alone."""

    def __init__(self, rig: BodyRig) -> None:
        self._rig = rig

    def magnet(self) -> Coil:
        """Return what pulls, demagnetised."""
        return Coil(self._rig.magnet)

    def sensors(self, seed: list[int], sample: float) -> Sensors:
        """Return what measures; the seed of the rig file is added, a sample is so many seconds."""
        settings = self._rig.settings
        current, force = settings.current_sensor, settings.force_sensor
        own = [settings.seed, *seed]
        shunt = current.plant_parameters(sample) | {"share": 1.0}  # slow loops pass it as they are
        return {
            "current": NoisySensor(shunt, [*own, 0]),
            "force": NoisySensor(force.plant_parameters(sample), [*own, 1]),
        }


def loop_file_texts(loops: Loops, notes: str) -> dict[str, str]:
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


def measure_loops(rig: BodyRig) -> Loops:
    """Measure what ``[measurement]`` of the rig file asks for.

    Before every record the current goes to its maximum and back, as often as the file says; sensors
    read one sample at a time, quasi-statically, or in time where fast cycles are asked for too.
    """
    held, campaign = HeldBearing(rig), rig.settings.measurement
    places = range(len(campaign.gaps_m))
    fast = campaign.fast_A_per_s
    loops = [
        loop for one in places for loop in measure_at_gap(held, campaign, one, fast_rates=fast)
    ]
    output = QUANTITIES[rig.settings.magnet.output]
    return Loops(tuple(loops), QUANTITIES["current"], output, QUANTITIES["gap"])
