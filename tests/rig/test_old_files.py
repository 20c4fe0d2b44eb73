"""Rig files of the four older formats: read with a warning, reported by their own lines, converted."""

from __future__ import annotations

import copy
import re
import tomllib
import warnings
from collections.abc import Iterator
from operator import attrgetter
from pathlib import Path
from typing import Any

import pytest

from anhyst.cli.app import main
from anhyst.rig.file import RigFile
from anhyst.rig.kind_rules import read_rig_file
from anhyst.support.errors import InputError, RenamedWarning
from anhyst.support.kinds import RIGS, FileKind
from anhyst.support.toml_text import toml_key, toml_value
from tests.refusals import refused, says

OLD = Path(__file__).parent / "old"
FORMATS = {
    "bearing": ("anhyst-bearing", FileKind.BEARING),
    "stage": ("anhyst-stage", FileKind.STAGE),
    "force": ("anhyst-rig", FileKind.FORCE),
    "piezo": ("anhyst-piezo-stage", FileKind.PIEZO),
}
every = pytest.mark.parametrize("name", FORMATS)

HELD: dict[str, dict[str, Any]] = {
    "bearing": {
        "seed": 11,
        "noise_seeds": 5,
        "loops.files": ["a.csv", "b.csv"],
        "loops.law": "play-cells",
        "loops.clean": "dedupe",
        "timing.rate_Hz": 20e3,
        "magnet.kind": "electromagnet",
        "magnet.turns": 250,
        "opposite": None,
        "bias_N": None,
        "gap_m": 0.4e-3,
        "steel.pinning_scale_A_per_m": 170.0,
        "amplifier.supply_V": 150.0,
        "body.mass_kg": 2.0,
        "gap_sensor.kind": "encoder",
        "gap_sensor.noise_m": 5e-9,
        "current_sensor.noise_A": 5e-4,
        "force_sensor.noise_N": 0.5,
        "hall_probe.range_T": 2.0,
        "load.force_N": 150.0,
        "step.heights_m": [10e-6, 20e-6],
        "step.also_gaps_m": [0.42e-3, 0.48e-3],
        "load_steps_N": [20.0],
        "spread.mass_percent": 3.0,
        "spread.gap_zero_m": 4e-6,
    },
    "stage": {
        "seed": 14,
        "noise_seeds": 3,  # as it was where the file did not say
        "loops.files": ["loops.csv"],
        "gap_m": 0.45e-3,
        "gap_total_m": 0.9e-3,
        "opposite.direction": [1.0, 0.0, 0.0],
        "bias_N": 5.0,
        "steel.coercivity_A_per_m": 80.0,
        "gap_sensor.kind": "capacitive",
        "hall_probe": None,
        "position_sensor.noise_m": 0.5e-9,
        "frame.stray_m": 18e-6,
        "tracking.format": "f32",
        "tracking.crossover_Hz": 130.0,
        "tracking.force_max_N": 240.0,
        "scan.test_m_per_s2": [22.0, 10.0],
        "scan.slit_s": 0.01,
        "spread.gap_zero_m": 3e-6,
        "spread.hall_percent": 0.7,
    },
    "force": {
        "seed": 7,
        "loops.files": ["loops.csv"],
        "timing.rate_Hz": 1000.0,
        "solenoid.file": "solenoid.toml",
        "amplifier.current_high_A": 1.2,
        "amplifier.slew_A_per_s": 80.0,
        "current_sensor.offset_A": 0.004,
        "gap_sensor.kind": "lvdt",
        "gap_sensor.adc_bits": 12,
        "force.force_max_N": 40.0,
        "force.end_m": 1e-3,
        "held.gaps_m": [1e-3, 1.25e-3],
        "moving.high_m": 2.8e-3,
        "excite.continuous_A": 0.7,
    },
    "piezo": {
        "timing.rate_Hz": 1e4,
        "stack.stroke_m_per_V": 0.28e-6,
        "flexure.resonance_Hz": 480.0,
        "stack_amplifier.high_V": 150.0,
        "position_sensor.noise_m": 4e-9,
        "displacement.bandwidth_Hz": 100.0,
        "moved.stroke_m": 30e-6,
    },
}
"""What each of the old files says, by the names of today."""


