"""Control the force of drawn electromagnets whose models come from the coil's voltage alone.

    python benchmarks/flux_control.py 0 12 2      # even seeds below 12: may be inspected

Each rig is measured by ``excite --voltage``; the compiled controller is judged by the true force. For
comparison, the same rig is measured by ``excite`` with a force sensor. The irons are those of
``examples/irons``, which are not laws of the package. Every third rig has a sense coil, and every
fourth has a source without negative currents, so that the remanence is unknown.
"""

from __future__ import annotations

import math
import os
import sys
import tempfile
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from anhyst.support.errors import InputError
from anhyst.support.toml_text import toml_value
from anhyst.support.units import MU_0
from anhyst_rigs.rig.force.file import read_rig
from anhyst_rigs.study.excite.excite import excite
from anhyst_rigs.study.excite.voltage import measure_voltage
from anhyst_rigs.study.force_control import force_control
from rows import ROOT, Row, Stopwatch
from virtual import FILE

TEMPLATE = ROOT / "packages" / "anhyst-rigs" / "tests" / "study" / "electromagnet.toml"
RIG_COUNT = 6
"""Number of rigs of each half in the table of all benchmarks."""
HELD_TARGET, MOVING_TARGET = 1.5, 3.0
"""Targets of the worst error with the armature held and moving, % of F_max."""
DEMAND_SHARE = 0.9
"""Largest demand, relative to the force at the largest gap."""


class Outcome(NamedTuple):
    """Worst errors, % of F_max, with the armature held and moving."""

    held: float
    moving: float


def draw_rig(seed: int, path: Path) -> str:
    """Write the rig file of a drawn electromagnet, and return its description."""
    rng = np.random.default_rng([20261136, seed])

    def log(low: float, high: float) -> float:
        return float(low * (high / low) ** rng.random())

    rig = tomllib.loads(TEMPLATE.read_text(encoding="utf-8"))
    irons = tomllib.loads(FILE.read_text(encoding="utf-8"))
    iron_name = sorted(irons)[int(rng.integers(len(irons)))]
    side, low = log(0.01, 0.03), log(0.15e-3, 0.35e-3)
    gaps = [round(low * ratio, 5) for ratio in np.geomspace(1.0, rng.uniform(1.7, 2.3), 4).tolist()]
    iron_length = float(rng.uniform(8.0, 12.0)) * side
    drive = rng.uniform(1.1, 1.6) * (2.0 * low * 1.4 / MU_0 + 1000.0 * iron_length)
    current = log(1.5, 10.0)
    turns = round(drive / current)
    resistance = float(f"{log(6.0, 16.0) / current:.3g}")
    permeance = MU_0 * side * side / (2.0 * low)
    has_sense_coil, is_unipolar = seed % 3 == 2, seed % 4 == 3
    rig["iron"] = [{"name": "core", **irons[iron_name]}]
    rig["magnet"] = [{
        "name": "magnet", "iron": "core", "turns": turns, "resistance_ohm": resistance, "pole_width_m": side,
        "pole_depth_m": side, "leakage_H": log(0.03, 0.3) * permeance, "iron_length_m": iron_length,
    }]  # fmt: skip
    rig["amplifier"][0] |= {"current_high_A": current, "slew_A_per_s": 75.0 * current}
    gap, shunt, force, voltage = rig["sensor"]
    gap["high_m"] = 2.0 * gaps[-1]
    shunt |= {"low_A": -1.1 * current, "high_A": 1.1 * current, "noise_A": 1.2e-4 * current}
    largest_voltage = (0.1 if has_sense_coil else 2.5) * resistance * current
    voltage |= {
        "range_V": largest_voltage,
        "noise_V": 3e-4 * largest_voltage,
        "offset_V": 2e-4 * largest_voltage,
    }
    if has_sense_coil:
        voltage["turns"] = max(round(0.04 * turns), 1)
    rig["excite"] = {"gaps_m": gaps, "continuous_A": 0.4 * current, "thermal_s": log(30.0, 120.0)}
    if not is_unipolar:
        rig["excite"]["current_low_A"] = -current
    held, moving = rig["case"][3], rig["case"][2]
    held["gaps_m"] = [gaps[0], *(low + (gaps[-1] - low) * np.array([0.2, 0.5, 0.85])).tolist()]
    moving |= {"low_m": 1.1 * low, "high_m": 0.95 * gaps[-1]}
    rig["control"] |= {"force_max_N": 1.0, "end_m": gaps[0]}
    path.write_text(rig_text(rig), encoding="utf-8")
    magnet = read_rig(path).magnet()
    forces = [magnet.hold(current, gap) for gap in (gaps[-1], gaps[0])]
    rig["control"]["force_max_N"] = float(f"{DEMAND_SHARE * forces[0]:.2g}")
    force |= {"low_N": -0.2 * forces[1], "high_N": 1.6 * forces[1], "noise_N": 5e-4 * forces[1]}
    path.write_text(rig_text(rig), encoding="utf-8")
    coil = "sense coil" if has_sense_coil else "coil"
    return f"{iron_name}, {coil}, {'unknown zero' if is_unipolar else 'demagnetised'}"


