"""Simulate the force-current loops of this folder's bearing.

Magnet, sensors and measurement are described in ``rig.toml``; what they do is in ``anhyst_rigs.rig.parts``
and ``plant/``: iron of pinned cells, not a Jiles-Atherton material, in a circuit with two gaps. The
armature is held, so ``gap_m`` is exact; current and force are what the rig's own sensors read.

Run it again and the same bytes come out: ``python make_loops.py [--out DIR]``.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from anhyst_rigs.rig.body import read_bearing
from anhyst_rigs.rig.measuring import loop_file_texts, measure_loops

HERE = Path(__file__).resolve().parent
NOTES = """\
# simulated, see README.md: magnetic bearing, iron of pinned cells (not Jiles-Atherton)
# history: each record begins after three cycles of the current between 0 and its maximum
# as read: current with the noise of the shunt, force with the noise of its sensor
"""


def files(path: Path = HERE / "rig.toml") -> dict[str, str]:
    """Text of every file of the example that is made, by name."""
    return loop_file_texts(measure_loops(read_bearing(path)), NOTES)


def main() -> None:
    parser = argparse.ArgumentParser(description="Simulate the loops of this bearing.")
    parser.add_argument("--out", type=Path, default=HERE, help="folder to write to")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    for name, text in files().items():
        (given.out / name).write_bytes(text.encode())


if __name__ == "__main__":
    main()