def text_of(name: str) -> str:
    return (OLD / f"{name}.toml").read_text(encoding="utf-8")


def read(path: Path) -> RigFile:
    """Read a file of an older format, which is said once."""
    with pytest.warns(RenamedWarning) as caught:
        file = read_rig_file(path, RIGS)
    (said,) = caught
    assert str(said.message).startswith(f"{path}: format anhyst-")
    assert "anhyst convert" in str(said.message)
    return file


def changed(name: str, folder: Path, *changes: tuple[str, str]) -> Path:
    """Write an old file with other texts."""
    text = text_of(name)
    for old, new in changes:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    path = folder / "rig.toml"
    path.write_text(text, encoding="utf-8")
    return path


def check(file: RigFile, held: dict[str, Any]) -> None:
    """Check what a file says by names of its attributes."""
    for key, value in held.items():
        found = attrgetter(key)(file)
        assert found == (pytest.approx(value) if isinstance(value, float) else value), key


def converted(path: Path) -> Path:
    """Convert a file on the command line."""
    out = path.with_name(f"new-{path.name}")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert main(["convert", str(path), str(out)]) == 0
    return out


@every
def test_an_old_file_says_what_it_always_said(name: str) -> None:
    file = read(OLD / f"{name}.toml")
    assert file.kind is FORMATS[name][1]
    assert file.name.startswith("old ")
    check(file, HELD[name])


def test_cases_of_old_files_stay_in_their_order() -> None:
    bearing, force = (read(OLD / f"{name}.toml") for name in ("bearing", "force"))
    (triangle,) = bearing.trajectories
    assert (triangle.kind, triangle.amplitude_m, triangle.frequency_Hz) == ("triangle", 20e-6, 1.0)
    (shaker,) = bearing.load.disturbance
    assert (shaker.kind, shaker.frequency_Hz) == ("sine", 33.0)
    shapes = [(one.name, one.low, one.high, one.cycles) for one in force.force_triangles]
    assert shapes == [("wide", 0.05, 0.95, 2), ("inner", 0.3, 0.7, 1)]


