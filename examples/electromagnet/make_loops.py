"""Simulate the force-current loops of the electromagnet in ``magnet.toml``.

The iron is a stack of pinned cells (:class:`anhyst_rigs.rig.parts.iron.CellSteel`). Unlike a
Jiles-Atherton material, its minor loops do not drift: they close immediately.

``python make_loops.py [--out DIR]`` writes the files; the output is reproducible byte for byte.
"""

from __future__ import annotations

import argparse
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from scipy.optimize import brentq

from anhyst._core import Piece
from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0
from anhyst_rigs.rig.parts.iron import CellSteel

HERE = Path(__file__).resolve().parent


@dataclass(frozen=True)
class Circuit:
    """Winding, poles, two gaps in series; a leakage path between the legs, parallel to the gaps."""

    turns: int
    pole_width: float  # m
    pole_depth: float  # m
    leakage: float  # H

    @property
    def iron_area(self) -> float:
        """Cross-section of the core, m^2."""
        return self.pole_width * self.pole_depth

    def gap_area(self, gap: float) -> float:
        """Return the area of the gap flux, m^2; fringing adds half a gap to each side of a pole."""
        return (self.pole_width + gap) * (self.pole_depth + gap)

    def gap_reluctance(self, gap: float) -> float:
        """Return the reluctance of the two gaps in series, 1/H."""
        return 2 * gap / (MU_0 * self.gap_area(gap))

    def outer_reluctance(self, gap: float) -> float:
        """Return the reluctance outside the iron for its flux, leakage included, 1/H."""
        return 1 / (1 / self.gap_reluctance(gap) + self.leakage)

    def force(self, iron_flux: float, gap: float) -> float:
        """Return the force on the armature, N, for a flux in the iron, Wb.

        The Maxwell stress over the whole gap flux would be too large, because fringe flux
        contributes less. Virtual work, ``F = (Phi_gap**2/2) * dR_gap/dgap``, includes the fringes
        correctly.
        """
        gap_flux = iron_flux * self.outer_reluctance(gap) / self.gap_reluctance(gap)
        area = self.gap_area(gap)
        widening = self.pole_width + self.pole_depth + 2 * gap  # d(area)/d(gap)
        return gap_flux**2 / (MU_0 * area) * (1 - gap * widening / area)


class Steppable(Protocol):
    """Interface of a magnet whose loops can be recorded."""

    def step(self, current: float, gap: float) -> float:
        """Move to a current, A, at a gap, m, and return the force, N."""
        ...


class Magnet:
    """Iron and circuit with the hysteresis state of the iron; initially demagnetised."""

    def __init__(self, steel: CellSteel, path_length: float, circuit: Circuit) -> None:
        self.steel, self.iron = steel, Piece(steel.make_steel())
        self.length = path_length  # length of the flux path, m
        self.circuit = circuit

    @property
    def field(self) -> float:
        """Field of the iron, A/m."""
        return self.iron.field

    @property
    def flux_density(self) -> float:
        """Flux density of the iron, T."""
        return self.iron.flux_density(self.field)[0]

    def step(self, current: float, gap: float) -> float:
        """Move to a current, A, at a gap, m, and return the force, N.

        Exact for a step of any size if the current does not reverse within it.
        """
        outer_factor = self.circuit.iron_area * self.circuit.outer_reluctance(gap)

        def excess_ampere_turns(field: float) -> float:
            used_ampere_turns = self.length * field + outer_factor * self.iron.flux_density(field)[0]
            return self.circuit.turns * current - used_ampere_turns

        # B never decreases as H rises, so that this field is a bound: it brackets the root.
        bound = self.field + excess_ampere_turns(self.field) / self.length
        if bound != self.field:
            self.iron.commit(float(brentq(excess_ampere_turns, self.field, bound, xtol=1e-11)))
        return self.circuit.force(self.flux_density * self.circuit.iron_area, gap)


@dataclass(frozen=True)
class Record:
    """One steady-state loop: true values and sensor readings at the same samples."""

    label: str
    gap: float  # m
    time: FloatArray  # s, since the begin of the whole measurement
    current: FloatArray  # A, true
    force: FloatArray  # N, true
    read_current: FloatArray  # A, sensor reading with offset and noise
    read_force: FloatArray  # N, sensor reading with delay, drift and noise


def load(path: Path = HERE / "magnet.toml") -> tuple[Magnet, dict[str, Any]]:
    """Read the magnet file; return a demagnetised magnet and all settings."""
    settings = tomllib.loads(path.read_text(encoding="utf-8"))
    iron, circuit = settings["iron"], settings["circuit"]
    return Magnet(
        CellSteel(
            reversible_fraction=iron["reversible_fraction"],
            cells=iron["cells"],
            pinning_scale_A_per_m=iron["pinning_scale_A_per_m"],
            pinning_shape=iron["pinning_shape"],
            saturation_sharp_T=iron["saturation_sharp_T"],
            knee_sharp_A_per_m=iron["knee_sharp_A_per_m"],
            saturation_slow_T=iron["saturation_slow_T"],
            knee_slow_A_per_m=iron["knee_slow_A_per_m"],
        ),
        iron["length_m"],
        Circuit(
            turns=circuit["turns"],
            pole_width=circuit["pole_width_m"],
            pole_depth=circuit["pole_depth_m"],
            leakage=circuit["leakage_H"],
        ),
    ), settings


