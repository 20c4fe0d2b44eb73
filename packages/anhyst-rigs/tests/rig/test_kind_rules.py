"""Test the rules of each kind of rig: missing, superfluous and unknown tables, keys and names."""

from __future__ import annotations

import copy
import tomllib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from anhyst.support.kinds import file_kind
from anhyst.support.toml_text import toml_key, toml_value
from anhyst_rigs.rig.file import RigFile
from anhyst_rigs.rig.kind_rules import read_rig_file
from anhyst_rigs.rig.parts.magnet import ACTUATORS, ActuatorKind, Poles
from anhyst_rigs.rig.stage.drives import min_single_force, opposing_magnets
from anhyst_rigs.rig.stage.file import read_stage
from anhyst_rigs.study.excite.design import Bound, bearing_specimen
from tests.refusals import refused
from tests.repository import ROOT

EXAMPLES = ROOT / "examples"
FOLDERS = {"bearing": "bearing", "stage": "stage", "force": "solenoid", "piezo": "piezo"}
LISTS = ("magnet", "stack", "amplifier", "body", "sensor", "case")
SINGLE = ("loops", "load", "frame", "measurement", "spread")
Content = dict[str, Any]

READ = {"sensor gap", "sensor current", "sensor force"}
BODY = {"magnet wound", "amplifier of a coil", "body", "loops", "measurement", *READ}
NEEDED = {
    "bearing": BODY | {"load", "case step"},
    "stage": BODY | {"magnet like", "sensor position", "case scan"},
    "force": {"amplifier of a coil", "loops", "case force", "case held", "case moving", *READ},
    "piezo": {"stack", "amplifier stack", "body flexure", "sensor position", "case displacement"},
}
ALLOWED = {
    "bearing": {
        *("sensor flux", "case load", "case triangle", "magnet like"),
        *("excite", "spread", "seed", "noise_seeds"),
    },
    "stage": {"sensor flux", "excite", "frame", "spread", "seed", "noise_seeds"},
    "force": {"magnet wound", "magnet solenoid", "excite", "spread", "seed"},
    "piezo": {"spread", "seed"},
}
"""Optional tables."""


def example(kind: str) -> Content:
    path = EXAMPLES / FOLDERS[kind] / "rig.toml"
    return tomllib.loads(path.read_text(encoding="utf-8"))


def called(key: str, table: Content) -> str:
    """Return the name that these tests use for one table of an array of tables."""
    if key == "magnet":
        return "magnet like" if "like" in table else f"magnet {KINDS[table['kind']]}"
    if key == "amplifier":
        return "amplifier stack" if table.get("mode") == "stack" else "amplifier of a coil"
    if key == "body":
        return "body flexure" if "resonance_Hz" in table else "body"
    return f"{key} {table['of' if key == 'sensor' else 'kind']}" if key != "stack" else key


KINDS = {"electromagnet": "wound", "solenoid": "solenoid"}


def samples() -> dict[str, tuple[str, Any]]:
    """Return an example of each table of any rig, and the key of its list."""
    found: dict[str, tuple[str, Any]] = {
        "excite": ("excite", {"operating_N": 10.0}),
        "seed": ("seed", 3),
        "noise_seeds": ("noise_seeds", 3),
    }
    for kind in FOLDERS:
        content = example(kind)
        for key in LISTS:
            for table in content.get(key, []):
                found.setdefault(called(key, table), (key, table))
        found |= {key: (key, content[key]) for key in SINGLE if key in content}
    return found


SAMPLES = samples()


def read(folder: Path, content: Content) -> RigFile:
    lines = [f"{toml_key(key)} = {toml_value(value)}" for key, value in content.items()]
    path = folder / "rig.toml"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return read_rig_file(path, file_kind(path).word)


def table_of(content: Content, name: str) -> tuple[str, Any]:
    """Return a table of a rig, and its position as in messages."""
    for key in LISTS:
        for number, table in enumerate(content.get(key, []), 1):
            if called(key, table) == name:
                return f"{key}[{number}]", table
    return name, content.setdefault(name, {})


def cells(of: dict[str, set[str]]) -> list[tuple[str, str]]:
    return [(kind, name) for kind, names in of.items() for name in sorted(names)]