@every
def test_a_converted_file_is_the_same_rig_and_no_old_one(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = changed(name, tmp_path)
    out = converted(path)
    assert str(out) in capsys.readouterr().out
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        new = read_rig_file(out, RIGS)
    assert new == read(path)
    assert tomllib.loads(out.read_text(encoding="utf-8"))["version"] == 2
    again = converted(out)
    assert read_rig_file(again, RIGS) == new


@every
def test_comments_stay_beside_their_keys(name: str, tmp_path: Path) -> None:
    """As many of each as there were, the head of the file first."""
    path = changed(name, tmp_path)
    new = converted(path).read_text(encoding="utf-8")
    head = [line for line in text_of(name).splitlines() if line.startswith("#")]
    assert new.splitlines()[: len(head)] == head
    notes = re.findall(r"(?<=\S) +# (.*)", text_of(name))
    assert sorted(re.findall(r"(?<=\S) +# (.*)", new)) == sorted(notes)
    for line in text_of(name).splitlines():
        if match := re.match(r"(mass_kg|turns|cells|dac_bits|bandwidth_Hz|slit_s) = .*#", line):
            assert re.search(rf"^{match[1]} = .*# {re.escape(line.partition('# ')[2])}$", new, re.M)


PAIR = (
    ('"single"', '"pair"\ngap_total_m = 0.95e-3\nbias_force_N = 80.0'),
    ("force_N = 150.0", "force_N = 0.0"),
)
IRON = re.search(r"\[magnet\.iron\].*?\n\n", text_of("bearing"), re.S)
assert IRON is not None
FROM_LOOPS = (("turns = 250", 'iron = "from loops"\nturns = 250'), (IRON[0], ""))
LAW = 'force = "model"\nmodel = { file = "m.toml", flux_table = "psi.csv" }\n'


@pytest.mark.parametrize(
    ("changes", "held"),
    [
        pytest.param(
            PAIR,
            {"gap_m": 0.4e-3, "gap_total_m": 0.95e-3, "opposite.gap_m": 0.55e-3, "bias_N": 80.0},
            id="pair that is not symmetrical",
        ),
        pytest.param(FROM_LOOPS, {"magnet.iron": "from loops", "iron": None}, id="from loops"),
        pytest.param(
            [('force = "cells"\n', LAW), (IRON[0], "")],
            {
                "magnet.kind": "law",
                "magnet.model": "m.toml",
                "magnet.flux_table": "psi.csv",
                "iron": None,
            },
            id="law",
        ),
        pytest.param(
            [('force = "cells"\n', LAW.replace(', flux_table = "psi.csv"', ""))],
            {"magnet.kind": "law", "magnet.model": "m.toml", "steel.cells": 24},
            id="law with an iron",
        ),
        pytest.param([("[drift] ", "[drift]\n#"), ("gap_offset_m = 4e-6", "")],
                     {"spread.gap_zero_m": 2e-6}, id="drift of the zero"),
        pytest.param([("load_steps_N = [20.0]", "load_steps_N = []")], {"load_steps_N": []},
                     id="no load steps"),
        pytest.param([("noise_seeds = 5 ", "#")], {"noise_seeds": 20}, id="usual seeds"),
    ],
)  # fmt: skip
def test_whatever_an_old_bearing_could_be_it_still_is(
    changes: list[tuple[str, str]], held: dict[str, Any], tmp_path: Path
) -> None:
    path = changed("bearing", tmp_path, *changes)
    for file in (read(path), read_rig_file(converted(path), RIGS)):
        check(file, held)


@pytest.mark.parametrize(
    ("name", "old", "new", "what"),
    [
        ("bearing", "mass_kg = 2.0", "mass_kg = -2.0", "greater-than body[1].mass_kg"),
        ("bearing", "mass_kg = 2.0", "mass = 2.0", "unit-missing body[1].mass"),
        ("bearing", "turns = 250", "turns = 250.5", "int-type magnet[1].turns"),
        ("bearing", "cells = 24", "cells = 64", "too-many-cells iron[1].cells"),
        ("bearing", "gap_m = 0.40e-3", "gap_m = -0.4e-3", "greater-than magnet[1].gap_m"),
        ("bearing", "steps_m = [10e-6", "steps_m = [-10e-6", "greater-than case[1].heights_m[1]"),
        ("bearing", "load_steps_N = [20.0]", "load_steps_N = [nan]", "finite-number case[2]"),
        ("bearing", "amplitude_m = 20e-6", "amplitude_m = 0.0", "greater-than case[3].amplitude_m"),
        ("bearing", "noise_seeds = 5", "noise_seeds = 1", "greater-than-equal noise_seeds"),
        ("bearing", "gap_offset_m = 4e-6", "gap_offset_m = -1.0", "greater-than-equal spread"),
        ("bearing", "noise_m = 5e-9", "noise_m = -5e-9", "greater-than-equal sensor[1].noise_m"),
        ("bearing", 'loops = ["a.csv"', "loops = [3", "wrong-kind loops.files"),
        ("bearing", 'clean = "dedupe"', 'clean = "dirt"', "unknown-cleaning-step loops.clean"),
        ("bearing", "frequency_Hz = 33.0", "frequency_Hz = 0.0", "greater-than load.disturbance"),
        ("bearing", 'force = "cells"', 'force = "sells"', "unknown-choice magnet[1].kind"),
        ("stage", "bias_force_N = 5.0", "bias_force_N = -5.0", "greater-than control.bias_N"),
        ("stage", "position_noise_m = 0.5e-9", "position_noise_m = -1.0", "greater-than-equal"),
        ("stage", "crossover_Hz = 130.0", "crossover_Hz = 0.0", "greater-than control"),
        ("stage", "stray_m = 18e-6", "stray_m = -18e-6", "greater-than-equal frame.stray_m"),
        ("stage", "cruise_s = 0.05", "cruise_s = 0.0", "greater-than case[1].cruise_s"),
        ("stage", "gap_zero_m = 3e-6", "gap_zero_m = -3e-6", "greater-than-equal spread"),
        ("force", "rate_Hz = 1000.0", "rate_Hz = 3.0", "greater-than-equal timing.rate_Hz"),
        ("force", "current_max_A = 1.2", "current_max_A = 0.0", "greater-than amplifier[1]"),
        ("force", "shunt_offset_A = 0.004", "shunt_offset_A = nan", "finite-number sensor[2]"),
        ("force", "noise_m = 0.4e-6", "noise_m = -0.4e-6", "greater-than-equal sensor[1].noise_m"),
        ("force", "positions_m = [1.0e-3", "positions_m = [0.0", "greater-than case[4].gaps_m[1]"),
        ("force", "low = 0.30", "low = -0.3", "greater-than-equal case[2].low"),
        ("force", "high_m = 2.8e-3", "high_m = -1.0", "greater-than case[3].high_m"),
        ("force", 'solenoid = "solenoid.toml"', "solenoid = 3", "string-type magnet[1].file"),
        ("piezo", "rate_Hz = 10000.0", "rate_Hz = 10.0", "greater-than-equal timing.rate_Hz"),
        ("piezo", "damping_ratio = 0.03", "damping_ratio = 0.0", "greater-than body[1]"),
        ("piezo", "corner_s = 4.2e-3", "corner_s = 0.0", "greater-than case[1].corner_s"),
    ],
)  # fmt: skip
def test_errors_in_an_old_file_name_its_own_line(
    name: str, old: str, new: str, what: str, tmp_path: Path
) -> None:
    path = changed(name, tmp_path, (old, new))
    text = path.read_text(encoding="utf-8")
    line = 1 + text[: text.index(new)].count("\n")
    code, _, key = what.partition(" ")
    with pytest.warns(RenamedWarning), pytest.raises(InputError) as caught:
        read_rig_file(path, RIGS)
    assert caught.value.code == code
    assert str(caught.value).startswith(f"{path}:{line}: {key}")


def test_a_rule_of_its_kind_names_the_line_too(tmp_path: Path) -> None:
    path = changed("piezo", tmp_path, ("[reference]", "[excite]\noperating_N = 3.0\n[reference]"))
    line = path.read_text(encoding="utf-8").splitlines().index("[excite]") + 1
    with pytest.warns(RenamedWarning), refused(f"not-for-this-kind excite: rig.toml:{line}:"):
        read_rig_file(path, RIGS)


def places(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Where something stands in a file."""
    if path:
        yield path
    pairs = value.items() if isinstance(value, dict) else enumerate(value)
    for key, one in pairs:
        if isinstance(one, dict) or isinstance(value, dict):
            yield from places(one, (*path, key)) if isinstance(one, dict | list) else [(*path, key)]


@pytest.mark.first(1)
@every
def test_nonsense_in_an_old_file_is_an_error_of_the_file(name: str, tmp_path: Path) -> None:
    """Whatever stands in place of a key or a table, the program does not break over it."""
    whole, path = tomllib.loads(text_of(name)), tmp_path / "rig.toml"
    for *way, last in places(whole):
        nonsense: Any
        for nonsense in (None, 3, [], {}, [{}]):
            content = copy.deepcopy(whole)
            table: Any = content
            for key in way:
                table = table[key]
            if nonsense is None:
                del table[last]
            else:
                table[last] = nonsense
            lines = [f"{toml_key(key)} = {toml_value(value)}" for key, value in content.items()]
            path.write_text("\n".join(lines) + "\n", encoding="utf-8")
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                try:
                    read_rig_file(path, RIGS)
                except InputError:
                    pass
                except Exception as error:
                    pytest.fail(f"{way} {last} = {nonsense}: {error!r}")


def test_what_is_no_rig_is_not_written_as_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = changed("piezo", tmp_path)
    for out, what in (("new.csv", "unknown-format"), ("rig.toml", "writes-over-input: rig.toml")):
        assert main(["convert", str(path), str(tmp_path / out)]) == 2
        assert says(capsys.readouterr().err, what)
    assert path.read_text(encoding="utf-8") == text_of("piezo")
