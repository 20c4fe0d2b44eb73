"""Drives of simulated tasks, and the records that a simulated system gives along them.

The file ``task.toml`` of a task lists which records are closed cycles and which are for training.
A closed cycle is repeated before it is recorded. Only training records have sensor noise.
"""

from __future__ import annotations

import csv
import itertools
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...records import LEAD_IN_CYCLES, FloatArray

CYCLES = 6
"""Number of times that a closed cycle runs; the last one is recorded."""
MAX_CYCLE_CHANGE = 3e-4
"""Largest difference of the last cycle from that after the lead-in of a model, relative to the range."""


@dataclass(frozen=True)
class Drive:
    """Input, schedule and time of a record."""

    input: FloatArray
    schedule: FloatArray | None = None
    time: FloatArray | None = None  # s, in equal steps

    def repeat(self, count: int) -> Drive:
        """Return a drive that repeats this one."""
        time = None
        if self.time is not None:
            time = (self.time[1] - self.time[0]) * np.arange(count * self.input.size)
        schedule = None if self.schedule is None else np.tile(self.schedule, count)
        return Drive(np.tile(self.input, count), schedule, time)


@dataclass(frozen=True)
class System:
    """A simulated system and the drives of its task.

    Parameters
    ----------
    respond
        Returns the output along a drive that starts in the state without a history.
    drives
        Drives by the names of the records.
    noise
        Standard deviation of the sensor noise in training records, in the unit of the output.
    seed
        Seed of the noise.
    """

    respond: Callable[[Drive], FloatArray]
    drives: Mapping[str, Drive]
    noise: float
    seed: int


def make_ramps(points: Sequence[float] | FloatArray, samples_per_unit: float) -> FloatArray:
    """Return straight ramps between reversal points, without the last point."""
    pieces = [
        np.linspace(start, end, max(1, round(abs(end - start) * samples_per_unit)), endpoint=False)
        for start, end in itertools.pairwise(points)
    ]
    return np.concatenate(pieces)


def simulate_records(folder: Path, system: System) -> dict[str, tuple[Drive, FloatArray]]:
    """Return the drive and the output of each record, by its name.

    Raises
    ------
    ValueError
        A cycle does not close.
    """
    table = tomllib.loads((folder / "task.toml").read_text(encoding="utf-8"))["records"]
    records, changes = {}, {}
    for name, drive in system.drives.items():
        if table[name]["history"] == "demagnetised":
            records[name] = drive, system.respond(drive)
            continue
        cycles = system.respond(drive.repeat(CYCLES)).reshape(CYCLES, -1)
        changes[name] = float(np.max(np.abs(cycles[-1] - cycles[LEAD_IN_CYCLES])))
        records[name] = drive, cycles[-1]
    output_range = float(np.ptp(np.concatenate([output for _, output in records.values()])))
    for name, change in changes.items():
        if change > MAX_CYCLE_CHANGE * output_range:
            raise ValueError(f"{folder.name}: cycle '{name}' still changes by {change / output_range:.1e}")
    rng = np.random.default_rng(system.seed)
    for name, (drive, output) in records.items():
        if table[name]["part"] == "training":
            records[name] = drive, output + system.noise * rng.standard_normal(output.size)
    return records


def write_records(file: Path, records: Mapping[str, tuple[Drive, FloatArray]]) -> None:
    """Write the records of a task with 9 significant digits."""
    first_drive, _ = next(iter(records.values()))
    optional = {"schedule": first_drive.schedule, "time": first_drive.time}
    names = [name for name, values in optional.items() if values is not None]
    with file.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(["record", "input", "output", *names])
        for record, (drive, output) in records.items():
            columns = [drive.input, output, *(getattr(drive, name) for name in names)]
            writer.writerows(
                [record, *(f"{value + 0.0:.9g}" for value in row)] for row in zip(*columns, strict=True)
            )
