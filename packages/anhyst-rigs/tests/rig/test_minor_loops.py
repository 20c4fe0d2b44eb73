"""Test where minor loops of a record close."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from anhyst.data.loops import Loop
from anhyst_rigs.rig.minor_loops import find_loop_closings


def test_minor_loops_and_their_closing_errors_are_found() -> None:
    ends = np.array([0.0, 1.0, 0.0, 0.75, 0.15, 0.9, 0.3, 0.9, 0.3, 0.6, 0.0])
    drive = np.concatenate([np.linspace(*pair, 60) for pair in itertools.pairwise(ends)])
    noise = np.random.default_rng(1).normal(0.0, 0.01, drive.size)
    kept = Loop("1", drive, drive**2 + noise)
    # loss before the last minor loop closes
    lost = replace(kept, output=kept.output + 0.1 * (np.arange(drive.size) > 8.5 * 60))
    found = list(find_loop_closings(kept))
    assert [round(one.closing_input, 2) for one in found] == [0.75, 0.9, 0.3]
    assert [one.output_step(kept, drive**2) for one in found] == pytest.approx([0.0] * 3, abs=1e-4)
    for loop, off in ((kept, (0.0, 0.0, 0.0)), (lost, (0.0, 0.0, 0.1))):
        for one, expected in zip(found, off, strict=True):
            measured = one.measure_output_step(loop, drive**2)
            assert measured is not None
            assert abs(measured[0] - expected) < 4.0 * measured[1] < 0.08
