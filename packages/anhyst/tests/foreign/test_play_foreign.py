"""The map with one play operator is not worse than a single-valued map on the test magnets."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from anhyst.compensate.methods import make_compensator
from anhyst.compensate.sources import OperatingRange, Sources
from anhyst.compilation.play import CycleErrors, measure_cycle_errors
from anhyst.data.reading import read_loops
from anhyst.support.kinds import MethodName
from anhyst.support.numeric import FloatArray, rms
from tests.foreign.magnets import MAGNETS

MAX_RELATIVE_ERROR = {"u": 0.25, "hard": 0.6, "soft": 1.0}
"""Error over the whole loop relative to the single-valued map; ``soft`` has almost no loop."""


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(MAGNETS))
def test_one_play_removes_the_major_loop_without_harming_small_cycles(name: str, tmp_path: Path) -> None:
    magnet = MAGNETS[name]
    loops = read_loops(magnet.write_loops(tmp_path / "loops.csv"))
    gap = magnet.unseen[0]

    def answer(current: FloatArray, at: float) -> FloatArray:
        driven = np.maximum(current - magnet.sensors.current_offset, 0.0)
        return magnet.force(driven, at) + magnet.sensors.force_offset

    largest = 0.9 * float(answer(np.linspace(0.0, magnet.top, 60), gap)[-1])
    ends = min(magnet.gaps), max(magnet.gaps)
    sources = Sources(OperatingRange(gap, 0.5 * largest, 2e4, ends, largest, magnet.top), loops)

    def left(method: MethodName) -> CycleErrors:
        return measure_cycle_errors(make_compensator(method, sources, "fixed"), answer, gap, largest)

    without, play = left("single-valued"), left("play")
    assert rms(play.major) <= MAX_RELATIVE_ERROR[name] * rms(without.major)
    assert rms(play.small) <= 1.05 * rms(without.small)
