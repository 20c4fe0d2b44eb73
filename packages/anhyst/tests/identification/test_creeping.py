"""A fit of one half of the record of a real piezo stack predicts the other half."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from anhyst.data import Loop
from anhyst.data.path import History
from anhyst.data.reading import read_loops
from anhyst.identification import identify
from anhyst.model.actuator import Model

AUTHORS = 0.58e-6


@cache
def halves(folder: Path) -> tuple[Model, Loop, int]:
    """Return the model of the first half, the whole record, and the start of the second half."""
    loops = read_loops(
        folder / "piezo_flexure" / "model_run.csv",
        columns={"V_in": "u_V", "y_um": "x_um"},
        history="conditioned:0",
    )
    whole = loops.loops[0]
    half = whole.n // 2
    assert whole.time is not None
    first = Loop("1", whole.input[:half], whole.output[:half], None, whole.time[:half],
                 History.parse("conditioned:0"))  # fmt: skip
    return identify(loops.with_loops([first])).model, whole, half


@pytest.mark.slow
def test_the_inverse_of_unseen_data_has_half_the_error_of_the_authors(measurements: Path) -> None:
    model, whole, half = halves(measurements)
    asked = model.invert(whole.output, time=whole.time).drive
    slope = np.ptp(whole.output[half:]) / np.ptp(whole.input[half:])
    rms = slope * float(np.sqrt(np.mean((asked - whole.input)[half:] ** 2)))
    assert rms <= 0.26e-6 < AUTHORS / 2.0


def test_its_slow_drift_is_creep(measurements: Path) -> None:
    model, whole, half = halves(measurements)
    assert model.dynamics is not None
    assert 0.005 < sum(model.dynamics.shares) < 0.03
    error = (model.predict(whole.input, time=whole.time).output - whole.output)[half:]
    assert abs(error.mean()) < 0.1e-6  # 0.21 um without creep
    assert float(np.std(error)) < 0.22e-6


def test_at_one_rate_no_lag_beyond_a_sample_is_believed(measurements: Path) -> None:
    model, _, _ = halves(measurements)
    assert model.dynamics is not None
    assert model.dynamics.lag == pytest.approx(5e-3, rel=0.01)
    assert model.dynamics.fastest == pytest.approx(1.0, rel=0.02)
