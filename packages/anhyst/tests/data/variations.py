"""Create random measurement files as users export them, with the true loops of each.

A variation combines a way to write a table (separator, decimal sign, encoding, header style), a
language, units, a layout of the air gaps and one fault of a real test bench. The truth is in SI
units, so a reader can be tested without knowledge of the file's layout.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

GAPS_MM = (0.5, 0.8, 1.2, 1.8)
SAMPLES_PER_GAP = 480
SAMPLES_PER_CYCLE = 239

WORDS = {
    "en": ("Time", "Current", "Force", "Gap"),
    "de": ("Zeit", "Strom", "Kraft", "Luftspalt"),
    "fr": ("Temps", "Courant", "Force", "Entrefer"),
    "nl": ("Tijd", "Stroom", "Kracht", "Luchtspleet"),
    "it": ("Tempo", "Corrente", "Forza", "Traferro"),
    "es": ("Tiempo", "Corriente", "Fuerza", "Entrehierro"),
}
"""Words for time, current, force and air gap."""

UNITS: dict[str, dict[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "seconds": 1.0},
    "current": {"A": 1.0, "mA": 1e-3, "ampere": 1.0, "Amps": 1.0},
    "force": {
        "N": 1.0, "kN": 1e3, "mN": 1e-3, "daN": 10.0, "kgf": 9.80665, "kp": 9.80665,
        "lbf": 4.4482216152605, "gf": 9.80665e-3, "ozf": 0.27801385, "newton": 1.0,
    },
    "gap": {"mm": 1e-3, "um": 1e-6, "µm": 1e-6, "micron": 1e-6, "inch": 0.0254, "mil": 2.54e-5},
}  # fmt: skip
"""SI value of each unit that headers carry, by quantity."""

QUANTITIES = ("time", "current", "force", "gap")


@dataclass(frozen=True)
class Trouble:
    """A fault of a test bench, and the word that `inspect` must report for it."""

    name: str
    word: str = ""


TROUBLES = (
    Trouble("none"),
    Trouble("none"),
    Trouble("extra columns"),
    Trouble("delay", "lags"),
    Trouble("hole", "missing"),
    Trouble("invalid", ""),
)


@dataclass(frozen=True)
class Variation:
    """Settings of one random measurement."""

    seed: int
    language: str
    units: tuple[str, str, str, str]
    header: str
    separator: str
    decimal: str
    encoding: str
    newline: str
    preamble: str
    gaps: str
    trouble: Trouble
    order: tuple[int, ...]
    sampling_rate: float
    delay_cycles: float


@dataclass
class Truth:
    """Loops of a measurement, current in A and force in N, by the gap in mm."""

    current: dict[float, Array] = field(default_factory=dict)
    force: dict[float, Array] = field(default_factory=dict)


def draw(seed: int) -> Variation:
    """Return random settings of one measurement; equal seeds give equal settings."""
    rng = np.random.default_rng([47, seed])

    def pick(choices: Any) -> Any:
        return choices[int(rng.integers(len(choices)))]

    separator = pick([",", ";", "\t", ";", "\t"])
    columns = rng.permutation(4)
    return Variation(
        seed=seed,
        language=pick(list(WORDS)),
        units=tuple(pick(list(UNITS[name])) for name in QUANTITIES),
        header=pick(["brackets", "parentheses", "units row", "slash", "underscore"]),
        separator=separator,
        decimal="." if separator == "," else pick([".", ","]),
        encoding=pick(["utf-8", "utf-8-sig", "utf-16", "latin-1"]),
        newline=pick(["\n", "\r\n"]),
        preamble=pick(["none", "none", "hash", "settings"]),
        gaps=pick(["column", "noisy column", "file names"]),
        trouble=pick(TROUBLES),
        order=tuple(int(column) for column in columns),
        sampling_rate=pick([200.0, 1000.0, 5000.0]),
        delay_cycles=pick([0.02, 0.04]),
    )


def measure(variation: Variation) -> tuple[dict[str, Array], Truth]:
    """Simulate play operators behind an air gap; return the columns as recorded, and the truth."""
    rng = np.random.default_rng([48, variation.seed])
    truth, parts = Truth(), []
    n = SAMPLES_PER_GAP
    sweep = np.r_[np.linspace(0, 1, n // 4), np.linspace(1, 0, n // 4)[1:]]
    sweep = np.r_[sweep, 0.6 * sweep, sweep][:n]
    for gap_mm in GAPS_MM:
        current = 3.0 * sweep
        force = 12.0 * (_play(current, 0.05) + _play(current, 0.2)) ** 2 / (gap_mm + 0.3) ** 2
        force = force + rng.normal(0.0, 0.02, current.size)
        parts.append((current, force, np.full(current.size, gap_mm * 1e-3)))
    current, force, gap = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    if variation.trouble.name == "delay":
        delayed = round(variation.delay_cycles * SAMPLES_PER_CYCLE)
        force = np.r_[np.full(delayed, force[0]), force][: force.size]
    time = 12.5 + np.arange(current.size) / variation.sampling_rate
    if variation.trouble.name == "hole":
        time[current.size // 2 + 40 :] += 150.0 / variation.sampling_rate
    noisy = gap + rng.normal(0.0, 1.5e-6, gap.size) if variation.gaps == "noisy column" else gap
    for gap_mm in GAPS_MM:
        rows = gap == gap_mm * 1e-3
        truth.current[gap_mm], truth.force[gap_mm] = current[rows], force[rows]
    return {"time": time, "current": current, "force": force, "gap": noisy}, truth


def _play(drive: Array, threshold: float) -> Array:
    state, states = 0.0, np.empty_like(drive)
    for index, value in enumerate(drive):
        state = max(value - threshold, min(value + threshold, state))
        states[index] = state
    return states


def write(variation: Variation, folder: Path) -> tuple[Path, Truth]:
    """Write the measurement of a variation; return the file or folder to read, and the truth."""
    columns, truth = measure(variation)
    folder.mkdir(parents=True, exist_ok=True)
    if variation.gaps != "file names":
        path = folder / "record.csv"
        _write_table(variation, columns, path)
        return path, truth
    pattern = ("Messung_Spalt_{}mm.csv", "gap_{}_mm.csv", "run3 gap={}mm.csv")[variation.seed % 3]
    for number, gap_mm in enumerate(GAPS_MM):
        rows = slice(number * SAMPLES_PER_GAP, (number + 1) * SAMPLES_PER_GAP)
        part = {name: values[rows] for name, values in columns.items() if name != "gap"}
        text = f"{gap_mm}".replace(".", variation.decimal if variation.seed % 2 else ".")
        _write_table(variation, part, folder / pattern.format(text))
    return folder, truth


def _write_table(variation: Variation, columns: dict[str, Array], path: Path) -> None:
    names = [QUANTITIES[column] for column in variation.order if QUANTITIES[column] in columns]
    words = dict(zip(QUANTITIES, WORDS[variation.language], strict=True))
    units = dict(zip(QUANTITIES, variation.units, strict=True))
    if variation.header == "underscore":
        words = dict(zip(QUANTITIES, ("t", "I", "F", "gap"), strict=True))
    if variation.encoding == "latin-1" and units["gap"] == "µm":
        units["gap"] = "um"
    headers, unit_row = [], []
    for name in names:
        headers.append(_header(variation.header, words[name], units[name]))
        unit_row.append(units[name])
    body = [
        [_number(variation, name, units[name], row, value) for row, value in enumerate(columns[name])]
        for name in names
    ]
    if variation.trouble.name == "extra columns":
        headers = ["No.", *headers, "Status"]
        unit_row = ["", *unit_row, ""]
        body = [
            [str(row + 1) for row in range(len(body[0]))], *body, ["ok"] * len(body[0])
        ]  # fmt: skip
    lines = _preamble(variation)
    lines.append(variation.separator.join(headers))
    if variation.header == "units row":
        lines.append(variation.separator.join(unit_row))
    lines += [variation.separator.join(fields) for fields in zip(*body, strict=True)]
    text = variation.newline.join(lines) + variation.newline
    path.write_bytes(text.encode(variation.encoding))


def _header(style: str, word: str, unit: str) -> str:
    forms: dict[str, Callable[[], str]] = {
        "brackets": lambda: f"{word} [{unit}]",
        "parentheses": lambda: f"{word} ({unit})",
        "units row": lambda: word,
        "slash": lambda: f"{word} / {unit}",
        "underscore": lambda: f"{word}_{unit}",
    }
    return forms[style]()


def _number(variation: Variation, name: str, unit: str, row: int, value: float) -> str:
    if variation.trouble.name == "invalid" and name == "force" and row % 97 == 31:
        return ("NaN", "OL", "")[variation.seed % 3]
    return f"{value / UNITS[name][unit]:.9g}".replace(".", variation.decimal)


def _preamble(variation: Variation) -> list[str]:
    if variation.preamble == "hash":
        return ["# bench 3, operator M", f"# rate {variation.sampling_rate:g} Hz"]
    if variation.preamble == "settings":
        sign = variation.separator
        return [f"Device{sign}DAQ 12", f"Date{sign}28.11.2026", ""]
    return []
