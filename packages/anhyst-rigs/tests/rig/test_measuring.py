"""Test the loops of a measurement campaign."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import pytest

from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.measurement_table import MeasurementTable
from anhyst_rigs.rig.measuring import measure_at_gap


class Held:
    """A magnet and a sensor that return their inputs."""

    def magnet(self) -> Held:
        return self

    def sensors(self, seed: list[int], sample: float) -> dict[str, Held]:
        return {"current": self, "force": self}

    def hold(self, current: float, gap: float) -> None:
        pass

    def run(self, current: FloatArray, gap: FloatArray, seconds: float) -> FloatArray:
        return np.column_stack([current * gap])

    def read(self, values: FloatArray) -> FloatArray:
        return values


@pytest.mark.parametrize(
    ("gap", "name"),
    [(0.35e-3, "0.35mm-up"), (0.5e-3, "0.50mm-up"), (0.351e-3, "0.351mm-up"),
     (0.352e-3, "0.352mm-up")],
)  # fmt: skip
def test_gaps_have_distinct_labels(gap: float, name: str) -> None:
    campaign = MeasurementTable.model_validate(
        {
            **{"gaps_m": [gap], "current_max_A": 1.0, "sweep_A_per_s": 1.0, "sample_s": 1.0},
            **{"conditioning_cycles": 1, "records": [{"name": "up", "turns": [0.0, 1.0, 0.0]}]},
        }
    )
    (loop,) = measure_at_gap(cast(Any, Held()), campaign, 0)
    assert loop.label == name