def rig_text(rig: dict[str, object]) -> str:
    """Return the text of a rig file with tables and lists of tables."""
    lines = []
    for key, value in rig.items():
        if isinstance(value, dict):
            lines += ["", f"[{key}]", *(f"{name} = {toml_value(item)}" for name, item in value.items())]
        elif isinstance(value, list):
            for table in value:
                lines += ["", f"[[{key}]]", *(f"{name} = {toml_value(item)}" for name, item in table.items())]
        else:
            lines.insert(0, f"{key} = {toml_value(value)}")
    return "\n".join(lines) + "\n"


def control(rig: Path, *, with_voltage: bool) -> Outcome:
    """Measure a rig, identify and compile, and return the errors of the true force."""
    excite(rig, rig.parent / "coil.csv", measure=measure_voltage if with_voltage else None)
    summary = force_control(rig, rig.parent / f"run-{with_voltage}").figures["summary"]
    held = max(summary[stage]["full"]["worst_percent"] for stage in ("end", "end_demagnetised", "positions"))
    return Outcome(held, summary["moving"]["full"]["worst_percent"])


def measure(seed: int) -> tuple[str, list[Outcome]]:
    """Return the description of a rig, and its errors with the voltage and with the force sensor."""
    outcomes = []
    with tempfile.TemporaryDirectory(prefix="anhyst-flux-") as folder:
        rig = Path(folder) / "rig.toml"
        text = draw_rig(seed, rig)
        for with_voltage in (True, False):
            try:
                outcomes.append(control(rig, with_voltage=with_voltage))
            except InputError as error:
                text += f"; {'voltage' if with_voltage else 'force'} refused: {error}"
                outcomes.append(Outcome(math.nan, math.nan))
    return text, outcomes


def rows() -> list[Row]:
    """Return a row for each half."""
    result_rows = []
    watch = Stopwatch()
    for half, name in enumerate(("even seeds", "odd seeds")):
        outcomes = np.array([measure(seed)[1] for seed in range(half, 2 * RIG_COUNT, 2)])
        (held, moving), (force_held, force_moving) = np.nanmax(outcomes, axis=0)
        refused = int(np.isnan(outcomes[:, 0, 0]).sum())
        result_rows.append(
            Row(
                f"force control from voltage alone, {RIG_COUNT} rigs, {name}: worst error, held / moving",
                f"<= {HELD_TARGET:g} / {MOVING_TARGET:g} % of F_max",
                f"{held:.2f} / {moving:.2f} %, {refused} refused; with a force sensor {force_held:.2f} / "
                f"{force_moving:.2f} %",
                held <= HELD_TARGET and moving <= MOVING_TARGET,
            )
        )
    time = Row(
        "force control from voltage alone: computing time", "minutes", str(watch), None, watch.processor
    )
    return [*result_rows, time]


def main(numbers: Sequence[int]) -> None:
    """Print the errors of each rig."""
    for seed in range(*numbers):
        text, outcomes = measure(seed)
        errors = ", ".join(
            f"{name} {outcome.held:.2f}/{outcome.moving:.2f} %"
            for name, outcome in zip(("voltage", "force sensor"), outcomes, strict=True)
        )
        print(f"{seed} {text}: {errors}", flush=True)


if __name__ == "__main__":
    main([int(number) for number in sys.argv[1:4]])