FOREIGN = {kind: set(SAMPLES) - NEEDED[kind] - ALLOWED[kind] for kind in FOLDERS}
FOREIGN["force"].remove("magnet like")  # exactly one magnet is required, see below


SEVERAL = {("force", "case force"), ("stage", "magnet like"), ("stage", "sensor position")}


def test_every_table_has_its_sample() -> None:
    names = {name for of in (NEEDED, ALLOWED) for kind in of.values() for name in kind}
    assert names == set(SAMPLES)


@pytest.mark.parametrize("kind", FOLDERS)
def test_the_bundled_rigs_are_whole(kind: str, tmp_path: Path) -> None:
    assert read(tmp_path, example(kind)).kind.word == example(kind)["control"]["kind"]


@pytest.mark.parametrize(("kind", "name"), cells(FOREIGN))
def test_a_table_of_another_kind_is_refused_with_its_location(kind: str, name: str, tmp_path: Path) -> None:
    content, (key, table) = example(kind), SAMPLES[name]
    if key in LISTS:
        content[key] = [*content.get(key, []), table]
        place = f"{key}[{len(content[key])}]"
    else:
        content[key], place = table, key
    with refused(f"not-for-this-kind {place}: does not use"):
        read(tmp_path, content)


@pytest.mark.parametrize(("kind", "name"), cells(NEEDED))
def test_missing_tables_of_a_kind_are_reported(kind: str, name: str, tmp_path: Path) -> None:
    content, (key, _) = example(kind), SAMPLES[name]
    if key in LISTS:
        content[key] = [table for table in content[key] if called(key, table) != name]
        if not content[key]:
            del content[key]
    else:
        del content[key]
    with refused(f"missing {key}"):
        read(tmp_path, content)


@pytest.mark.parametrize(
    ("kind", "name"), [(kind, name) for kind, name in cells(NEEDED) if SAMPLES[name][0] in LISTS]
)
def test_repeated_tables_of_a_kind_are_refused(kind: str, name: str, tmp_path: Path) -> None:
    """There may be several forces, magnets and position sensors, and only one of all others."""
    content = example(kind)
    place, table = table_of(content, name)
    key = place.partition("[")[0]
    content[key] = [*content[key], table]
    if (kind, name) in SEVERAL:
        content[key][-1] = {**table, "name": "another"} if "name" in table else table
        read(tmp_path, content)
        return
    with refused(f"not-for-this-kind {key}[{len(content[key])}]: has only one of them"):
        read(tmp_path, content)


@pytest.mark.parametrize(
    ("kind", "name", "keys"),
    [
        ("bearing", "amplifier of a coil", {"slew_A_per_s": 1.0}),
        ("bearing", "sensor current", {"offset_A": 0.1}),
        ("bearing", "spread", {"current_percent": 1.0}),
        ("bearing", "spread", {"hall_percent": 1.0}),
        ("bearing", "spread", {"eddy_s": 1e-6}),
        ("stage", "amplifier of a coil", {"slew_A_per_s": 1.0}),
        ("stage", "sensor current", {"offset_A": 0.1}),
        ("stage", "sensor position", {"step_m": 1e-9}),
        ("stage", "spread", {"mass_percent": 1.0}),
        ("stage", "spread", {"saturation_percent": 1.0}),
        ("stage", "spread", {"stroke_percent": 1.0}),
        ("force", "spread", {"mass_percent": 1.0}),
        ("piezo", "spread", {"gap_zero_m": 1e-6}),
        ("force", "timing", {"substeps": 4}),
        ("force", "timing", {"delay_ticks": 1.0}),
        ("force", "amplifier of a coil", {"mode": "current"}),
        ("force", "amplifier of a coil", {"supply_V": 24.0}),
        ("force", "amplifier of a coil", {"current_low_A": 0.0}),
        ("force", "amplifier of a coil", {"delay_s": 1e-4}),
        ("force", "sensor gap", {"delay_s": 1e-4}),
        ("force", "sensor gap", {"offset_m": 1e-6}),
        ("force", "sensor current", {"gain_error": 0.1}),
        ("piezo", "timing", {"substeps": 4}),
        ("piezo", "timing", {"delay_ticks": 1.0}),
    ],
)
def test_a_key_without_a_use_is_refused(kind: str, name: str, keys: Content, tmp_path: Path) -> None:
    content = example(kind)
    place, table = table_of(content, name)
    table.update(keys)
    with refused(f"not-for-this-kind {place}.{next(iter(keys))}: does not use it"):
        read(tmp_path, content)


