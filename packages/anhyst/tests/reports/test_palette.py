"""Test that all kinds of colour vision can distinguish the colours of the figures."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from anhyst.support.figures import PALETTE
from tests.reports.colour_vision import XYZ, difference, linear_rgb, seen_difference


def test_the_difference_is_that_of_the_published_pairs() -> None:
    """Sharma, Wu and Dalal 2005, pairs 1, 7, 17 and 25."""
    for first_colour, second_colour, expected in (
        ((50.0, 2.6772, -79.7751), (50.0, 0.0, -82.7485), 2.0425),
        ((50.0, 0.0, 0.0), (50.0, -1.0, 2.0), 2.3669),
        ((50.0, 2.5, 0.0), (73.0, 25.0, -18.0), 27.1492),
        ((60.2574, -34.0099, 36.2677), (60.4626, -34.1751, 39.4387), 1.2644),
    ):
        assert difference(np.array(first_colour), np.array(second_colour)) == pytest.approx(
            expected, abs=1e-4
        )


@pytest.mark.parametrize(
    ("vision", "smallest"), [("normal", 21.2), ("deuteranopia", 12.5), ("protanopia", 12.2)]
)
def test_all_kinds_of_colour_vision_distinguish_the_palette(vision: str, smallest: float) -> None:
    differences = [seen_difference(*pair, vision) for pair in combinations(PALETTE.values(), 2)]
    assert min(differences) == pytest.approx(smallest, abs=0.05)


def test_every_colour_is_visible_on_the_paper_of_both_themes() -> None:
    for paper in ("#FFFFFF", "#14171B"):
        for name, colour in PALETTE.items():
            dim_luminance, bright_luminance = sorted(XYZ[1] @ linear_rgb(tone) for tone in (paper, colour))
            assert (bright_luminance + 0.05) / (dim_luminance + 0.05) > 2.2, (name, paper)
