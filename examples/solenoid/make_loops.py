"""Simulate the force-current loops of this folder's solenoid.

The solenoid is described in ``solenoid.toml``, its amplifier and sensors in ``rig.toml``; what they
do is in ``anhyst.plants``: iron of pinned cells (play operators with one anhysteretic curve, not a
Jiles-Atherton material) in a circuit with a control cone. Positions are set with gauge blocks, so
``gap_m`` is exact; current and force are what the rig's own sensors read.

Run it again and the same bytes come out: ``python make_loops.py [--out DIR]``.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from anhyst.plants.solenoid import Solenoid
from anhyst.rig.rigfile import Rig, read_rig

HERE = Path(__file__).resolve().parent
NOTES = """\
# simulated, see README.md: proportional solenoid, iron of pinned cells (not Jiles-Atherton)
# history: settled; one cycle of each loop, recorded after three conditioning cycles of it
# as read: current with the offset and noise of the shunt, force with the noise of its sensor
t_s,I_A,F_N,gap_m,loop
"""


def triangle(low: float, high: float, step: float) -> list[float]:
    """One cycle from low to high and back, as samples; its end is its first sample."""
    half = round((high - low) / step)
    return list(high - (high - low) * np.abs(np.arange(2 * half) / half - 1))


def rows(rig: Rig, solenoid: Solenoid) -> Iterator[str]:
    """Measure every loop at every position, in the order of the file."""
    campaign = rig.magnet.measurement
    sample, largest = campaign["sample_s"], campaign["current_max_A"]
    cycles = campaign["conditioning_cycles"]
    clock = 0.0
    for place, gap in enumerate(campaign["gaps_m"]):
        for number, loop in enumerate(campaign["loops"]):
            sensors = rig.instruments([0, place, number], sample)
            low, high = loop["low"] * largest, loop["high"] * largest
            cycle = triangle(low, high, campaign["sweep_A_per_s"] * sample)
            for current in [low, high] * cycles:
                force = solenoid.step(current, gap)
            clock += cycles * len(cycle) * sample
            sensors.force.read(force)
            for current in cycle:
                force = sensors.force.read(solenoid.step(current, gap))
                read = sensors.current.read(current)
                label = f"{gap * 1e3:.1f}mm-{loop['name']}"
                yield f"{clock:.2f},{read:.5f},{force:.4f},{gap:.5f},{label}"
                clock += sample
        clock += campaign["pause_s"]


def files(path: Path = HERE / "rig.toml") -> dict[str, str]:
    """Text of every file of the example, by name."""
    rig = read_rig(path)
    text = NOTES + "\n".join(rows(rig, rig.magnet.solenoid())) + "\n"
    return {"loops.csv": text, "loops.toml": 'history = "settled"\n'}


def main() -> None:
    parser = argparse.ArgumentParser(description="Simulate the loops of this solenoid.")
    parser.add_argument("--out", type=Path, default=HERE, help="folder to write to")
    folder = parser.parse_args().out
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in files().items():
        (folder / name).write_bytes(text.encode())


if __name__ == "__main__":
    main()
