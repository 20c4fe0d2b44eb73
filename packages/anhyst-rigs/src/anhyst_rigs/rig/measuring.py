"""Measure loops of a virtual magnet, whose armature is held, with the sensors of its rig."""

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

_STEP_COUNT_ROUNDING_ERROR = 1e-6
"""Excess over a whole number of steps that counts as a rounding error."""


HeldMagnet = Coil
"""A magnet with hysteresis that follows given currents and gaps, quasi-statically or in time."""
Seed = int | list[int]
"""Seed of a noise generator."""


class HeldRig(Protocol):
    """A rig whose armature is held."""

    def magnet(self) -> HeldMagnet:
        """Return the demagnetised magnet."""

    def sensors(self, seed: list[int], sample: float) -> Sensors:
        """Return the sensors for a sampling time, s; their seed includes that of the rig file."""


def sweep_path(reversals: Sequence[float], step: float) -> FloatArray:
    """Return a path with linear sweeps from one reversal to the next, in steps of at most `step`."""
    current_segments = [np.array(reversals[:1])]
    for begin, end in pairwise(reversals):
        step_count = math.ceil(abs(end - begin) / step - _STEP_COUNT_ROUNDING_ERROR)
        current_segments.append(np.linspace(begin, end, max(step_count, 1) + 1)[1:])
    return np.concatenate(current_segments)


def conditioning_path(campaign: MeasurementTable) -> list[float]:
    """Return the reversal points that precede every record, A.

    They alternate between the largest current and the lowest of all records, but at most zero.
    """
    lowest_relative_current = min(
        0.0, *(relative_current for record in campaign.records for relative_current in record.turns)
    )
    max_current = campaign.current_max_A
    return [max_current, lowest_relative_current * max_current] * campaign.conditioning_cycles


def measure_path(
    magnet: HeldMagnet, sensors: Sensors, gap: float, path: FloatArray, seconds: float = math.inf
) -> tuple[FloatArray, FloatArray]:
    """Return the readings of current, A, and force, N, along a path of currents at a gap, m.

    If `seconds` is infinite, the path is quasi-static; otherwise, each step takes this time, s.
    """
    force = magnet.run(path, np.full(path.size, gap), seconds)[:, 0]
    return sensors["current"].read(path), sensors["force"].read(force)


def measure_stack_displacement(rig: PiezoRig, voltage: FloatArray, period: float, seed: Seed) -> FloatArray:
    """Return readings of a piezo stage, m, along voltages, V, after a long rest at 0 V."""
    sensor = rig.settings.position_sensor
    noise = sensor.noise_m * np.random.default_rng(seed).standard_normal(voltage.size)
    readings = rig.make_motion(period).run(voltage) + noise
    if not np.abs(readings).max() < 1.0:
        raise InputError(
            f"{rig.path}: stack[1]: extends beyond 1 m in the measurement of its loops; correct "
            "its parameters",
            code="stack-leaves-all-bounds",
            key="stack[1]",
        )
    return np.asarray(np.round(readings / sensor.step_m) * sensor.step_m if sensor.step_m else readings)


SAMPLES_PER_FAST_CYCLE = 200
FAST_CYCLES = 2
"""Number of recorded cycles at each fast rate."""


