"""Simulate field-strain loops of a magnetostrictive rod under three prestresses.

``python make_loops.py --out DIR`` writes ``loops.csv`` with sensor readings, and ``unseen.csv`` for
another prestress without noise. The output is reproducible byte for byte.

The rod is a Preisach iron (``anhyst_rigs.rig.parts.iron``), which is not a law of the package. A
larger prestress increases the fields at which its relays switch. Its strain is an even function of
the polarisation J, but not a pure square: ``lambda_s*(s + tip*s**2)`` with ``s = (J/J_s)**2``. A
magnet provides a bias field, and the field of the coil is relative to it.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from anhyst._core import Piece
from anhyst.support.units import MU_0
from anhyst_rigs.rig.parts.iron import PreisachSteel

Array = NDArray[np.float64]

HERE = Path(__file__).resolve().parent
SEED = 20261124
PRESTRESSES = (6.0, 12.0, 18.0)
"""Prestresses, MPa."""
UNSEEN_PRESTRESS = 9.0
BIAS_FIELD = 30e3
"""Bias field of the magnet, A/m."""
AMPLITUDES = (28e3, 20e3, 12e3, 6e3)
"""Amplitudes of the coil's field, A/m."""
SAMPLES_PER_CYCLE = 200
"""Samples per cycle."""
SATURATION_T, LAMBDA, TIP = 1.0, 1.2e-3, -0.12
NOISE_RMS, RESOLUTION = 1e-6, 0.5e-6


def make_rod(prestress: float) -> PreisachSteel:
    """Return the rod under a prestress, MPa."""
    stress_factor = 1.0 + prestress / 12.0
    return PreisachSteel(
        family="preisach",
        saturation_T=0.85 * SATURATION_T,
        pinning_A_per_m=2.2e3 * stress_factor**0.3,
        pinning_spread=0.45,
        bias_A_per_m=14e3 * stress_factor,
        bias_by_pinning=0.6,
        feedback_A_per_m_T=2e3,
        saturation_sharp_T=0.05 * SATURATION_T,
        knee_sharp_A_per_m=12e3 * stress_factor,
        saturation_slow_T=0.10 * SATURATION_T,
        knee_slow_A_per_m=60e3,
    )


def strain(prestress: float, field: Array) -> Array:
    """Return the strain for a field of the coil, A/m, starting from the demagnetised rod."""
    total_field = BIAS_FIELD + field
    initial_ramp = np.linspace(0.0, total_field[0], 400)
    density = Piece(make_rod(prestress).make_steel()).run(np.concatenate([initial_ramp, total_field]))[
        initial_ramp.size :, 1
    ]
    s = ((density - MU_0 * total_field) / SATURATION_T) ** 2
    return LAMBDA * (s + TIP * s**2)


def field_cycles(amplitude: float) -> Array:
    """Return three cycles of the coil's field, A/m, from zero; the loop closes in the first."""
    phase = 2.0 * np.pi * np.arange(3 * SAMPLES_PER_CYCLE + 1) / SAMPLES_PER_CYCLE
    return amplitude * np.sin(phase)


def write_loops(path: Path, prestresses: tuple[float, ...], noise: float) -> None:
    """Write steady-state loops (the last of three cycles), the largest first."""
    generator = np.random.default_rng(SEED)
    rows = []
    for prestress in prestresses:
        field = np.concatenate([field_cycles(amplitude) for amplitude in AMPLITUDES])
        strains = strain(prestress, field)
        for index, amplitude in enumerate(AMPLITUDES):
            last_cycle = slice(
                (3 * SAMPLES_PER_CYCLE + 1) * index + 2 * SAMPLES_PER_CYCLE,
                (3 * SAMPLES_PER_CYCLE + 1) * (index + 1),
            )
            readings = strains[last_cycle] + noise * generator.standard_normal(SAMPLES_PER_CYCLE + 1)
            readings = np.round(readings / RESOLUTION) * RESOLUTION if noise else readings
            rows += [
                (f"{amplitude / 1e3:g}", prestress, field_sample / 1e3, 1e6 * reading)
                for field_sample, reading in zip(field[last_cycle].tolist(), readings.tolist(), strict=True)
            ]
    lines = ["loop,sigma_MPa,H_kA_per_m,eps_ppm"]
    lines += [
        f"{label},{prestress:g},{field_sample:.5f},{reading:.3f}"
        for label, prestress, field_sample, reading in rows
    ]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def main() -> None:
    """Write both files."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=HERE)
    folder = parser.parse_args().out
    write_loops(folder / "loops.csv", PRESTRESSES, NOISE_RMS)
    write_loops(folder / "unseen.csv", (UNSEEN_PRESTRESS,), 0.0)


if __name__ == "__main__":
    main()
