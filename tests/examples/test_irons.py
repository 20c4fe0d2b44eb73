"""Test the irons of the examples against their README, and regenerate and read their loops."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from anhyst._core import Coil, Piece
from anhyst.data.reading import read_loops
from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.parts.iron import AnySteel
from anhyst_rigs.rig.parts.magnet import make_iron_magnet
from tests.plant.irons import FOLDER, STEELS, generator

README = (FOLDER / "README.md").read_text(encoding="utf-8")
ROWS = {name: re.findall(r"[\d.]+", row) for name, row in re.findall(r"^\| `(\w+-\w+)` \|(.*)", README, re.M)}
every = pytest.mark.parametrize("name", STEELS)


def major(steel: AnySteel) -> tuple[float, float, float]:
    """Return coercive field, remanence, and flux density at 10 kA/m of the largest loop."""
    field = 1e4 * np.sinh(7.0 * np.linspace(-1.0, 1.0, 2001)) / np.sinh(7.0)
    piece = Piece(steel.make_steel())
    piece.run(np.ascontiguousarray(field[::-1]))
    density = piece.run(field)[:, 1]
    return (float(np.interp(0.0, density, field)), -float(np.interp(0.0, field, density)), float(density[-1]))


def width(current: FloatArray, force: FloatArray) -> FloatArray:
    """Return the width of a loop at constant force, A, at evenly spaced forces."""
    current, force = np.append(current, current[0]), np.append(force, force[0])
    tip_index = int(np.argmax(current))
    level = np.linspace(force[0], force[tip_index], 500)
    rising = np.interp(level, force[: tip_index + 1], current[: tip_index + 1])
    return np.asarray(rising - np.interp(level, force[: tip_index - 1 : -1], current[: tip_index - 1 : -1]))


@every
def test_the_table_agrees_with_the_irons(name: str) -> None:
    coercive, remanence, density, force, widest, mean = map(float, ROWS[name])
    assert major(STEELS[name]) == pytest.approx((coercive, remanence, density), abs=6e-3, rel=5e-3)
    example = generator()
    magnet = example.Stepped(name)
    record = next(
        one for one in example.bundled.measure("identification", other=magnet) if one.label == "0.30mm-full"
    )
    assert record.force.max() == pytest.approx(force, abs=0.06)
    widths = 100.0 * width(record.current, record.force) / example.LARGEST
    assert float(np.max(widths)) == pytest.approx(widest, abs=0.06)
    assert float(np.mean(widths)) == pytest.approx(mean, abs=0.06)


def test_each_family_is_soft_usual_and_hard() -> None:
    for family in ("preisach", "duhem"):
        soft, usual, hard = (major(STEELS[f"{family}-{kind}"])[0] for kind in ("soft", "usual", "hard"))
        assert 10.0 <= soft <= 20.0
        assert usual == pytest.approx(80.0, rel=0.1)
        assert hard == pytest.approx(300.0, rel=0.1)


def test_winding_and_poles_are_those_of_the_bundled_magnet() -> None:
    """With its iron, the simulated magnet has the force of the magnet of the bundled script."""
    example = generator()
    bundled = example.bundled.load()[0]
    coil = Coil(make_iron_magnet(example.POLES, bundled.steel))
    rng = np.random.default_rng(3)
    for current, gap in zip(rng.uniform(0.0, 3.0, 40), rng.uniform(0.3e-3, 0.6e-3, 40), strict=True):
        coil.hold(float(current), float(gap))
        assert coil.force == pytest.approx(bundled.step(float(current), float(gap)), abs=2e-4)


def test_the_files_are_readable_and_reproducible(tmp_path: Path) -> None:
    example = generator()
    files = example.files("duhem-usual")
    assert files == example.files("duhem-usual")
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    counts = {"loops": 16, "unseen_truth": 8, "moving_truth": 1, "small_truth": 12}
    assert {stem: len(read_loops(tmp_path / f"{stem}.csv").loops) for stem in counts} == counts


@every
def test_truth_files_cover_their_stated_ranges(name: str) -> None:
    example = generator()
    moving = example.moving(name)
    assert (moving.gap.min(), moving.gap.max()) == pytest.approx((0.3e-3, 0.6e-3), abs=1e-6)
    turned = np.sum(np.diff(np.sign(np.diff(moving.current))) != 0.0)
    assert 20 < turned <= 40
    for truth in example.small_cycles(name):
        bias = float(truth.label.split("-")[1]) * example.LARGEST
        there = truth.current[truth.counted]
        assert np.max(np.abs(there - bias)) <= 0.0401 * example.LARGEST
        assert 2.0 < truth.time[-1] < 60.0
