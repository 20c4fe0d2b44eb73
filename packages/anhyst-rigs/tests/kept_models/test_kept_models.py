"""Kept models are what identification gives."""

from __future__ import annotations

import numpy as np
import pytest

from tests.kept_models.making import MODEL_RECIPES
from tests.truths import FOLDER, truth


def test_every_saved_model_has_an_entry_in_the_table() -> None:
    assert {path.stem for path in FOLDER.glob("*.toml")} == set(MODEL_RECIPES)


FIRST = {
    *("bearing", "electromagnet", "solenoid-held", "duhem-soft-auto", "bearing-no-dead-band"),
    *("solenoid-effective-field-reluctance", "electromagnet-effective-field-scaling"),
}
"""What stands for its like: each law, each gap map, each rig, one without a dead band."""


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [pytest.param(truth, marks=[pytest.mark.campaign] * (truth not in FIRST)) for truth in MODEL_RECIPES],
)
def test_identification_gives_the_saved_model(name: str) -> None:
    """Not to the last bit, which differ from processor to processor: to 0.05 % of its range."""
    kept, now = truth(name), MODEL_RECIPES[name].identify()
    assert (now.law, now.gap_map) == (kept.law, kept.gap_map)
    assert kept.valid is not None
    low, high = kept.valid.input
    drive = low + (high - low) * np.interp(
        np.arange(1200), np.arange(7) * 200.0, [0.0, 1.0, 0.1, 0.8, 0.2, 0.6, 0.0]
    )
    for node in kept.nodes:
        known, found = (one.predict(drive, node, history="demagnetised").output
                        for one in (kept, now))  # fmt: skip
        assert np.max(np.abs(known - found)) < 5e-4 * np.ptp(known)
