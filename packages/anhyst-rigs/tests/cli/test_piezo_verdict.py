"""What the verb ``simulate`` says of a piezo stage."""

from __future__ import annotations

import pytest

from anhyst_rigs.study.engine.where_it_pays import WHERE_IT_PAYS
from anhyst_rigs.study.piezo import WORTH_IT, judge_ratio


@pytest.mark.parametrize(("share", "worth"), [(0.24, True), (1.2, False)])
def test_a_piezo_stage_that_gains_little_names_where_it_would_pay(
    share: float, worth: bool
) -> None:
    assert (WHERE_IT_PAYS["piezo"] in judge_ratio(share * WORTH_IT).text) != worth
