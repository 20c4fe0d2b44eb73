"""Simulate voltage-displacement loops of the piezo stage in ``rig.toml``.

``python make_loops.py --out DIR`` writes ``loops.csv`` with sensor readings, and two files without
noise: ``unseen.csv`` with random reversals at another rate, and ``rates.csv`` with full cycles at
increasing frequencies. The output is reproducible byte for byte. The stage is that of
``anhyst_rigs.rig.piezo``.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from anhyst.data.formats.text import write_csv
from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.piezo import PiezoRig, read_piezo_rig

HERE = Path(__file__).resolve().parent
SEED = 20261123
TIME_STEP = 2e-3
LARGEST_VOLTAGE = 150.0
CYCLE_LIMITS = ((0.0, 150.0), (0.0, 150.0), (0.0, 120.0), (0.0, 90.0), (0.0, 60.0), (0.0, 30.0),
          (60.0, 120.0), (75.0, 105.0), (0.0, 150.0))  # fmt: skip
"""Limits of the drive cycles, V; two cycles for each entry."""
DRIVE_RATE = 300.0
"""Drive rate of the loops, V/s: a full cycle takes one second."""
FREQUENCIES = (1.0, 5.0, 20.0)
"""Frequencies of the full cycles, Hz."""
REST_S = 1000.0
"""Rest before each cycle record, s."""


def ramps(points: FloatArray, rate: float, dt: float) -> FloatArray:
    """Return samples of straight ramps between points at a rate, V/s."""
    times = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(points)) / rate)])
    return np.interp(np.arange(0.0, times[-1], dt), times, points)


def loop_drive() -> FloatArray:
    """Return the drive of the loops, V."""
    points = [0.0]
    for low_voltage, high_voltage in CYCLE_LIMITS:
        points += [low_voltage, high_voltage, low_voltage, high_voltage, low_voltage]
    return ramps(np.array(points), DRIVE_RATE, TIME_STEP)


def random_reversals(generator: np.random.Generator) -> FloatArray:
    """Return a drive with random reversals at half of `DRIVE_RATE`, V."""
    points = np.concatenate([[0.0], generator.uniform(0.0, LARGEST_VOLTAGE, 24), [0.0]])
    return ramps(points, 0.5 * DRIVE_RATE, TIME_STEP)


def full_cycles(frequency: float) -> tuple[FloatArray, float]:
    """Return two full cycles at a frequency, Hz, and the time step of their samples, s."""
    dt = 1.0 / (400.0 * frequency)
    return 0.5 * LARGEST_VOLTAGE * (1.0 - np.cos(2.0 * np.pi * np.arange(801) / 400.0)), dt


def run(rig: PiezoRig, drive: FloatArray, dt: float) -> FloatArray:
    """Return the response of the stage to a drive."""
    return rig.make_motion(dt).run(drive)


def main() -> None:
    """Write the three files."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=HERE)
    folder = parser.parse_args().out
    rig = read_piezo_rig(HERE / "rig.toml")
    sensor = rig.settings.position_sensor
    generator = np.random.default_rng(SEED)
    drive = loop_drive()
    readings = run(rig, drive, TIME_STEP) + generator.normal(0.0, sensor.noise_m, drive.size)
    readings = np.round(readings / sensor.step_m) * sensor.step_m
    time = TIME_STEP * np.arange(drive.size, dtype=np.float64)
    write_record(folder / "loops.csv", time, drive, readings)
    drive = random_reversals(generator)
    write_record(
        folder / "unseen.csv",
        TIME_STEP * np.arange(drive.size, dtype=np.float64),
        drive,
        run(rig, drive, TIME_STEP),
    )
    write_frequency_cycles(rig, folder / "rates.csv")


def write_record(path: Path, time: FloatArray, drive: FloatArray, displacement: FloatArray) -> None:
    """Write one record with the resolution of an instrument, displacement in micrometres."""
    columns = {"t_s": np.round(time, 6), "U_V": np.round(drive, 4), "x_um": np.round(1e6 * displacement, 4)}
    write_csv(path, columns)


def write_frequency_cycles(rig: PiezoRig, path: Path) -> None:
    """Write full cycles, one loop for each frequency, each after a rest."""
    lines = ["loop,t_s,U_V,x_um"]
    for index, frequency in enumerate(FREQUENCIES):
        drive, dt = full_cycles(frequency)
        displacement = run(rig, drive, dt)
        lines += [
            f"{frequency:g}Hz,{REST_S * index + dt * i:.7f},{voltage:.4f},{1e6 * position:.4f}"
            for i, (voltage, position) in enumerate(zip(drive.tolist(), displacement.tolist(), strict=True))
        ]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
