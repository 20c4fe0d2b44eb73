"""Cached C objects: compiled once, never stale, and with their compiler warnings."""

from __future__ import annotations

import subprocess
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from anhyst.support.atomic import cache_folder
from anhyst.support.cache import compile_and_link

pytestmark = pytest.mark.needs("gcc")


@dataclass
class Bench:
    """Two sources and a header, and a count of compilations."""

    folder: Path
    compiled: list[str] = field(default_factory=list)

    def run(self, command: Sequence[str]) -> str:
        self.compiled += [Path(command[-3]).name for one in command if one == "-c"]
        return subprocess.run(command, capture_output=True, text=True, check=True).stderr

    def answer(self, *macros: str, options: Sequence[str] = ("-O1", "-Wall")) -> tuple[int, str]:
        """Build and run the program; return its exit code and the compiler warnings."""
        self.compiled.clear()
        search = [*(f"-D{one}" for one in macros), f"-I{self.folder}"]
        sources, out = sorted(self.folder.glob("*.c")), str(self.folder / "program")
        message = compile_and_link(["gcc"], options, search, sources, ["-o", out], self.run)
        return subprocess.run([out], check=False).returncode, "".join(message)


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Bench:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    folder = tmp_path / "c"
    folder.mkdir()
    (folder / "part.h").write_text("#define ANSWER 3\nint part(void);\n")
    (folder / "part.c").write_text('#include "part.h"\nint part(void) { int unused; return ANSWER; }\n')
    (folder / "main.c").write_text("int part(void);\nint main(void) { return part(); }\n")
    return Bench(folder)


def test_cached_objects_are_linked_and_their_warnings_repeated(bench: Bench) -> None:
    code, message = bench.answer()
    assert (code, sorted(bench.compiled)) == (3, ["main.c", "part.c"])
    assert "unused" in message
    assert bench.answer("NOBODY_ASKS=1") == (code, message)
    assert bench.compiled == []


def test_a_changed_header_macro_or_option_is_recompiled(bench: Bench) -> None:
    bench.answer()
    (bench.folder / "part.h").write_text("#define ANSWER 5\nint part(void);\n")
    assert bench.answer()[0] == 5
    assert bench.compiled == ["part.c"]
    assert bench.answer("part=other")[0] == 5
    assert sorted(bench.compiled) == ["main.c", "part.c"]
    assert bench.answer(options=["-O0"])[0] == 5
    assert sorted(bench.compiled) == ["main.c", "part.c"]


def test_without_a_cache_it_is_compiled_each_time(bench: Bench) -> None:
    cache_folder("objects").parent.mkdir(parents=True)
    cache_folder("objects").write_text("in the way")
    for _ in range(2):
        assert bench.answer()[0] == 3
        assert sorted(bench.compiled) == ["main.c", "part.c"]
