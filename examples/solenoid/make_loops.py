"""Simulate the force-current loops of this folder's solenoid.

The solenoid is described in ``solenoid.toml``, its amplifier and sensors in ``rig.toml``; what they
do is in ``anhyst.rig.parts``: iron of pinned cells (play operators with one anhysteretic curve, not a
Jiles-Atherton material) in a circuit with a control cone. Positions are set with gauge blocks, so
``gap_m`` is exact; current and force are what the rig's own sensors read.

Run it again and the same bytes come out: ``python make_loops.py [--out DIR]``; with
``--rig drawn/rig.toml`` for the solenoid in ``drawn/``.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np

from anhyst.rig.force.file import Rig, read_rig
from anhyst.rig.parts.solenoid import Solenoid

HERE = Path(__file__).resolve().parent
NOTES = """\
# simulated, see README.md: proportional solenoid, iron of pinned cells (not Jiles-Atherton)
# history: each record begins after three cycles of the current between 0 and its maximum
# as read: current with the offset and noise of the shunt, force with the noise of its sensor
t_s,I_A,F_N,gap_m,loop
"""


def path(turns: list[float], step: float) -> list[float]:
    """Go straight from turning point to turning point, in steps of at most about this size."""
    samples = turns[:1]
    for begin, end in pairwise(turns):
        count = round(abs(end - begin) / step)
        samples += np.linspace(begin, end, count + 1)[1:].tolist()
    return samples


def rows(rig: Rig, solenoid: Solenoid) -> Iterator[str]:
    """Measure every record at every position, in the order of the file."""
    campaign = rig.solenoid.measurement
    sample, largest = campaign["sample_s"], campaign["current_max_A"]
    step = campaign["sweep_A_per_s"] * sample
    conditioning = [largest, 0.0] * campaign["conditioning_cycles"]
    clock = 0.0
    for place, gap in enumerate(campaign["gaps_m"]):
        for number, record in enumerate(campaign["records"]):
            sensors = rig.instruments([0, place, number], sample)
            for current in conditioning:
                solenoid.step(current, gap)
            clock += sum(conditioning) / step * 2.0 * sample
            for current in path([largest * turn for turn in record["turns"]], step):
                force = sensors.force.read(solenoid.step(current, gap))
                read = sensors.current.read(current)
                label = f"{gap * 1e3:.2f}mm-{record['name']}"
                yield f"{clock:.2f},{read:.5f},{force:.4f},{gap:.5f},{label}"
                clock += sample
        clock += campaign["pause_s"]


def files(path: Path = HERE / "rig.toml") -> dict[str, str]:
    """Text of every file of the example, by name."""
    rig = read_rig(path)
    campaign = rig.solenoid.measurement
    turns = [0.0] + [campaign["current_max_A"], 0.0] * campaign["conditioning_cycles"]
    history = f"conditioned:{','.join(str(turn) for turn in turns)}"
    text = NOTES + "\n".join(rows(rig, rig.solenoid.solenoid())) + "\n"
    return {"loops.csv": text, "loops.toml": f'history = "{history}"\n'}


def main() -> None:
    parser = argparse.ArgumentParser(description="Simulate the loops of this solenoid.")
    parser.add_argument("--rig", type=Path, default=HERE / "rig.toml", help="rig file")
    parser.add_argument("--out", type=Path, help="folder to write to (that of the rig file)")
    given = parser.parse_args()
    folder = given.out or given.rig.parent
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in files(given.rig).items():
        (folder / name).write_bytes(text.encode())


if __name__ == "__main__":
    main()