@pytest.mark.parametrize(
    ("kind", "name", "key"),
    [
        ("bearing", "magnet wound", "gap_m"),
        ("bearing", "amplifier of a coil", "supply_V"),
        ("stage", "magnet wound", "gap_m"),
        ("stage", "amplifier of a coil", "supply_V"),
        ("force", "amplifier of a coil", "slew_A_per_s"),
        ("piezo", "sensor position", "step_m"),
    ],
)
def test_a_key_that_others_may_leave_out_is_asked_for(kind: str, name: str, key: str, tmp_path: Path) -> None:
    content = example(kind)
    place, table = table_of(content, name)
    del table[key]
    with refused(f"missing {place}.{key}: needs it"):
        read(tmp_path, content)


def wound(content: Content, **more: Any) -> Content:
    """Return a force-control rig whose magnet is fitted to its loops."""
    magnet = {"name": "magnet", "iron": "from loops", **more}
    return {**content, "magnet": [magnet]}


def test_force_is_controlled_of_one_magnet_of_either_kind(tmp_path: Path) -> None:
    content = example("force")
    assert read(tmp_path, wound(content)).magnet.has_iron_from_loops
    own, (_, like) = content["magnet"], SAMPLES["magnet like"]
    for magnets in ([], [*own, *wound(content)["magnet"]], [*own, like]):
        with refused("one-of-two magnet"):
            read(tmp_path, {**content, "magnet": magnets})
    for key, value in (("gap_m", 1e-3), ("eddy_time_s", 1e-4), ("direction", [-1.0, 0.0, 0.0])):
        with refused(f"not-for-this-kind magnet[1].{key}"):
            read(tmp_path, wound(content, **{key: value}))


@pytest.mark.parametrize(
    ("name", "what"),
    [("core", "name-taken iron[2].name: 'core'"), ("from loops", "string-pattern-mismatch iron[2].name")],
)
def test_irons_have_unique_names(name: str, what: str, tmp_path: Path) -> None:
    content = copy.deepcopy(example("bearing"))
    content["iron"].append({**content["iron"][0], "name": name})
    with refused(what):
        read(tmp_path, content)


@pytest.mark.parametrize(
    ("kind", "name", "key", "what"),
    [
        ("bearing", "case triangle", "amplitude", "unit-missing {}.amplitude: amplitude_m"),
        ("bearing", "case step", "hold", "unit-missing {}.hold: hold_s"),
        ("bearing", "sensor flux", "range", "unit-missing {}.range: range_T"),
        ("stage", "magnet like", "gap", "unit-missing {}.gap: gap_m"),
        ("stage", "magnet like", "turns", "extra-forbidden {}.turns: remove it"),
        ("piezo", "body flexure", "mass_kg", "extra-forbidden {}.mass_kg: remove it"),
        ("stage", "case scan", "slit", "unit-missing {}.slit: slit_s"),
        ("piezo", "amplifier stack", "high", "unit-missing {}.high: high_V"),
        ("piezo", "body flexure", "damping_rato", "extra-forbidden {}.damping_rato: damping_ratio"),
    ],
)
def test_a_misspelt_key_suggests_keys_of_its_own_table(
    kind: str, name: str, key: str, what: str, tmp_path: Path
) -> None:
    content = example(kind)
    place, table = table_of(content, name)
    table[key] = 1.0
    with refused(what.format(place)):
        read(tmp_path, content)


@pytest.mark.parametrize(("kind", "lists"), [("bearing", "[[magnet]]"), ("stage", "[[sensor]]")])
def test_a_misspelt_list_is_named_with_its_first_line(kind: str, lists: str, tmp_path: Path) -> None:
    text = (EXAMPLES / FOLDERS[kind] / "rig.toml").read_text(encoding="utf-8")
    path, wrong = tmp_path / "rig.toml", lists.replace("]]", "s]]")
    path.write_text(text.replace(lists, wrong), encoding="utf-8")
    line = 1 + text[: text.index(lists)].count("\n")
    with refused(f"extra-forbidden {wrong.strip('[]')}: rig.toml:{line}:; {lists.strip('[]')}"):
        read_rig_file(path, file_kind(path).word)


