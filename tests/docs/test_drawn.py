"""Test the physics of the random irons in the benchmark of the search."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.parts.iron import CellSteel
from anhyst_rigs.rig.parts.magnet import Poles

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"
STEEL = CellSteel(
    cells=20,
    reversible_fraction=0.1,
    pinning_scale_A_per_m=90.0,
    pinning_shape=2.0,
    saturation_sharp_T=1.2,
    knee_sharp_A_per_m=150.0,
    saturation_slow_T=0.5,
    knee_slow_A_per_m=3000.0,
)
POLES = Poles(200.0, 1.0, 0.02, 0.02, 0.0, 0.2, 2e-5)


@pytest.fixture(scope="module")
def irons() -> Iterator[ModuleType]:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(BENCHMARKS))
        import drawn_irons

        yield drawn_irons


def iron(irons: ModuleType, kind: str) -> object:
    """Return an iron whose law is integrated numerically."""
    return {
        "tellinen": irons.TellinenIron(80.0, 1.2, 150.0, 0.5, 3000.0),
        "langevin": irons.LangevinIron(0.8, 120.0, 0.6, 400.0, 8.0, 30.0),
    }[kind]


def path() -> tuple[FloatArray, FloatArray]:
    """Return a current (A) with reversals at various levels, and a gap (m) that varies with it."""
    ends = [0.0, 5.0, -2.0, 3.0, 1.0, 4.0]
    current = np.interp(np.linspace(0.0, len(ends) - 1.0, 150), np.arange(len(ends)), ends)
    return current, 5e-4 + 2e-4 * np.sin(0.05 * np.arange(current.size))


def test_two_pieces_of_one_iron_in_series_are_that_iron(irons: ModuleType) -> None:
    core, steel = irons.Core(POLES), STEEL.make_steel()
    single_response = irons.PlantIron(steel).compute_response(core, *path())
    series_response = irons.SeriesIron(steel, steel, 0.3, 1.0).compute_response(core, *path())
    assert np.max(np.abs(series_response.flux - single_response.flux)) < 1e-6 * np.max(single_response.flux)
    assert np.max(np.abs(series_response.linkage - single_response.linkage)) < 1e-6 * np.max(
        single_response.linkage
    )


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["tellinen", "langevin"])
def test_irons_that_are_integrated_do_not_depend_on_the_steps(
    irons: ModuleType, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    job = irons.Job(iron(irons, kind), irons.Core(POLES), *path())
    found = []
    for steps in (irons.RANGE_STEPS, 2 * irons.RANGE_STEPS):
        monkeypatch.setattr(irons, "RANGE_STEPS", steps)
        found.append(irons.compute_responses([job])[0].linkage)
    assert np.max(np.abs(found[1] - found[0])) < 2e-5 * np.max(found[1])


@pytest.mark.parametrize("kind", ["tellinen", "langevin"])
def test_a_cycle_of_an_integrated_iron_loses_energy(
    irons: ModuleType, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(irons, "RANGE_STEPS", 300)
    rising_current = np.linspace(1.0, 3.0, 100)
    cycle = np.concatenate([rising_current, rising_current[::-1]])
    current = np.tile(cycle, 4)
    job = irons.Job(iron(irons, kind), irons.Core(POLES), current, np.full(current.size, 3e-4))
    linkage = irons.compute_responses([job])[0].linkage[-cycle.size - 1 :]
    current = current[-cycle.size - 1 :]
    absorbed_energy = float(np.sum(0.5 * (current[1:] + current[:-1]) * np.diff(linkage)))
    assert absorbed_energy > 1e-4 * np.ptp(linkage) * np.ptp(current)
