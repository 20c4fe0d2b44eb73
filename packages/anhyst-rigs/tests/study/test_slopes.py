"""Test slopes of a magnet with and without hysteresis against derivatives in closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest

from anhyst_rigs.study.bearing.operating import measure_slopes

C, GAP, CURRENT = 1e-5, 0.45e-3, 1.75


def pull(current: float, gap: float) -> float:
    return C * (current / (gap + 0.05e-3)) ** 2 / 2.0


class Play:
    """Parallel plays of the current with up to 0.1 A half-width, and a reversible part."""

    def __init__(self, reversible: float) -> None:
        self.reversible = reversible
        self.width = np.linspace(0.02, 0.1, 30)
        self.place = np.zeros(30)

    def step(self, current: float, gap: float) -> float:
        self.place = np.clip(self.place, current - self.width, current + self.width)
        part = self.reversible * current + (1.0 - self.reversible) * float(np.mean(self.place))
        return pull(part, gap)


@pytest.mark.first(1)
@pytest.mark.parametrize("reversible", [0.1, 0.15, 0.3, 0.6])
def test_the_response_after_a_reversal_is_the_reversible_fraction(reversible: float) -> None:
    iron = Play(reversible)
    found = measure_slopes(iron.step, CURRENT, GAP, 0.0, 4.5, 1e-6)
    # Mean of both branches, whose currents are 0.06 A to either side (rms 0.064 A).
    lag = (1.0 - reversible) * 0.06
    assert found.static.force == pytest.approx(pull(math.hypot(CURRENT, lag), GAP), rel=1e-3)
    assert found.static.k_i == pytest.approx(2.0 * pull(CURRENT, GAP) / CURRENT, rel=1e-3)
    assert found.static.k_s == pytest.approx(2.0 * found.static.force / 0.5e-3, rel=1e-3)
    for slope, inside in ((found.after_rise, CURRENT - lag), (found.after_fall, CURRENT + lag)):
        expected = reversible * 2.0 * pull(inside, GAP) / inside
        assert slope == pytest.approx(expected, rel=0.01)
    assert found.slope_ratio == pytest.approx(reversible * (CURRENT - lag) / CURRENT, rel=0.01)
    assert found.label == ("pathological" if reversible < 0.25 else "regular")


def test_without_hysteresis_nothing_is_lost_at_a_reversal() -> None:
    found = measure_slopes(pull, CURRENT, GAP, 0.0, 4.5, 1e-6)
    assert found.slope_ratio == pytest.approx(1.0, abs=0.01)
    assert found.static.k_i == pytest.approx(2.0 * pull(CURRENT, GAP) / CURRENT, rel=1e-3)
    assert found.static.k_s == pytest.approx(2.0 * pull(CURRENT, GAP) / 0.5e-3, rel=1e-3)
    assert found.label == "regular"


def test_a_current_at_the_end_of_the_loop_is_refused() -> None:
    with pytest.raises(ValueError, match="too close to the ends"):
        measure_slopes(pull, 4.45, GAP, 0.0, 4.5, 1e-6)
