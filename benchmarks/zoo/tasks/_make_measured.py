"""Write ``records.csv`` of the measured tasks whose data may be redistributed.

    python -m benchmarks.zoo.tasks._make_measured

The variable ``ANHYST_DATA`` names the folder of measurements. The script copies the text of each number
without a change. It cuts and thins records, and removes the last sample of a cycle if it repeats the
first sample. The file ``task.toml`` of a task states these changes and the split.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

from ..task import FOLDER, measurement_folder

MAX_SAMPLES_PER_LOOP = 300
"""A longer loop is thinned to every second, third ... sample until it has no more samples than this."""

M400_MAX_FIELD = 9500.0
"""Tip of the M400-50A loop, A/m. The branches of the table meet there, and few samples have more field."""

PIEZO_START_S = 0.1
"""Start of the piezo records, s: the output before it responds to a switch-on that is not recorded."""

PIEZO_TRAINING_END_S = 10.0
"""End of the training record of the piezo, s."""

PIEZO_TEST_END_S = 30.0
"""End of the test record of the piezo, s."""


class Sample(NamedTuple):
    """Input and output as they are written in the measured file."""

    input: str
    output: str


@dataclass(frozen=True)
class Block:
    """Range of field on a branch whose samples are withheld, A/m. The range includes both ends."""

    branch: Literal["falling", "rising"]
    H_min: float
    H_max: float


M270_BLOCKS = (
    Block("falling", 30.0, 200.0),  # the knee
    Block("falling", -275.0, -150.0),
    Block("rising", 10.0, 35.0),  # the coercive field
    Block("rising", 175.0, 300.0),
)

M400_BLOCKS = (
    Block("falling", 25.0, 400.0),  # the knee
    Block("falling", -5500.0, -1500.0),
    Block("rising", 20.0, 75.0),  # the coercive field
    Block("rising", 2500.0, 6500.0),
)


def read_loops(file: Path, group: str, columns: tuple[str, str]) -> list[list[Sample]]:
    """Return the loops of a file in their order; a loop has one value in the column `group`."""
    loops: dict[str, list[Sample]] = {}
    with file.open(encoding="utf-8", newline="") as stream:
        for row in csv.DictReader(stream):
            loops.setdefault(row[group] if group else "", []).append(Sample(*(row[key] for key in columns)))
    return list(loops.values())


def thin_cycle(cycle: Sequence[Sample]) -> list[Sample]:
    """Return a closed cycle without a repeated last sample, and with at most the permitted samples."""
    if cycle[0] == cycle[-1]:
        cycle = cycle[:-1]
    return list(cycle[:: math.ceil(len(cycle) / MAX_SAMPLES_PER_LOOP)])


def is_withheld(loop: Sequence[Sample], blocks: Sequence[Block]) -> list[bool]:
    """Return whether each sample of a loop that starts at its positive tip is in one of the blocks."""
    field = [float(sample.input) for sample in loop]
    reversal = field.index(min(field))
    branches = ["falling" if number < reversal else "rising" for number in range(len(field))]
    return [
        any(block.branch == branch and block.H_min <= H <= block.H_max for block in blocks)
        for H, branch in zip(field, branches, strict=True)
    ]


def write_records(task: str, header: str, rows: Iterable[Sequence[str]]) -> None:
    """Write the records of a task."""
    with (FOLDER / task / "records.csv").open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(header.split(","))
        writer.writerows(rows)


def write_loops(task: str, file: Path, group: str) -> None:
    """Write closed loops of a material, numbered in the order of their amplitudes."""
    loops = read_loops(file, group, ("H_A_per_m", "B_T"))
    write_records(
        task,
        "record,input,output",
        [(f"loop-{number}", *sample) for number, loop in enumerate(loops, 1) for sample in thin_cycle(loop)],
    )


def write_blocks(task: str, loop: Sequence[Sample], blocks: Sequence[Block]) -> None:
    """Write a loop without the withheld blocks for training, and the whole loop for the test."""
    withheld = is_withheld(loop, blocks)
    training = [("training", *sample, "") for sample, out in zip(loop, withheld, strict=True) if not out]
    test = [("test", *sample, str(int(out))) for sample, out in zip(loop, withheld, strict=True)]
    write_records(task, "record,input,output,scored", [*training, *test])


def make_steel_m270(folder: Path) -> None:
    """M270-50A: the table within 1 kA/m."""
    (loop,) = read_loops(folder / "steels_modelica" / "m270_50a_1kA.csv", "", ("H_A_per_m", "B_T"))
    write_blocks("steel-m270", thin_cycle(loop), M270_BLOCKS)


def make_steel_m400(folder: Path) -> None:
    """M400-50A: the table up to the field where the branches meet."""
    (table,) = read_loops(folder / "steels_modelica" / "m400_50a_50kA.csv", "", ("H_A_per_m", "B_T"))
    loop = [sample for sample in table if abs(float(sample.input)) <= M400_MAX_FIELD]
    tip = loop.index(min(loop, key=lambda sample: float(sample.input)))
    write_blocks("steel-m400", thin_cycle(loop[:tip] + loop[tip + 1 :]), M400_BLOCKS)


def make_ferrite_mnzn(folder: Path) -> None:
    """MnZn ferrite, 4 loops."""
    write_loops("ferrite-mnzn", folder / "ferrite_mnzn" / "mnzn_hp_ferrite_4loops.csv", "loop")


def make_steel_m130(folder: Path) -> None:
    """M130-27s, 3 loops as measured."""
    write_loops("steel-m130", folder / "steel_m130_27s" / "m130_27s_steel_raw_3loops.csv", "loop")


def make_steel_core1(folder: Path) -> None:
    """Solid steel core, 4 loops."""
    write_loops("steel-core1", folder / "steel_core1_dc" / "loops.csv", "nominal_Hmax_A_per_m")


def make_steel_team32(folder: Path) -> None:
    """Steel of TEAM problem 32, 3 loops."""
    write_loops("steel-team32", folder / "steel_team32" / "loops.csv", "bmax_T")


def make_piezo_flexure(folder: Path) -> None:
    """Piezo stack in a flexure: the time record at its measured sampling rate."""
    with (folder / "piezo_flexure" / "model_run.csv").open(encoding="utf-8", newline="") as stream:
        samples = [row for row in csv.DictReader(stream) if float(row["t_s"]) >= PIEZO_START_S]
    rows = []
    for record, end in (("training", PIEZO_TRAINING_END_S), ("test", PIEZO_TEST_END_S)):
        for row in samples:
            time = float(row["t_s"])
            if time < end:
                scored = "" if record == "training" else str(int(time >= PIEZO_TRAINING_END_S))
                rows.append((record, row["V_in"], row["y_um"], row["t_s"], scored))
    write_records("piezo-flexure", "record,input,output,time,scored", rows)


MAKERS: tuple[Callable[[Path], None], ...] = (
    make_steel_m270,
    make_steel_m400,
    make_ferrite_mnzn,
    make_steel_m130,
    make_steel_core1,
    make_steel_team32,
    make_piezo_flexure,
)


def main() -> None:
    """Write the records of each task in this file."""
    for make in MAKERS:
        make(measurement_folder())


if __name__ == "__main__":
    main()
