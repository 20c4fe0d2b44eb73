"""Test measured loops of electrical steels: square, one loop each, uneven spacing."""

from __future__ import annotations

from pathlib import Path

import pytest

from anhyst.data.reading import read_loops
from anhyst.identification import identify
from tests.repository import ROOT

BUNDLED = ROOT / "examples" / "steels"
SHARED = ROOT.parent / "shared"


@pytest.mark.parametrize(
    ("path", "most"),
    [
        (BUNDLED / "m270_50a.csv", 0.005),
        pytest.param(BUNDLED / "m400_50a.csv", 0.006, marks=pytest.mark.slow),
        pytest.param(SHARED / "data/steels_modelica/m400_50a_50kA.csv", 0.03, marks=pytest.mark.slow),
        pytest.param(SHARED / "cases/files/square_steel_ev0.csv", 0.006, marks=pytest.mark.slow),
    ],
    ids=["m270", "m400", "m400-saturated", "square"],
)
def test_identify_fits_the_loop_of_a_steel(path: Path, most: float) -> None:
    if not path.is_file():
        pytest.skip(f"{path} is not here")
    fit = identify(read_loops(path)).model.fit
    assert fit is not None
    assert fit.rms < most * fit.largest_output


def test_tables_of_others_keep_their_licence() -> None:
    assert "Modelica Association" in (BUNDLED / "LICENSE").read_text(encoding="utf-8")
    assert "BSD-3-Clause" in (BUNDLED / "README.md").read_text(encoding="utf-8")
