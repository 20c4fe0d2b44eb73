"""Selection of the samples of a record for a search."""

from __future__ import annotations

import numpy as np

from anhyst.data.path import thin_rows


def test_thinned_keeps_the_samples_of_a_steep_part() -> None:
    drive = np.concatenate([np.linspace(-1000.0, -50.0, 20), np.linspace(-49.0, 49.0, 99)])
    drive = np.concatenate([drive, np.linspace(50.0, 1000.0, 20)])
    output = np.tanh(drive / 10.0)
    spread, kept = thin_rows(drive, 40), thin_rows(drive, 40, output)
    steps = np.abs(np.diff(output[spread]))
    assert steps.max() > 0.5
    assert np.abs(np.diff(output[kept])).max() < 0.2
    assert set(spread) <= set(kept)
    assert kept.size <= 2 * spread.size


def test_thinned_spreads_over_the_drive_alone_if_nothing_is_steep() -> None:
    drive = np.concatenate([np.linspace(0.0, 1.0, 500), np.linspace(1.0, 0.0, 500)])
    output = np.random.default_rng(1).normal(drive**2, 1e-3)
    assert np.array_equal(thin_rows(drive, 40, output), thin_rows(drive, 40))
