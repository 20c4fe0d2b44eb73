"""Three electromagnets whose force depends on the gap: an iron of Preisach, one of Tellinen, two irons.

The magnetic circuits are solved sample by sample. The force is the derivative of the energy of the
air over the gap at constant fluxes, see ``flux_circuit.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from anhyst.support.units import MU_0
from flux_circuit import Branch, Magnet, flat_pole, leakage_path, roters_pole
from flux_irons import Saturation, TellinenIron

from ...records import FloatArray
from .drives import Drive, System, make_ramps
from .preisach import RelayIron

SAMPLES_PER_UNIT = 60
NOISE_PER_FORCE = 1e-3

UNIPOLAR_TRAINING = (0.0, 1.0, 0.0, 0.7, 0.25, 1.0, 0.5, 0.8, 0.0, 0.4, 0.0)
"""Reversal points of a training cycle, relative to the largest current."""
BIPOLAR_TRAINING = (0.0, 1.0, -1.0, 0.7, -0.45, 0.3, -0.15, 0.0)


def make_preisach_magnet() -> Magnet:
    """Return a two-pole magnet of unannealed steel with relays."""
    side = 0.022
    reversible = Saturation(0.55, 900.0, 5000.0, 0.5)
    return Magnet(
        family="preisach",
        seed=0,
        current_max=3.0,
        gap_range=(0.25e-3, 1.4e-3),
        turns=420,
        make_yoke=lambda: RelayIron(1.35, 260.0, 130.0, reversible),
        yoke_length=0.19,
        yoke_area=1.05 * side**2,
        branches=(Branch(roters_pole(side, 0.006, 2), 2e-5 / (MU_0 * side**2)),),
        leakage=leakage_path(6e-8, 0.0, 1.0),
        pole_area=side**2,
        gap_count=2,
    )


def make_tellinen_magnet() -> Magnet:
    """Return a magnet with one flat pole and an iron of Tellinen."""
    side = 0.015
    saturation = Saturation(1.75, 150.0, 2800.0, 0.22)
    return Magnet(
        family="tellinen",
        seed=0,
        current_max=2.4,
        gap_range=(0.15e-3, 0.6e-3),
        turns=150,
        make_yoke=lambda: TellinenIron(saturation, 190.0),
        yoke_length=0.1,
        yoke_area=1.1 * side**2,
        branches=(Branch(flat_pole(side, 1), 1e-5 / (MU_0 * side**2)),),
        leakage=leakage_path(4e-8, 0.0, 1.0),
        pole_area=side**2,
        gap_count=1,
    )


def make_two_iron_magnet() -> Magnet:
    """Return a magnet with a hard yoke, a soft thin armature, and leakage that depends on the gap."""
    side = 0.018
    yoke, armature = Saturation(1.8, 300.0, 3500.0, 0.25), Saturation(1.5, 60.0, 1500.0, 0.15)
    branch = Branch(
        roters_pole(side, 0.005, 2),
        1.5e-5 / (MU_0 * side**2),
        lambda: TellinenIron(armature, 70.0),
        length=0.055,
        area=0.78 * side**2,
    )
    return Magnet(
        family="two-irons",
        seed=0,
        current_max=3.2,
        gap_range=(0.2e-3, 1.6e-3),
        turns=260,
        make_yoke=lambda: TellinenIron(yoke, 240.0),
        yoke_length=0.14,
        yoke_area=0.9 * side**2,
        branches=(branch,),
        leakage=leakage_path(1.1e-7, 0.4, 0.6e-3),
        pole_area=side**2,
        gap_count=2,
    )


def _make_system(
    magnet: Magnet, drives: Mapping[str, Drive], gaps: Sequence[float], path: Sequence[float], seed: int
) -> System:
    """Return a magnet with a training cycle at each of its gaps and the given test drives."""
    training = {f"gap-{number}": _drive_at(magnet, gap, path) for number, gap in enumerate(gaps, 1)}

    def respond(drive: Drive) -> FloatArray:
        assert drive.schedule is not None
        return magnet.run(drive.input, drive.schedule)[1]

    largest = float(np.max(respond(training["gap-1"])))
    return System(respond, training | dict(drives), NOISE_PER_FORCE * largest, seed)


def _drive_at(magnet: Magnet, gap: float, points: Sequence[float]) -> Drive:
    current = magnet.current_max * make_ramps(points, SAMPLES_PER_UNIT)
    return Drive(current, np.full(current.size, gap))


def _drive_moving(magnet: Magnet, points: Sequence[float], turns: tuple[int, int]) -> Drive:
    """Return a closed cycle whose gap moves over the range of the gaps, with two frequencies."""
    current = magnet.current_max * make_ramps(points, SAMPLES_PER_UNIT)
    phase = 2.0 * np.pi * np.arange(current.size) / current.size
    place = 0.5 + 0.3 * np.sin(turns[0] * phase) + 0.18 * np.sin(turns[1] * phase + 1.0)
    smallest, largest = magnet.gap_range
    return Drive(current, smallest * (largest / smallest) ** place)


def make_preisach_system() -> System:
    """Return the bipolar magnet with an iron of Preisach."""
    magnet, rng = make_preisach_magnet(), np.random.default_rng(551)
    reversals = rng.uniform(-1.0, 1.0, (3, 9)).tolist()
    drives = {
        "other-gap": _drive_at(magnet, 0.6e-3, [0.0, 1.0, -1.0, *reversals[0], 0.0]),
        "inner-cycles": _drive_at(
            magnet, 0.45e-3, [0.0, 1.0, *[0.35, 0.65] * 2, -1.0, *[-0.2, -0.5] * 2, *reversals[1][:4], 0.0]
        ),
        "from-rest": _drive_at(magnet, 0.8e-3, [0.0, 0.35, -0.25, 0.7, 0.1, 0.9, -0.6]),
        "moving-gap": _drive_moving(magnet, [0.0, 1.0, -1.0, *reversals[2], 0.0], (2, 5)),
    }
    return _make_system(magnet, drives, (0.25e-3, 0.45e-3, 0.8e-3, 1.4e-3), BIPOLAR_TRAINING, 552)


def make_tellinen_system() -> System:
    """Return the unipolar magnet with an iron of Tellinen."""
    magnet = make_tellinen_magnet()
    inner_corners = [*[0.45, 0.65] * 4, 0.0, *[0.5, 0.3] * 4, 0.85, 0.75]
    drives = _make_unipolar_tests(magnet, 561, (0.42e-3, 0.15e-3, 0.3e-3), inner_corners, (3, 7))
    return _make_system(magnet, drives, (0.15e-3, 0.3e-3, 0.6e-3), UNIPOLAR_TRAINING, 562)


def make_two_iron_system() -> System:
    """Return the magnet with two irons in series."""
    magnet = make_two_iron_magnet()
    inner_corners = [*[0.4, 0.6] * 4, 0.0, *[0.35, 0.2] * 4, 0.9, 0.7]
    drives = _make_unipolar_tests(magnet, 571, (0.57e-3, 0.2e-3, 0.4e-3), inner_corners, (2, 5))
    return _make_system(magnet, drives, (0.2e-3, 0.4e-3, 0.8e-3, 1.6e-3), UNIPOLAR_TRAINING, 572)


def _make_unipolar_tests(
    magnet: Magnet,
    seed: int,
    gaps: tuple[float, float, float],
    inner_corners: list[float],
    turns: tuple[int, int],
) -> dict[str, Drive]:
    """Return the test drives: another gap, random reversals, inner cycles and a moving gap."""
    reversals = np.random.default_rng(seed).uniform(0.0, 1.0, (3, 14)).tolist()
    other_gap, random_gap, inner_gap = gaps
    return {
        "other-gap": _drive_at(magnet, other_gap, [0.0, 1.0, 0.0, *reversals[0], 0.0]),
        "random-reversals": _drive_at(magnet, random_gap, [0.0, 1.0, 0.0, *reversals[1], 0.0]),
        "inner-cycles": _drive_at(magnet, inner_gap, [0.0, 1.0, *inner_corners, 0.0]),
        "moving-gap": _drive_moving(magnet, [0.0, 1.0, 0.0, *reversals[2], 0.0], turns),
    }
