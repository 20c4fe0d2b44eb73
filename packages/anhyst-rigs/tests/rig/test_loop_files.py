"""Test loops that a rig file names and that are identified once."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

from anhyst.identification.run import IdentifyTable
from anhyst.laws import LAWS
from anhyst_rigs.rig import measurement_table
from anhyst_rigs.rig.measurement_table import identify_loops
from anhyst_rigs.rig.piezo import read_piezo_rig
from anhyst_rigs.rig.stage.file import read_stage
from anhyst_rigs.study import fleet_magnets, piezo
from anhyst_rigs.study.fleet_magnets import FleetSettings, FleetTask, Member
from tests.study import bearings, stages


def test_an_interrupted_search_is_neither_used_nor_cached(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    loops = read_stage(stages.EXAMPLE / "rig.toml").measured_loops.read()
    half = SimpleNamespace(interrupted=True, model=bearings.knowledge().model)
    monkeypatch.setattr(measurement_table, "identify", lambda *_, **__: half)
    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            identify_loops(loops, IdentifyTable(), "circuit")
    half.interrupted = False
    assert identify_loops(loops, IdentifyTable(), "circuit").name == half.model.name


def test_with_a_registered_law_the_cache_is_not_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    loops = read_stage(stages.EXAMPLE / "rig.toml").measured_loops.read()
    found = SimpleNamespace(interrupted=False, model=bearings.knowledge().model)
    calls: list[object] = []

    def counted(*given: object, **_: object) -> SimpleNamespace:
        calls.append(given)
        return found

    monkeypatch.setattr(measurement_table, "identify", counted)
    for _ in range(2):
        identify_loops(loops, IdentifyTable(), "circuit")
    assert len(calls) == 1
    monkeypatch.setitem(LAWS.plugins, "mine", LAWS["effective-field"])
    for _ in range(2):
        identify_loops(loops, IdentifyTable(), "circuit")
    assert len(calls) == 3


def test_no_magnet_of_a_fleet_and_no_piezo_is_judged_by_half_a_search(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    half = SimpleNamespace(interrupted=True, model=bearings.knowledge().model)
    for module in (fleet_magnets, piezo):
        monkeypatch.setattr(module, "identify", lambda *_, **__: half)
    member = Member("one", stages.EXAMPLE / "loops.csv")
    with pytest.raises(KeyboardInterrupt):
        fleet_magnets.identify_member(FleetTask(member, FleetSettings(20e3), tmp_path, ("auto", "auto")))
    with pytest.raises(KeyboardInterrupt):
        piezo.find_inverses(read_piezo_rig(stages.EXAMPLE.parent / "piezo" / "rig.toml"))
