"""What a campaign of measurement leaves."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import pytest

from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.measuring import measure_path


class Held:
    """A magnet and a sensor that show what they are given."""

    def run(self, current: FloatArray, gap: FloatArray, seconds: float) -> FloatArray:
        return np.column_stack([current * gap])

    def read(self, values: FloatArray) -> FloatArray:
        return values


@pytest.mark.parametrize(
    ("gap", "name"),
    [(0.35e-3, "0.35mm-up"), (0.5e-3, "0.50mm-up"), (0.351e-3, "0.351mm-up"),
     (0.352e-3, "0.352mm-up")],
)  # fmt: skip
def test_no_two_gaps_share_a_label(gap: float, name: str) -> None:
    held = cast(Any, Held())
    sensors = {"current": held, "force": held}
    assert measure_path(held, sensors, gap, np.array([0.0, 1.0, 0.0]), "up", ()).label == name
