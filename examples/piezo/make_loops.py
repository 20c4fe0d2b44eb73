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
DT = 2e-3
LARGEST = 150.0
NESTED = ((0.0, 150.0), (0.0, 150.0), (0.0, 120.0), (0.0, 90.0), (0.0, 60.0), (0.0, 30.0),
          (60.0, 120.0), (75.0, 105.0), (0.0, 150.0))  # fmt: skip
"""Limits of the drive cycles, V; two cycles for each entry."""
PACE = 300.0
"""Drive rate of the loops, V/s: a full cycle takes one second."""
RATES = (1.0, 5.0, 20.0)
"""Frequencies of the full cycles, Hz."""
REST = 1000.0
"""Rest before each cycle record, s."""


def ramps(points: FloatArray, rate: float, dt: float) -> FloatArray:
    """Return samples of straight ramps between points at a rate, V/s."""
    times = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(points)) / rate)])
    return np.interp(np.arange(0.0, times[-1], dt), times, points)


def nested() -> FloatArray:
    """Return the drive of the loops, V."""
    points = [0.0]
    for low, high in NESTED:
        points += [low, high, low, high, low]
    return ramps(np.array(points), PACE, DT)


def random_reversals(generator: np.random.Generator) -> FloatArray:
    """Return a drive with random reversals at half of `PACE`, V."""
    points = np.concatenate([[0.0], generator.uniform(0.0, LARGEST, 24), [0.0]])
    return ramps(points, 0.5 * PACE, DT)


def cycles(frequency: float) -> tuple[FloatArray, float]:
    """Return two full cycles at a frequency, Hz, and the time step of their samples, s."""
    dt = 1.0 / (400.0 * frequency)
    return 0.5 * LARGEST * (1.0 - np.cos(2.0 * np.pi * np.arange(801) / 400.0)), dt


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
    drive = nested()
    readings = run(rig, drive, DT) + generator.normal(0.0, sensor.noise_m, drive.size)
    readings = np.round(readings / sensor.step_m) * sensor.step_m
    time = DT * np.arange(drive.size, dtype=np.float64)
    write(folder / "loops.csv", time, drive, readings)
    drive = random_reversals(generator)
    write(folder / "unseen.csv", DT * np.arange(drive.size, dtype=np.float64), drive, run(rig, drive, DT))
    with_rates(rig, folder / "rates.csv")


def write(path: Path, time: FloatArray, drive: FloatArray, displacement: FloatArray) -> None:
    """Write one record with the resolution of an instrument, displacement in micrometres."""
    columns = {"t_s": np.round(time, 6), "U_V": np.round(drive, 4), "x_um": np.round(1e6 * displacement, 4)}
    write_csv(path, columns)


def with_rates(rig: PiezoRig, path: Path) -> None:
    """Write full cycles, one loop for each frequency, each after a rest."""
    lines = ["loop,t_s,U_V,x_um"]
    for index, frequency in enumerate(RATES):
        drive, dt = cycles(frequency)
        displacement = run(rig, drive, dt)
        lines += [
            f"{frequency:g}Hz,{REST * index + dt * i:.7f},{u:.4f},{1e6 * x:.4f}"
            for i, (u, x) in enumerate(zip(drive.tolist(), displacement.tolist(), strict=True))
        ]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
