"""Test rig files with irons of families other than cells: reading, checks and simulation."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from anhyst._core import Coil, Piece
from anhyst.data.verdict import assess_loops
from anhyst_rigs.rig.body import read_bearing
from anhyst_rigs.rig.drift import Drift, change_iron, change_rig, drifted_file
from anhyst_rigs.rig.force.file import read_rig
from anhyst_rigs.rig.measuring import measure_loops
from anhyst_rigs.rig.parts.magnet import make_solenoid_magnet
from anhyst_rigs.rig.plant import make_plant
from tests.oracles.solenoid import OracleGap
from tests.plant.irons import FOLDER, STEELS
from tests.refusals import refused

EXAMPLES = FOLDER.parent
TEXT = (FOLDER / "irons.toml").read_text(encoding="utf-8")
every = pytest.mark.parametrize("name", STEELS)


def keys_of(name: str) -> str:
    """Return the keys of an iron's table."""
    found = re.search(rf"^\[{name}\].*?\n(.*?)(?=^\[|\Z)", TEXT, re.M | re.S)
    assert found is not None
    return found[1]


def with_keys(path: Path, keys: str) -> Path:
    """Replace the keys of the iron in a file; name, length and area stay."""
    text = path.read_text(encoding="utf-8")
    begun, title, rest = re.split(r"(^\[+iron\]+.*\n)", text, maxsplit=1, flags=re.M)
    own, *after = rest.split("\n[", 1)
    kept = [line for line in own.splitlines() if re.match(r"name|length_m|area_m2", line)]
    whole = begun + title + "\n".join([*kept, keys])
    path.write_text("\n[".join([whole, *after]), encoding="utf-8")
    return path


@pytest.fixture
def bearing(tmp_path: Path) -> Path:
    shutil.copytree(EXAMPLES / "bearing", tmp_path, dirs_exist_ok=True)
    return tmp_path / "rig.toml"


@pytest.fixture
def solenoid(tmp_path: Path) -> Path:
    shutil.copytree(EXAMPLES / "solenoid", tmp_path, dirs_exist_ok=True)
    return tmp_path / "rig.toml"


@every
def test_a_bearing_pulls_harder_coming_down_whatever_its_iron(bearing: Path, name: str) -> None:
    rig = read_bearing(with_keys(bearing, keys_of(name)))
    assert rig.settings.steel.plant_parameters() == STEELS[name].plant_parameters()
    plant = make_plant(change_rig(rig, {"body.mass_kg": 1e200}), 0)  # cannot move
    plant.place([0.45e-3], [0.0])
    plant.hold(2.5, 0)
    rising = plant.force
    plant.hold(4.0, 0)
    plant.hold(2.5, 0)
    assert 50.0 < rising < plant.force < 400.0
    falling = plant.force
    for current in [2.5] * 50 + [4.0] * 200 + [2.5] * 200:
        plant.advance([current], 0.0)
    assert plant.current == pytest.approx(2.5, abs=1e-3)
    assert plant.force == pytest.approx(falling, rel=0.02)


@every
def test_a_solenoid_uses_up_its_ampere_turns_whatever_its_iron(solenoid: Path, name: str) -> None:
    with_keys(solenoid.with_name("solenoid.toml"), keys_of(name))
    rig, piece = read_rig(solenoid), Piece(STEELS[name].make_steel())
    file, magnet = rig.solenoid_file, rig.magnet()
    assert file is not None
    forces = []
    for current in (0.0, 1.2, 0.4, 1.0, 0.7, 0.1):
        forces.append(magnet.hold(current, 1.6e-3))
        flux = magnet.psi / file.circuit.turns
        used = OracleGap(file.circuit, 1.6e-3).mmf(flux)
        used += file.circuit.slide_reluctance_per_H * flux
        field = (file.circuit.turns * current - used) / file.iron.length_m
        piece.commit(field)
        assert piece.density * file.iron.area_m2 == pytest.approx(flux, rel=1e-7, abs=1e-11)
    assert forces[1] > forces[3] > forces[4] > forces[2] > forces[5] >= 0.0


def test_a_solenoid_follows_the_same_path_cut_finely(solenoid: Path) -> None:
    file = read_rig(solenoid).solenoid_file
    assert file is not None
    for name in ("preisach-hard", "duhem-hard"):
        magnet = make_solenoid_magnet(STEELS[name], file.iron, file.circuit)
        coarse, fine = Coil(magnet), Coil(magnet)
        for start, end in ((0.0, 1.2), (1.2, 0.3), (0.3, 0.9)):
            coarse.hold(end, 1.6e-3)
            for current in np.linspace(start, end, 40)[1:].tolist():
                fine.hold(current, 1.6e-3)
            assert fine.force == pytest.approx(coarse.force, rel=1e-6)


