"""Test that a cached bench opens fast and is never outdated."""

from __future__ import annotations

from pathlib import Path

import pytest

from anhyst.support.atomic import cache_folder
from anhyst_rigs.study import bench
from anhyst_rigs.study.bench import MAX_CACHED_BENCHES, prepare_cached
from anhyst_rigs.study.excite.excite import excite
from anhyst_rigs.study.prepared_benches import PreparedForce
from tests.study.measured_rigs import measured_rig

ONE_GAP = """
[excite]
gaps_m = [1.0e-3]
"""


@pytest.fixture
def rig(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A rig with one gap and a separate cache."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    path = measured_rig("solenoid", tmp_path / "rig", extra_lines=ONE_GAP, law="play-cells").path
    excite(path, path.with_name("loops.csv"))
    return path


class Again(Exception):  # noqa: N818 - nothing went wrong
    """The bench is prepared again."""


@pytest.mark.slow
def test_unchanged_files_are_prepared_once(rig: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with prepare_cached(rig, None) as first:
        assert isinstance(first, PreparedForce)
    assert not first.program.firmware.exists()  # it was built in a folder that no longer exists

    def again(*given: object) -> None:
        raise Again

    monkeypatch.setattr(bench, "prepare_bench", again)
    with prepare_cached(rig, None) as second:
        assert isinstance(second, PreparedForce)
        assert second.program.block.words.tolist() == first.program.block.words.tolist()
        assert second.program.firmware.is_relative_to(cache_folder("benches"))
        opened = second.open()
    opened.advance(50)
    opened.close()
    (place,) = cache_folder("benches").iterdir()
    assert place.stat().st_mode & 0o077 == 0 or cache_folder("benches").stat().st_mode & 0o077 == 0

    for changed in ("rig.toml", "solenoid.toml", "loops.csv", "loops.toml"):
        file = rig.with_name(changed)
        text = file.read_text(encoding="utf-8")
        file.write_text(f"{text}\n" if changed != "loops.csv" else text[:-1], encoding="utf-8")
        with pytest.raises(Again), prepare_cached(rig, None):
            pass
        file.write_text(text, encoding="utf-8")
    with prepare_cached(rig, None):
        pass

    pickled = place / "prepared.pickle"
    pickled.write_bytes(pickled.read_bytes()[:-100])  # a truncated file is invalid
    with pytest.raises(Again), prepare_cached(rig, None):
        pass


@pytest.mark.slow
def test_an_unwritable_cache_is_ignored_and_a_full_one_evicts(
    rig: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "cache").write_text("no folder")
    with prepare_cached(rig, None) as prepared:
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "other"))
        for number in range(MAX_CACHED_BENCHES + 3):
            bench._store_prepared(prepared, cache_folder("benches") / str(number))
    assert len(list(cache_folder("benches").iterdir())) == MAX_CACHED_BENCHES
