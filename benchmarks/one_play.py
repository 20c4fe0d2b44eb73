"""Compare a compensator with one play operator with the full law and the single-valued curve.

The metric is the force error on the whole loop and on small cycles, relative to the true force of a
virtual magnet. The irons of the magnets are not laws of anhyst, except that of the bearing, which
consists of play cells. Each compensator is fitted to loops that the simulated sensors measured, and
it runs in fixed point. ``python -m benchmarks.one_play`` prints a table.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from anhyst.compensate.methods import make_compensator
from anhyst.compensate.sources import OperatingRange, Sources
from anhyst.compilation.play import CycleErrors, ForceModel, max_magnitude, measure_cycle_errors
from anhyst.data import Loops
from anhyst.data.reading import read_loops
from anhyst.support.kinds import MethodName
from anhyst.support.numeric import FloatArray, rms
from anhyst_rigs.rig.body import read_bearing
from anhyst_rigs.rig.fitting import identify_magnet
from tests.foreign.magnets import MAGNETS, ForeignMagnet

BEARING = Path(__file__).resolve().parent.parent / "examples" / "bearing"
METHODS: tuple[MethodName, ...] = ("single-valued", "play", "full")
DEMAND_FRACTION = 0.95
"""Largest demand at a gap, as a fraction of the force at this gap with the largest current."""


def _simulated_readings(magnet: ForeignMagnet, current: FloatArray, gap: float) -> FloatArray:
    """Return the noise-free sensor readings of force; negative currents are set to zero."""
    sensors = magnet.sensors
    coil_current = np.maximum(current - sensors.current_offset, 0.0)
    return magnet.force(coil_current, gap) + sensors.force_offset


def list_magnets() -> Iterator[tuple[str, Loops, ForceModel]]:
    """Yield the name, the measured loops and the true force function of each magnet."""
    rig = read_bearing(BEARING / "rig.toml")

    def bundled(current: FloatArray, gap: float) -> FloatArray:
        return rig.static_map(current, np.full(current.size, gap))[0]

    yield "bearing", read_loops(BEARING / "loops.csv"), bundled
    with tempfile.TemporaryDirectory() as folder:
        for name, magnet in MAGNETS.items():
            loops = read_loops(magnet.write_loops(Path(folder) / f"{name}.csv"))
            yield name, loops, partial(_simulated_readings, magnet)


def measure(loops: Loops, force_model: ForceModel) -> tuple[float, dict[str, CycleErrors]]:
    """Return the largest demand, N, and the errors of each method over three gaps."""
    gaps = [gap for gap in loops.by_schedule() if gap is not None]
    end_gaps = min(gaps), max(gaps)
    max_current = max(float(loop.input.max()) for loop in loops.loops)
    drive = np.linspace(0.0, max_current, 100)
    test_gaps = np.linspace(*end_gaps, 5)[1:-1].tolist()
    max_demand = {gap: DEMAND_FRACTION * float(force_model(drive, gap)[-1]) for gap in test_gaps}
    largest = max(max_demand.values())
    operating_range = OperatingRange(test_gaps[1], 0.5 * largest, 20_000.0, end_gaps, largest, max_current)
    sources = Sources(operating_range, loops, identify_magnet(loops).model)
    errors_by_method: dict[str, CycleErrors] = {}
    for method in METHODS:
        compensator = make_compensator(method, sources, "fixed")
        for gap in test_gaps:
            errors = measure_cycle_errors(compensator.reset_copy(), force_model, gap, max_demand[gap])
            errors_by_method[method] = (
                errors_by_method[method].join_errors(errors) if method in errors_by_method else errors
            )
    return largest, errors_by_method


def main() -> None:
    """Print the table in per cent of the largest force."""
    print("| magnet | law | whole loop, rms | worst | cycles of 10 %, rms | worst |")
    print("| --- | --- | --- | --- | --- | --- |")
    for name, loops, force_model in list_magnets():
        largest, errors_by_method = measure(loops, force_model)
        for method, errors in errors_by_method.items():
            values = [
                error_measure(cycle_errors)
                for cycle_errors in (errors.major, errors.small)
                for error_measure in (rms, max_magnitude)
            ]
            error_texts = " | ".join(f"{100.0 * value / largest:.2f}" for value in values)
            print(f"| {name}, {largest:.0f} N | `{method}` | {error_texts} |", flush=True)


if __name__ == "__main__":
    main()
