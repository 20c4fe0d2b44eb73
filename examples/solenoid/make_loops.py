"""Simulate the force-current loops of the solenoid in this folder.

``solenoid.toml`` describes the solenoid, ``rig.toml`` its amplifier and sensors; ``plant/`` (C)
implements them. The iron has pinned cells (play operators with one anhysteretic curve) and is not a
Jiles-Atherton material; the circuit has a control cone. Gauge blocks set the positions, so
``gap_m`` is exact. Current and force are readings of the rig's sensors.

``python make_loops.py [--out DIR]`` writes the files; the output is reproducible byte for byte. The
option ``--rig drawn/rig.toml`` selects the solenoid in ``drawn/``.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

from anhyst_rigs.rig.force.file import ForceControlRig, read_rig
from anhyst_rigs.rig.measurement_table import MeasurementTable
from anhyst_rigs.rig.measuring import conditioning_path, measure_at_gap

HERE = Path(__file__).resolve().parent
NOTES = """\
# simulated, see README.md: proportional solenoid, iron of pinned cells (not Jiles-Atherton)
# history: each record begins after three cycles of the current between 0 and its maximum
# as read: current with the offset and noise of the shunt, force with the noise of its sensor
t_s,I_A,F_N,gap_m,loop
"""


def rows(rig: ForceControlRig) -> Iterator[str]:
    """Yield the rows of every record at every position, in the order of the file."""
    campaign, solenoid = campaign_of(rig), rig.magnet()
    sample = campaign.sample_s
    step = campaign.sweep_A_per_s * sample
    clock = 0.0
    for gap_index in range(len(campaign.gaps_m)):
        for loop in measure_at_gap(rig, campaign, gap_index, solenoid):
            clock += sum(conditioning_path(campaign)) / step * 2.0 * sample
            gap = campaign.gaps_m[gap_index]
            for current, force in zip(loop.input.tolist(), loop.output.tolist(), strict=True):
                yield f"{clock:.2f},{current:.5f},{force:.4f},{gap:.5f},{loop.label}"
                clock += sample
        clock += campaign.pause_s


def campaign_of(rig: ForceControlRig) -> MeasurementTable:
    """Return the measurement settings of the loops."""
    assert rig.solenoid_file is not None
    assert rig.solenoid_file.measurement is not None
    return rig.solenoid_file.measurement


def files(path: Path = HERE / "rig.toml") -> dict[str, str]:
    """Return the text of every file of the example, by name."""
    rig = read_rig(path)
    turning_points = [0.0, *conditioning_path(campaign_of(rig))]
    history = f"conditioned:{','.join(str(turning_point) for turning_point in turning_points)}"
    text = NOTES + "\n".join(rows(rig)) + "\n"
    return {"loops.csv": text, "loops.toml": f'history = "{history}"\n'}


def main() -> None:
    parser = argparse.ArgumentParser(description="Simulate the loops of this solenoid.")
    parser.add_argument("--rig", type=Path, default=HERE / "rig.toml", help="rig file")
    parser.add_argument("--out", type=Path, help="folder to write to (that of the rig file)")
    options = parser.parse_args()
    folder = options.out or options.rig.parent
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in files(options.rig).items():
        (folder / name).write_bytes(text.encode())


if __name__ == "__main__":
    main()
