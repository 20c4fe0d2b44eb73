"""What ``inspect`` says of compensation: from a map of the example that can be made again."""

from __future__ import annotations

import importlib.util
import json
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from anhyst.control.controller_file import read_controller
from anhyst.data import LoopSet
from anhyst.data.reading import read_loops
from anhyst.data.verdict import judge
from anhyst.rig.bearing.file import BearingRig, read_bearing
from anhyst.rig.bearing.measuring import measure_loops
from anhyst.study.bearing.benefit import FRACTIONS, WIDTHS, benefit
from anhyst.study.bearing.benefit_note import BenefitNote, benefit_note, table
from anhyst.study.bearing.variations import changed, with_iron
from anhyst.support.units import QUANTITIES
from tests.cli.command import quick

ROOT = Path(__file__).resolve().parents[2]
EXAMPLE = ROOT / "examples" / "bearing"


@pytest.fixture(scope="module")
def tool() -> ModuleType:
    spec = importlib.util.spec_from_file_location(
        "make_benefit_table", ROOT / "tools" / "make_benefit_table.py"
    )
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def rig() -> BearingRig:
    return read_bearing(EXAMPLE / "rig.toml")


def note_of(loops: LoopSet) -> BenefitNote:
    found = benefit_note(loops, judge(loops).width_relative)
    assert found is not None
    return found


@pytest.mark.slow
def test_a_magnet_of_the_table_comes_out_again(tool: ModuleType, rig: BearingRig) -> None:
    made = benefit(rig, read_controller(EXAMPLE / "controller.toml"), (1.0,), (0.15,))
    kept = [
        row for row in table() if (row["pinning_scale"], row["reversible_fraction"]) == (1.0, 0.15)
    ]
    again = tool.rows(made)
    assert len(again) == len(kept) == 4
    for one, other in zip(again, kept, strict=True):
        for name in ("height_m", "iron", "outcome", "settling_outcome"):
            assert one[name] == other[name], "run tools/make_benefit_table.py again"
        for name in ("flux_outcome", "settling_flux_outcome"):  # close together in some cells
            assert {one[name], other[name]} != {"gain", "loss"}
        for name in ("loop_width_percent", "after_reversal", "after_reversal_true"):
            assert one[name] == pytest.approx(other[name], rel=0.01)
        # A last bit of a loop makes another model; so does other noise, by about a tenth.
        for variant, value in other["overshoot_percent"].items():
            assert one["overshoot_percent"][variant] == pytest.approx(value, rel=0.1, abs=0.1)
        for variant, value in other["settling_s"].items():
            assert one["settling_s"][variant] == pytest.approx(value, rel=0.03)


def test_the_table_holds_the_whole_map(rig: BearingRig) -> None:
    irons = {(row["pinning_scale"], row["reversible_fraction"]) for row in table()}
    assert irons == {(scale, fraction) for scale in WIDTHS for fraction in FRACTIONS}
    heights = rig.settings.simulate.steps_m
    assert [row["height_m"] for row in table()] == heights * len(irons)
    for row in table():
        assert row["iron"] == ("pathological" if row["after_reversal_true"] < 0.25 else "regular")
        assert row["overshoot_percent"]["full"] < row["overshoot_percent"]["ratio"]


def test_the_documentation_shows_the_same_table(tool: ModuleType) -> None:
    text = (ROOT / "docs" / "benefit.md").read_text(encoding="utf-8").splitlines()
    for rows in tool.markdown(table()):
        assert len(rows) == 12
        start = text.index(rows[0])
        assert text[start : start + 12] == rows, "run tools/make_benefit_table.py again"


def test_the_example_finds_itself(rig: BearingRig) -> None:
    found = note_of(read_loops(rig.measured.places[0]))
    assert {(row["pinning_scale"], row["reversible_fraction"]) for row in found.nearest} == {
        (1.0, 0.15)
    }
    assert len(found.nearest) == 4
    assert "\n" not in found.sentence
    assert "anhyst simulate --benefit" in found.sentence
    overshoot = [row["overshoot_percent"]["ratio"] for row in found.nearest]
    assert f"{min(overshoot):.2g} to {max(overshoot):.2g} % with a constant" in found.sentence


@pytest.mark.parametrize(("scale", "fraction"), [(1.1, 0.05), (0.9, 0.3), (2.1, 0.3), (0.55, 0.15)])
def test_another_magnet_finds_the_one_most_like_it(
    rig: BearingRig, scale: float, fraction: float
) -> None:
    found = note_of(measure_loops(with_iron(rig, fraction, scale)))
    for row in found.nearest:
        assert row["pinning_scale"] == min(WIDTHS, key=lambda one: abs(one - scale))
        assert row["reversible_fraction"] == fraction


def test_where_the_reversible_part_is_unknown_all_of_that_width_count(rig: BearingRig) -> None:
    coarse = measure_loops(changed(rig, {"measurement.sample_s": 0.05}))
    found = note_of(coarse)
    assert found.after_reversal is None
    assert len({row["reversible_fraction"] for row in found.nearest}) > 1
    assert "not told by these loops" in found.sentence


def test_nothing_is_told_of_loops_unlike_all_of_them(rig: BearingRig) -> None:
    found = note_of(measure_loops(with_iron(rig, 0.15, 12.0)))
    assert found.nearest == ()
    assert found.sentence.startswith("Compensation was mapped for no magnet with loops like these")
    assert "--benefit" in found.sentence


def words_for(outcomes: list[str]) -> str:
    if set(outcomes) == {"gain"}:
        return "it gained over the ratio and over the best without memory"
    if set(outcomes) == {"nothing to gain"}:
        return "beside the best without memory nothing was left to gain"
    gains, losses = outcomes.count("gain"), outcomes.count("loss")
    return f"it gained in {gains} of {len(outcomes)} cases and lost in {losses}"


def test_the_words_follow_the_rows(rig: BearingRig) -> None:
    seen = set()
    for scale, fraction in [(1.0, 0.3), (1.0, 0.05), (2.0, 0.05)]:
        found = note_of(measure_loops(with_iron(rig, fraction, scale)))
        words = words_for([row["outcome"] for row in found.nearest])
        assert words in found.sentence
        seen.add(words)
    assert len(seen) > 1


def test_only_a_bearing_gets_the_sentence(rig: BearingRig) -> None:
    loops = read_loops(rig.measured.places[0])
    one_gap = LoopSet(tuple(replace(loop, schedule=None) for loop in loops.loops[:3]),
                      loops.input, loops.output)  # fmt: skip
    assert benefit_note(one_gap, 0.05) is None
    stroke = LoopSet(loops.loops, loops.input, loops.output, QUANTITIES["temperature"])
    assert benefit_note(stroke, 0.05) is None
    moving = loops.loops[0]
    wobble = np.linspace(0.4e-3, 0.5e-3, moving.n)
    assert benefit_note(replace(loops, loops=(replace(moving, schedule=wobble),)), 0.05) is None


def test_inspect_says_it(rig: BearingRig) -> None:
    found = quick("inspect", rig.measured.places[0], cwd=ROOT)
    assert found.returncode == 0
    assert "On the simulated example bearing" in found.stdout
    told = json.loads(quick("inspect", rig.measured.places[0], "--json", cwd=ROOT).stdout)
    assert told["benefit"]["loop_width_percent"] == pytest.approx(
        100.0 * told["verdict"]["width_relative"]
    )
    assert len(told["benefit"]["nearest"]) == 4
