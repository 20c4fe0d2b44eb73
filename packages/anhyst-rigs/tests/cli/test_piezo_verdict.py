"""Test the verdict that the command ``simulate`` prints for a piezo stage."""

from __future__ import annotations

import pytest

from anhyst_rigs.study.engine.beneficial_conditions import BENEFICIAL_CONDITIONS
from anhyst_rigs.study.piezo import MAX_WORTHWHILE_DEVIATION_RATIO, judge_deviation_ratio


@pytest.mark.parametrize(("share", "worth"), [(0.24, True), (1.2, False)])
def test_a_piezo_stage_with_little_gain_names_beneficial_conditions(share: float, worth: bool) -> None:
    assert (
        BENEFICIAL_CONDITIONS["piezo"] in judge_deviation_ratio(share * MAX_WORTHWHILE_DEVIATION_RATIO).text
    ) != worth
