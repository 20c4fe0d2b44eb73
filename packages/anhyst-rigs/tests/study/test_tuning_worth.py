"""Test the sentence that states whether a hysteresis model is beneficial after tuning."""

from __future__ import annotations

from types import SimpleNamespace as Plain
from typing import Any

import pytest

from anhyst_rigs.study.engine.beneficial_conditions import BENEFICIAL_CONDITIONS
from anhyst_rigs.study.tuning.aims import BearingFigures
from anhyst_rigs.study.tuning.result import verdict_text


def tuned(variant: str, settling: float, half_width: float = 0.01, *, meets: bool = True) -> Any:
    return Plain(
        variant=variant,
        figures=BearingFigures(1e-3 * settling),
        missed_aims={} if meets else {"overshoot_percent": 0.5},
        search_result=Plain(check=Plain(half_widths={"settling_time_s": 1e-3 * half_width})),
    )


def reported(*ones: Any) -> str:
    return verdict_text(Plain(tuned={one.variant: one for one in ones}))  # type: ignore[arg-type]


def test_a_certain_gain_is_reported_against_the_strongest_baseline_and_flux() -> None:
    said = reported(tuned("full", 4.0), tuned("ratio", 9.0), tuned("single-valued", 5.0), tuned("flux", 3.9))
    assert said == (
        "worth it: 'full' settles in 4.00 ms, the strongest baseline without hysteresis model "
        "('single-valued') in 5.00 ms, 20 % less; measured flux: 3.90 ms"
    )


@pytest.mark.parametrize(
    ("mine", "words"),
    [
        (tuned("full", 4.99), "the same within the noise"),
        (tuned("full", 6.0), "certainly less"),
        (tuned("full", 3.0, meets=False), "'full' misses the aims"),
    ],
)
def test_a_missing_gain_is_reported(mine: Any, words: str) -> None:
    said = reported(mine, tuned("single-valued", 5.0), tuned("ratio", 4.0, meets=False))
    assert said.startswith("not worth it here: ")
    assert words in said
    assert "('single-valued')" in said
    assert BENEFICIAL_CONDITIONS["feedback"] in said


def test_compensation_is_worthwhile_if_no_baseline_meets_the_aims() -> None:
    said = reported(tuned("full", 6.0), tuned("single-valued", 5.0, meets=False))
    assert said.startswith("worth it: 'full' meets the aims, ")


def test_one_variant_alone_gives_no_verdict() -> None:
    assert "no verdict: only 'full' was tuned; --all-variants" in reported(tuned("full", 4.0))
