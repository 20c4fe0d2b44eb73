"""Check rig files of force control: reading, and error messages with line and key."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from anhyst.support.toml_file import TomlFileError
from anhyst_rigs.rig.force.file import read_rig
from tests.refusals import refused
from tests.repository import ROOT

EXAMPLE = ROOT / "examples" / "solenoid"


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    for name in ("rig.toml", "solenoid.toml"):
        shutil.copy(EXAMPLE / name, tmp_path)
    return tmp_path / "rig.toml"


def line_of(path: Path, key: str) -> int:
    lines = path.read_text().splitlines()
    return next(number for number, line in enumerate(lines, 1) if line.startswith(key))


def change(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


@pytest.mark.parametrize("folder", [EXAMPLE, EXAMPLE / "drawn"])
def test_the_bundled_rigs_are_read(folder: Path) -> None:
    rig = read_rig(folder / "rig.toml")
    assert rig.dt == 1.0 / rig.settings.timing.rate_Hz
    assert rig.measured_loops.paths[0] == folder / "loops.csv"
    assert rig.magnet().hold(1.0, 1e-3) > 30.0


def test_an_unknown_key_is_reported_with_its_line_and_the_nearest_known_one(rig: Path) -> None:
    line = line_of(rig, "dac_bits")
    change(rig, "dac_bits", "dac_bit")
    with refused("extra-forbidden amplifier[1].dac_bit: dac_bits") as caught:
        read_rig(rig)
    text = str(caught.value)
    assert text.startswith(f"{rig}:{line}: ")
    assert "amplifier[1].dac_bits (line" in text  # this one is missing


def test_a_key_inside_a_list_of_tables_is_reported_too(rig: Path) -> None:
    change(rig, '"force"\nlow = 0.3\n', '"force"\nlov = 0.3\n')
    with refused("extra-forbidden case[2].lov: low", TomlFileError):
        read_rig(rig)


@pytest.mark.parametrize(
    ("old", "new", "reported"),
    [
        ('format = "anhyst-rig"', 'format = "rig"', "wrong-format format: anhyst-rig"),
        ("rate_Hz = 1000.0", "rate_Hz = 3.0", "greater-than-equal timing.rate_Hz: 100"),
        ("dac_bits = 12", "dac_bits = 12.5", "int-type amplifier[1].dac_bits"),
        ("noise_N = 0.06", "noise_N = -0.06", "greater-than-equal sensor[3].noise_N"),
        ("low = 0.05", "low = 0.96", "range-reversed case[1]"),
        ("gaps_m = [1.0e-3", 'gaps_m = ["1 mm"', "float-type case[4].gaps_m[1]"),
        ("seed = 7", "seed = nan", "int-type seed"),
        ('name = "inner"', 'name = "wide open"', "string-pattern-mismatch case[2].name"),
    ],
)
def test_a_wrong_value_is_reported(rig: Path, old: str, new: str, reported: str) -> None:
    change(rig, old, new)
    with refused(reported, TomlFileError):
        read_rig(rig)


def test_a_missing_file_names_itself(rig: Path) -> None:
    (rig.parent / "solenoid.toml").unlink()
    with refused("no-such-file: solenoid.toml"):
        read_rig(rig)
    with refused("cannot-be-read"):
        read_rig(rig.parent)


def test_an_invalid_toml_file_is_reported(rig: Path) -> None:
    rig.write_bytes(b"\xff\xfe\x00")
    with refused("not-utf8"):
        read_rig(rig)
    rig.write_text("format = ")
    with refused("damaged-toml"):
        read_rig(rig)


@pytest.mark.parametrize(
    ("key", "old", "new"),
    [
        ("case[4].gaps_m[7]", "2.6e-3, 2.8e-3]", "2.6e-3, 9e-3]"),
        ("case[3].high_m", "high_m = 0.0028", "high_m = 1.0"),
        ("case[3].low_m", "low_m = 0.0\nhigh_m = 4.0e-3", "low_m = 1.1e-3\nhigh_m = 4.0e-3"),
    ],
)
def test_gaps_that_the_sensor_does_not_read_are_refused_before_a_run(
    rig: Path, key: str, old: str, new: str
) -> None:
    change(rig, old, new)
    with refused(f"beyond-sensor {key}", TomlFileError) as caught:
        read_rig(rig)
    assert str(caught.value).startswith(f"{rig}:")