# Bidirectional magnets


@pytest.fixture
def pushing(monkeypatch: pytest.MonkeyPatch) -> Content:
    """Return the planar example with bidirectional actuators."""
    monkeypatch.setitem(
        ACTUATORS.plugins, "coil", ActuatorKind("thrust", {"inductance_H": "of the winding"}, coil)
    )
    path = EXAMPLES / "planar" / "rig.toml"
    content = tomllib.loads(path.read_text(encoding="utf-8"))
    content["magnet"][0] |= {"kind": "coil", "numbers": {"inductance_H": 8e-3}}
    content["control"] = {
        key: value for key, value in content["control"].items() if key not in ("bias_N", "force_min_N")
    } | {"format": "f64"}
    content["amplifier"][0]["current_low_A"] = -4.0
    content["sensor"][1]["low_A"] = -5.0
    return content


def coil(poles: Poles, numbers: Mapping[str, float]) -> Poles:
    return replace(poles, outer=poles.turns**2 / numbers["inductance_H"], bias=1e5)


def test_a_bidirectional_rig_has_no_pairs_and_no_least_force(pushing: Content, tmp_path: Path) -> None:
    file = read(tmp_path, pushing)
    assert file.magnet.is_bidirectional
    assert opposing_magnets(file) == list(range(10))
    assert min_single_force(file) == -file.tracking.force_max_N


@pytest.mark.parametrize(
    ("key", "number", "values", "what"),
    [
        ("control", None, {"bias_N": 5.0}, "pair-only control.bias_N"),
        ("control", None, {"force_min_N": 0.5}, "not-for-this-kind control.force_min_N"),
        ("control", None, {"format": "fixed"}, "not-for-this-kind control.format"),
        ("magnet", 0, {"kind": "electromagnet", "numbers": {}}, "pair-only control.bias_N"),
        ("magnet", 0, {"kind": "spring"}, "unknown-choice magnet[1].kind"),
        ("magnet", 0, {"numbers": {}}, "missing magnet[1]: needs numbers.inductance_H"),
        ("magnet", 0, {"numbers": {"inductance_H": -1.0}}, "greater-than magnet[1].numbers.inductance_H"),
        ("magnet", 0, {"numbers": {"inductance_H": 1e300}}, "no-circuit magnet[1]"),
        ("magnet", 3, {"gap_m": 0.5e-3}, "option-differs magnet[4].gap_m"),
    ],
)
def test_unsuitable_keys_of_a_bidirectional_rig_are_refused(
    pushing: Content, key: str, number: int | None, values: Content, what: str, tmp_path: Path
) -> None:
    table = pushing[key] if number is None else pushing[key][number]
    table.update(values)
    with refused(what):
        read(tmp_path, pushing)


def test_loops_and_instruments_of_a_bidirectional_rig_are_bidirectional(
    pushing: Content, tmp_path: Path
) -> None:
    pushing["sensor"][1] |= {"low_A": -2.0, "high_A": 5.0}
    pushing["sensor"][2]["low_N"] = -10.0
    pushing["amplifier"][0]["current_low_A"] = -1.5
    pushing["body"][0]["mass_kg"] = 0.3  # the magnets are weak
    pushing["measurement"]["records"] = [{"name": "major", "turns": [0.0, 0.2]}]
    (tmp_path / "loops.csv").write_text((EXAMPLES / "planar" / "loops.csv").read_text("utf-8"))
    read(tmp_path, pushing)
    rig = read_stage(tmp_path / "rig.toml")
    specimen = bearing_specimen(rig)
    assert specimen.max_current == Bound(1.5, "amplifier.current_low_A")
    assert specimen.max_force == Bound(9.5, "force_sensor.low_N")
    with refused("columns-missing"):
        rig.measured_loops.read()


def test_turning_points_are_within_the_amplifier_range(tmp_path: Path) -> None:
    content = example("stage")
    content["measurement"]["records"][0]["turns"] = [0.0, 1.0, -0.5]
    (tmp_path / "loops.csv").touch()
    read(tmp_path, content)
    with refused("beyond-amplifier measurement.records"):
        read_stage(tmp_path / "rig.toml")
