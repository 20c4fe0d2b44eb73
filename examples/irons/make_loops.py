"""Simulate force-current loops of the bundled electromagnet with another iron.

Winding, poles, drive and sensors are those of ``../electromagnet/magnet.toml``; ``irons.toml``
defines the irons. The magnet is that of the plant (``anhyst_rigs.rig.parts.magnet``).

``python make_loops.py NAME --out DIR`` writes the loops as sensor readings, and three noise-free
files: loops at unseen gaps, random reversals of the current while the gap moves, and small cycles
about a bias. The output is reproducible byte for byte.
"""

from __future__ import annotations

import argparse
import importlib.util
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from types import ModuleType

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter

from anhyst._core import Coil, Magnet
from anhyst.support.numeric import FloatArray, sine
from anhyst_rigs.rig.parts.iron import IronEntry, NamedIron
from anhyst_rigs.rig.parts.magnet import Poles, make_iron_magnet

HERE = Path(__file__).resolve().parent
SEED = 20261122
MOVING_REVERSALS = 40
MOVING_PERIOD = 3.1  # period of the gap motion, s
SMALL_REVERSALS = 12
SMALL_BIASES = (0.3, 0.5, 0.7)  # relative to the largest current
SMALL_AMPLITUDE = 0.04  # amplitude, relative to the largest current