@pytest.mark.parametrize("name", ["preisach-usual", "duhem-usual"])
def test_loops_of_a_bearing_can_be_measured_whatever_its_iron(bearing: Path, name: str) -> None:
    rig = read_bearing(with_keys(bearing, keys_of(name)))
    loop = next(iter(measure_loops(rig).loops))
    rising, falling = (
        loop.output[np.abs(loop.input - 2.0) < 0.03][side] for side in (slice(2), slice(-2, None))
    )
    assert float(np.min(falling)) > float(np.max(rising)) + 2.0


@pytest.mark.parametrize(
    ("name", "old", "new", "what"),
    [
        ("duhem-usual", '"duhem"', '"dühem"', "unknown-choice iron[1]"),
        ("duhem-usual", "turning_T = 0.18", "turning_mT = 180.0", "extra-forbidden iron[1].turning_mT"),
        ("duhem-usual", "turning_T = 0.18", "turning_T = 1.8", "small-loops-give-energy"),
        ("duhem-usual", "knee_sharp_A_per_m = 120.0", "knee_sharp_A_per_m = 12.0", "fades-too-fast"),
        (
            "preisach-usual",
            "feedback_A_per_m_T = 12.0",
            "feedback_A_per_m_T = 200.0",
            "reversible-part-jumps",
        ),
        (
            "preisach-usual",
            "pinning_spread = 0.5",
            "pinning_spread = 0.0",
            "greater-than iron[1].pinning_spread",
        ),
        ("preisach-usual", 'family = "preisach"', 'family = "duhem"', "extra-forbidden iron[1].saturation_T"),
        ("preisach-usual", 'family = "preisach"', "", "extra-forbidden iron[1].saturation_T"),
        ("preisach-usual", "pinning_A_per_m ", "pinning_A_per_mm ", "extra-forbidden: mean pinning_A_per_m?"),
    ],
)
def test_numbers_that_make_no_iron_are_refused_in_one_line_at_their_place(
    bearing: Path, name: str, old: str, new: str, what: str
) -> None:
    keys = keys_of(name)
    assert old in keys
    with refused(what) as caught:
        read_bearing(with_keys(bearing, keys.replace(old, new)))
    assert re.match(rf"{re.escape(str(bearing))}:\d+: iron\[1\]", str(caught.value))


def test_a_drifted_iron_of_any_family_is_another_one(bearing: Path) -> None:
    for name in ("preisach-usual", "duhem-usual"):
        path = with_keys(bearing, keys_of(name))
        rig = read_bearing(path)
        drift = Drift(pinning=0.2, saturation=0.05)
        wide = drifted_file(rig.settings, drift)
        iron, other = (one.steel for one in (rig.settings, wide))
        assert other.saturation_sharp_T == pytest.approx(1.05 * iron.saturation_sharp_T)
        assert other != iron
        shutil.copy(EXAMPLES / "bearing" / "rig.toml", bearing)


def test_an_iron_of_any_family_gets_wider_loops(bearing: Path) -> None:
    for name, key in (("duhem-usual", "coercivity_A_per_m"), ("preisach-usual", "pinning_A_per_m")):
        rig = read_bearing(with_keys(bearing, keys_of(name)))
        narrow, wide = (assess_loops(measure_loops(change_iron(rig, None, width))) for width in (1.0, 2.0))
        assert wide.width_relative > 1.5 * narrow.width_relative
        other = change_iron(rig, None, 2.0).settings.steel
        assert other.model_dump() == rig.settings.steel.model_dump() | {
            key: 2.0 * getattr(rig.settings.steel, key)
        }
        shutil.copy(EXAMPLES / "bearing" / "rig.toml", bearing)


def test_a_reversible_fraction_is_refused_for_families_without_one(bearing: Path) -> None:
    rig = read_bearing(with_keys(bearing, keys_of("duhem-usual")))
    with refused("not-iron-of-cells iron.family"):
        change_iron(rig, 0.1)


def test_an_iron_without_family_is_one_of_cells(bearing: Path) -> None:
    assert read_bearing(bearing).settings.steel.family == "cells"