def measure_at_gap(
    rig: HeldRig,
    campaign: MeasurementTable,
    index: int,
    magnet: HeldMagnet | None = None,
    fast_rates: Sequence[float] = (),
) -> list[Loop]:
    """Measure all records of a campaign at one of its gaps.

    With `fast_rates`, A/s, the records are not quasi-static, and full cycles at each rate are
    added.
    """
    gap, conditioning, max_current = (
        campaign.gaps_m[index],
        conditioning_path(campaign),
        campaign.current_max_A,
    )
    sweep_rate, sample_s = campaign.sweep_A_per_s, campaign.sample_s
    planned_records = [
        (record.name, [max_current * reversal for reversal in record.turns], sweep_rate, sample_s)
        for record in campaign.records
    ]
    cycles = [0.0, *[max_current, 0.0] * FAST_CYCLES]
    rounded_gap, exact_gap = f"{1e3 * gap:.2f}", f"{1e3 * gap:.6g}"
    planned_records += [
        (f"{speed:g}A/s", cycles, speed, 2.0 * max_current / (speed * SAMPLES_PER_FAST_CYCLE))
        for speed in fast_rates
    ]
    loops = []
    for number, (name, reversals, speed, period) in enumerate(planned_records):
        specimen = rig.magnet() if magnet is None else magnet
        for held_current in conditioning:
            specimen.hold(held_current, gap)
        path, sensors = sweep_path(reversals, speed * period), rig.sensors([index, number], period)
        current, force = measure_path(specimen, sensors, gap, path, period if fast_rates else math.inf)
        loop = Loop(
            label=f"{rounded_gap if float(rounded_gap) == float(exact_gap) else exact_gap}mm-{name}",
            input=current,
            output=force,
            schedule=np.full(path.size, gap),
            time=np.arange(path.size, dtype=np.float64) * period if fast_rates else None,
            history=History("conditioned", (0.0, *conditioning)),
        )
        loops.append(loop)
    return loops


class HeldBearing:
    """A bearing whose armature is held; only the magnet that closes the gap is driven."""

    def __init__(self, rig: BodyRig) -> None:
        self._rig = rig

    def magnet(self) -> Coil:
        """Return the demagnetised magnet."""
        return Coil(self._rig.magnet)

    def sensors(self, seed: list[int], sample: float) -> Sensors:
        """Return the sensors for a sampling time, s; their seed includes that of the rig file."""
        settings = self._rig.settings
        current, force = settings.current_sensor, settings.force_sensor
        sensor_seed = [settings.seed, *seed]
        # Slow loops have no low-pass filter.
        shunt = current.plant_parameters(sample) | {"share": 1.0}
        sensors = {
            "current": NoisySensor(shunt, [*sensor_seed, 0]),
            "force": NoisySensor(force.plant_parameters(sample), [*sensor_seed, 1]),
        }
        if (coil := settings.coil_sensor) is not None:
            sensors["voltage"] = NoisySensor(coil.plant_parameters(sample), [*sensor_seed, 2])
        return sensors


def loop_file_texts(loops: Loops, notes: str) -> dict[str, str]:
    """Return the texts of files with measured loops, by file name; notes are at the top."""
    has_time = loops.loops[0].time is not None
    rows = []
    for loop in loops.loops:
        assert loop.schedule is not None
        columns = [loop.input, loop.output, loop.schedule]
        template = f"%.6f,%.4f,%.5f,{loop.label}\n"
        if loop.time is not None:
            columns.insert(0, loop.time)
            template = f"%.7g,{template}"
        rows += [template % values for values in zip(*(column.tolist() for column in columns), strict=True)]
    header_line = f"{'t_s,' * has_time}I_A,{loops.output.symbol}_N,gap_m,loop\n"
    return {
        "loops.csv": notes + header_line + "".join(rows),
        "loops.toml": f'history = "{loops.loops[0].history}"\n',
    }


def measure_loops(rig: BodyRig) -> Loops:
    """Measure the loops that ``[measurement]`` of the rig file describes.

    The conditioning cycles precede every record. With fast cycles, all loops are measured in time.
    """
    held_bearing, campaign = HeldBearing(rig), rig.settings.measurement
    indices = range(len(campaign.gaps_m))
    rates = campaign.fast_A_per_s
    loops = [
        loop for index in indices for loop in measure_at_gap(held_bearing, campaign, index, fast_rates=rates)
    ]
    output = QUANTITIES[rig.settings.magnet.output]
    return Loops(tuple(loops), QUANTITIES["current"], output, QUANTITIES["gap"])