def _load_bundled_script() -> ModuleType:
    path = HERE.parent / "electromagnet" / "make_loops.py"
    spec = importlib.util.spec_from_file_location("bundled_magnet", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # its dataclasses look up their module there
    spec.loader.exec_module(module)
    return module


bundled = _load_bundled_script()
SETTINGS = bundled.load()[1]
CIRCUIT_SETTINGS, DRIVE_SETTINGS = SETTINGS["circuit"], SETTINGS["drive"]
LARGEST: float = DRIVE_SETTINGS["current_max_A"]
POLES = Poles(
    turns=CIRCUIT_SETTINGS["turns"],
    resistance=1.2,
    width=CIRCUIT_SETTINGS["pole_width_m"],
    depth=CIRCUIT_SETTINGS["pole_depth_m"],
    leakage=CIRCUIT_SETTINGS["leakage_H"],
    iron_length=SETTINGS["iron"]["length_m"],
)


def tables(path: Path = HERE / "irons.toml") -> dict[str, NamedIron]:
    """Return the irons by name, as a rig file defines them."""
    schema: TypeAdapter[NamedIron] = TypeAdapter(IronEntry)
    irons = tomllib.loads(path.read_text(encoding="utf-8"))
    return {name: schema.validate_python({"name": name, **table}) for name, table in irons.items()}


def magnet(name: str) -> Magnet:
    """Return the bundled electromagnet with this iron."""
    return make_iron_magnet(POLES, tables()[name])


@dataclass(frozen=True)
class Truth:
    """A path from the demagnetised state and the true force along it, without noise."""

    label: str
    time: FloatArray  # s
    current: FloatArray  # A
    gap: FloatArray  # m
    force: FloatArray  # N
    counted: NDArray[np.bool_]  # samples that belong to the named path, without the lead-in


def sweeps(turning_points: list[float]) -> FloatArray:
    """Return the samples of straight current ramps between points, A."""
    step = DRIVE_SETTINGS["sweep_A_per_s"] * DRIVE_SETTINGS["sample_s"]
    ramp_samples = [np.array(turning_points[:1])]
    for start, end in pairwise(turning_points):
        count = max(1, round(abs(end - start) / step))
        ramp_samples.append(start + (end - start) * np.arange(1, count + 1) / count)
    return np.concatenate(ramp_samples)


def _truth(name: str, label: str, current: FloatArray, gap: FloatArray, first_counted: int) -> Truth:
    time = DRIVE_SETTINGS["sample_s"] * np.arange(current.size)
    force = np.ascontiguousarray(Coil(magnet(name)).run(current, gap)[:, 0])
    return Truth(label, time, current, gap, force, np.arange(current.size) >= first_counted)


def moving(name: str) -> Truth:
    """Return a record of random current reversals while the gap moves over its range."""
    rng = np.random.default_rng([SEED, 1])
    current = sweeps([0.0, *(LARGEST * rng.random(MOVING_REVERSALS)).tolist(), 0.0])
    gaps = SETTINGS["identification"]["gaps_m"]
    middle_gap, gap_amplitude = 0.5 * (gaps[-1] + gaps[0]), 0.5 * (gaps[-1] - gaps[0])
    gap = middle_gap + gap_amplitude * sine(
        DRIVE_SETTINGS["sample_s"] / MOVING_PERIOD * np.arange(current.size)
    )
    return _truth(name, "moving", current, gap, 0)


def small_cycles(name: str) -> Iterator[Truth]:
    """Yield records of small random reversals about a bias, at gaps that were not measured.

    Each bias is reached from zero and from the largest current.
    """
    rng = np.random.default_rng([SEED, 2])
    for gap in SETTINGS["unseen"]["gaps_m"]:
        for bias in SMALL_BIASES:
            for branch, approach_points in (("up", [0.0, LARGEST, 0.0]), ("down", [0.0, LARGEST])):
                swings = SMALL_AMPLITUDE * (2.0 * rng.random(SMALL_REVERSALS) - 1.0)
                approach = sweeps([*approach_points, LARGEST * bias])
                cycles = sweeps([LARGEST * bias, *(LARGEST * (bias + swings)).tolist()])[1:]
                current = np.concatenate([approach, cycles])
                label = f"{gap * 1e3:.2f}mm-{bias:g}-{branch}"
                yield _truth(name, label, current, np.full(current.size, gap), approach.size)


def rows(truths: list[Truth], offset: float) -> Iterator[str]:
    """Yield the rows of several records; the current includes the sensor's offset."""
    clock = 0.0
    for truth in truths:
        columns = (clock + truth.time, truth.current + offset, truth.force, truth.gap)
        for time, current, force, gap in zip(*columns, strict=True):
            yield f"{time:.2f},{current:.6f},{force:.6f},{gap:.9f},{truth.label}"
        clock = float(columns[0][-1]) + DRIVE_SETTINGS["pause_s"]


class Stepped:
    """A magnet with another iron and the interface of the bundled script."""

    def __init__(self, name: str) -> None:
        self._coil = Coil(magnet(name))

    def step(self, current: float, gap: float) -> float:
        """Move to a current, A, at a gap, m, and return the force, N."""
        return self._coil.hold(current, gap)


def files(name: str) -> dict[str, str]:
    """Return the text of every file of one iron, by name."""
    offset = SETTINGS["sensors"]["current_offset_A"]

    header = f"simulated, see README.md: the bundled electromagnet with the iron {name}\n"
    truth = f"{header}F_N: true force. I_A: true current plus the constant offset of the sensor\n"
    settled_note = "history: settled; one cycle of each loop after three of the same loop"
    demagnetised_note = "history: demagnetised"
    measured_records = bundled.measure("identification", other=Stepped(name))
    unseen_records = bundled.measure("unseen", other=Stepped(name))
    texts = {
        "loops": (header + settled_note, bundled.measured_rows(measured_records), "settled"),
        "unseen_truth": (truth + settled_note, bundled.true_rows(unseen_records, offset), "settled"),
        "moving_truth": (truth + demagnetised_note, rows([moving(name)], offset), "demagnetised"),
        "small_truth": (truth + demagnetised_note, rows(list(small_cycles(name)), offset), "demagnetised"),
    }
    file_texts = {}
    for file_stem, (note, data_rows, history) in texts.items():
        file_texts[f"{file_stem}.csv"] = bundled.csv_text(note, data_rows)
        file_texts[f"{file_stem}.toml"] = f'history = "{history}"\n'
    return file_texts


def main() -> None:
    parser = argparse.ArgumentParser(description="Simulate the bundled magnet of another iron.")
    parser.add_argument("name", choices=sorted(tables()), help="iron, by its name in irons.toml")
    parser.add_argument("--out", type=Path, required=True, help="folder to write to")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    for name, text in files(options.name).items():
        (options.out / name).write_bytes(text.encode())


if __name__ == "__main__":
    main()