def settled_loop(
    magnet: Steppable, gap: float, low: float, high: float, settings: dict[str, Any]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Run the conditioning cycles, then one triangle from low to high and back.

    Returns
    -------
    current, force, late_force : ndarray, shape (n,)
        Current (A) and force (N) at the samples of the cycle (its end is its first sample), and the
        force one delay of the force channel earlier.
    """
    drive = settings["drive"]
    delay_samples = settings["sensors"]["force_delay_s"] / drive["sample_s"]
    half_count = round((high - low) / (drive["sweep_A_per_s"] * drive["sample_s"]))
    current = high - (high - low) * np.abs(np.arange(2 * half_count) / half_count - 1)
    for _ in range(drive["conditioning_cycles"]):
        magnet.step(low, gap)
        magnet.step(high, gap)
    force, late_force = [], []
    for previous_current, sample_current in zip(np.roll(current, 1), current, strict=True):
        late_force.append(
            magnet.step(sample_current + delay_samples * (previous_current - sample_current), gap)
        )
        force.append(magnet.step(sample_current, gap))
    return current, np.array(force), np.array(late_force)


def measure(section: str, path: Path = HERE / "magnet.toml", other: Steppable | None = None) -> list[Record]:
    """Record all loops of one part of the magnet file, ``identification`` or ``unseen``.

    The magnet is that of the file, or another one with the drive and the sensors of the file.
    """
    file_magnet, settings = load(path)
    magnet = other or file_magnet
    drive, sensors = settings["drive"], settings["sensors"]
    rng = np.random.default_rng([sensors["seed"], *section.encode()])
    records = []
    clock = 0.0
    for gap in settings[section]["gaps_m"]:
        tared = clock
        for loop in settings[section]["loops"]:
            low, high = (loop[end] * drive["current_max_A"] for end in ("low", "high"))
            current, force, late_force = settled_loop(magnet, gap, low, high, settings)
            cycle = current.size * drive["sample_s"]
            clock += drive["conditioning_cycles"] * cycle
            time = clock + drive["sample_s"] * np.arange(current.size)
            clock += cycle
            current_noise, force_noise = rng.standard_normal((2, current.size))
            current_error = sensors["current_offset_A"] + sensors["current_noise_A"] * current_noise
            drift = sensors["force_drift_N_per_s"] * (time - tared)
            records.append(
                Record(
                    label=f"{gap * 1e3:.2f}mm-{loop['name']}",
                    gap=gap,
                    time=time,
                    current=current,
                    force=force,
                    read_current=current + current_error,
                    read_force=late_force + drift + sensors["force_noise_N"] * force_noise,
                )
            )
        clock += drive["pause_s"]
    return records


def csv_text(notes: str, rows: Iterable[str]) -> str:
    """Return the text of a file: notes as comments, the header, the rows."""
    comments = [f"# {note}" for note in notes.splitlines()]
    return "\n".join([*comments, "t_s,I_A,F_N,gap_m,loop", *rows, ""])


def measured_rows(records: list[Record]) -> Iterable[str]:
    """Yield the rows with sensor readings, in the resolution of their converters."""
    for r in records:
        for time, current, force in zip(r.time, r.read_current, r.read_force, strict=True):
            yield f"{time:.2f},{current:.4f},{force:.3f},{r.gap:.5f},{r.label}"


def true_rows(records: list[Record], offset: float) -> Iterable[str]:
    """Yield noise-free rows that include the current sensor's offset, as a model does."""
    for r in records:
        for time, current, force in zip(r.time, r.current + offset, r.force, strict=True):
            yield f"{time:.2f},{current:.6f},{force:.6f},{r.gap:.5f},{r.label}"


MEASURED = """\
simulated, see README.md: two-pole electromagnet, iron of pinned cells (not Jiles-Atherton)
history: settled; one cycle of each loop, recorded after three conditioning cycles of the same loop
as read: current offset and noise; force late, drifting since the tare at each gap, and noisy"""
TRUTH = """\
simulated, see README.md: the truth behind unseen.csv, same samples
history: settled
F_N: true force. I_A: true current plus the constant offset of the current sensor, no noise"""


def files(path: Path = HERE / "magnet.toml") -> dict[str, str]:
    """Return the text of every file of the example, by name."""
    offset = load(path)[1]["sensors"]["current_offset_A"]
    unseen_records = measure("unseen", path)
    texts = {
        "loops.csv": csv_text(MEASURED, measured_rows(measure("identification", path))),
        "unseen.csv": csv_text(MEASURED, measured_rows(unseen_records)),
        "unseen_truth.csv": csv_text(TRUTH, true_rows(unseen_records, offset)),
    }
    sidecars = {name.replace(".csv", ".toml"): 'history = "settled"\n' for name in texts}
    return texts | sidecars


def main() -> None:
    parser = argparse.ArgumentParser(description="Simulate the loops of the bundled example.")
    parser.add_argument("--out", type=Path, default=HERE, help="folder to write to")
    folder = parser.parse_args().out
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in files().items():
        (folder / name).write_bytes(text.encode())


if __name__ == "__main__":
    main()
