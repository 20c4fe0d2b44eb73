"""Simulate the force-current loops of the stage in this folder.

``rig.toml`` describes magnet, sensors and measurement; ``anhyst_rigs.rig.parts`` and ``plant/``
implement them. The iron has pinned cells and is not a Jiles-Atherton material; the circuit has two
gaps. The mass is fixed, so ``gap_m`` is exact. Current and force are readings of the rig's sensors.

``python make_loops.py [--out DIR]`` writes the files; the output is reproducible byte for byte.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from anhyst_rigs.rig.measuring import loop_file_texts, measure_loops
from anhyst_rigs.rig.stage.file import read_stage

HERE = Path(__file__).resolve().parent
NOTES = """\
# simulated, see README.md: magnet of a stage, iron of pinned cells (not Jiles-Atherton)
# history: each record begins after three cycles of the current between 0 and its maximum
# as read: current with the noise of the shunt, force with the noise of its sensor
"""


def files(rig_path: Path = HERE / "rig.toml") -> dict[str, str]:
    """Return the text of every generated file of the example, by name."""
    return loop_file_texts(measure_loops(read_stage(rig_path)), NOTES)


def main() -> None:
    parser = argparse.ArgumentParser(description="Simulate the loops of these magnets.")
    parser.add_argument("--out", type=Path, default=HERE, help="folder to write to")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    for name, text in files().items():
        (options.out / name).write_bytes(text.encode())


if __name__ == "__main__":
    main()
