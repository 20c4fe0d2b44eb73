"""The compensator that runs on a controller, against the models in double precision."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from actuators import (
    CURRENTS,
    GAPS,
    WIDE,
    FloatArray,
    compiled,
    largest_force,
    magnet,
    nested,
    ranges,
    reversals,
    ring,
    triangles,
)

from anhyst.compile.block import Limits, Scales
from anhyst.compile.full import build_full
from anhyst.compile.twin import Twin
from anhyst.model import GapMap

RESIDUAL = 0.5
MAGNETS: list[tuple[GapMap, float]] = [
    (gap_map, play) for gap_map in ("scaling", "reluctance") for play in (0.0, 40.0)
]
PROMISED = 0.002
"""Of the largest force."""


def jumps(high: float) -> FloatArray:
    """Full-range jumps in one sample, and jumps to anywhere."""
    anywhere = np.random.default_rng(5).uniform(0.04, 0.95, 2000) * high
    return np.concatenate([np.tile([0.95 * high, 0.04 * high], 200), anywhere])


DEMANDS: dict[str, Callable[[float], FloatArray]] = {
    "nested loops": nested,
    "random reversals": lambda high: reversals(0.04 * high, 0.95 * high, 150, 3),
    "jumps": jumps,
}


def gap_of(kind: str, samples: int) -> FloatArray:
    """Return a gap that stands, sweeps the whole range, or is anywhere from sample to sample."""
    if kind == "standing":
        return np.full(samples, WIDE)
    if kind == "moving":
        middle, half = (GAPS[0] + GAPS[-1]) / 2.0, (GAPS[-1] - GAPS[0]) / 2.0
        return np.asarray(middle + half * np.sin(0.037 * np.arange(samples)))
    return np.random.default_rng(11).uniform(GAPS[0], GAPS[-1], samples)


@pytest.mark.parametrize("io", ["q15", "q31"])
@pytest.mark.parametrize("gap", ["standing", "moving", "anywhere"])
@pytest.mark.parametrize("demand", DEMANDS)
@pytest.mark.parametrize(("gap_map", "play"), MAGNETS)
def test_full_gives_the_demanded_force(
    gap_map: GapMap, play: float, demand: str, gap: str, io: str
) -> None:
    wanted = DEMANDS[demand](largest_force(gap_map, play, GAPS[-1]))
    at = gap_of(gap, wanted.size)
    drive = Twin(compiled("full", gap_map, play), io).run(wanted, at)
    force = magnet(gap_map, play).predict(drive, at, history="demagnetised").output
    largest = largest_force(gap_map, play, GAPS[0])
    assert np.abs(force - wanted).max() < PROMISED * largest


@pytest.mark.parametrize("play", [0.0, 4.0])
def test_full_gives_the_demanded_flux_of_either_sign(play: float) -> None:
    model = ring(play)
    top = float(model.predict([0.0, 150.0], history="demagnetised").output[-1])
    limits = Limits((-top, top), (-150.0, 150.0))
    block = build_full(model, Scales(1.1 * top, 160.0, 0.0, 0.0), limits)
    wanted = np.concatenate(
        [reversals(-0.95 * top, 0.95 * top, 150, 7), np.tile([0.95 * top, -0.95 * top], 50)]
    )
    drive = Twin(block).run(wanted)
    flux_density = model.predict(drive, history="demagnetised").output
    assert np.abs(flux_density - wanted).max() < PROMISED * top
