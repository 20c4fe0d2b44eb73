"""Run the C tests of the firmware, built by two compilers, with and without sanitizers."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import NamedTuple

import pytest

from tests.core.test_c_core import BUILDS
from tests.once import made_once

from .build import FIRMWARE_SOURCES, HERE, POSITION_SOURCES, SANITIZERS, can_compile, compile_c, tool

pytestmark = pytest.mark.depends("core", "firmware", "tests/core", "tests/firmware")

TEST_PROGRAMS = [file.stem for file in sorted(HERE.glob("test_*.c"))]
BENCH_SOURCES = [HERE / "bench.c", HERE / "fake_compensator.c"]


@pytest.fixture(scope="module", params=BUILDS)
def programs(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the C tests, built by one compiler with one set of options."""
    build_name: str = request.param
    return made_once(
        tmp_path_factory, f"firmware-{build_name}", lambda folder: build_tests(folder, build_name)
    )


def build_tests(folder: Path, build_name: str) -> None:
    kind, _, sanitizer_mark = build_name.partition("-")
    compiler = "clang" if kind == "clang" else tool("cc", "gcc")
    options = SANITIZERS if sanitizer_mark else []
    if not can_compile(compiler, folder, *options):
        pytest.skip(f"{compiler} has no sanitizers here: apt install libclang-rt-dev")
    completed = compile_c(compiler, [*BENCH_SOURCES, *FIRMWARE_SOURCES], folder, "-c", *options)
    assert completed.returncode == 0, completed.stderr
    objects = sorted(folder.glob("*.o"))
    for name in TEST_PROGRAMS:
        completed = compile_c(compiler, [HERE / f"{name}.c", *objects], folder / name, *options)
        assert completed.returncode == 0, completed.stderr


@pytest.mark.parametrize("name", TEST_PROGRAMS)
def test_claims_of_the_firmware_hold(programs: Path, name: str) -> None:
    completed = subprocess.run([programs / name], capture_output=True, text=True, check=False, timeout=600)
    assert completed.returncode == 0, completed.stdout + completed.stderr


# Allowed functions of the C library. A small controller may not have any other function.
ALLOWED_LIBRARY_FUNCTIONS = {"memcpy", "memset", "memmove", "_GLOBAL_OFFSET_TABLE_"}


class Symbols(NamedTuple):
    """Symbols of compiled sources."""

    undefined_names: set[str]  # undefined symbols, resolved elsewhere
    writable_objects: set[str]  # writable objects of static lifetime


def symbols(sources: list[Path], folder: Path) -> Symbols:
    defined_symbols: set[str] = set()
    undefined_symbols: set[str] = set()
    writable: set[str] = set()
    # Without -fno-pie, constant tables of functions would count as writable, because a loader fills
    # them.
    completed = compile_c(tool("cc", "gcc"), sources, folder, "-c", "-fno-pie")
    assert completed.returncode == 0, completed.stderr
    for compiled in folder.glob("*.o"):
        listing = subprocess.run([tool("nm"), compiled], capture_output=True, text=True, check=True)
        for line in listing.stdout.splitlines():
            *_, kind, name = line.split()
            (undefined_symbols if kind == "U" else defined_symbols).add(name)
            writable |= {name} if kind in "BbCDdGgSs" else set()
    return Symbols(undefined_symbols - defined_symbols, writable)


@pytest.mark.parametrize("sources", [FIRMWARE_SOURCES, POSITION_SOURCES], ids=["force", "position"])
def test_all_that_a_controller_remembers_is_in_the_memory_it_is_given(
    tmp_path: Path, sources: list[Path]
) -> None:
    """There is no heap and no writable static object. The port provides all other functions."""
    found = symbols(sources, tmp_path)
    assert {
        name for name in found.undefined_names if not name.startswith("anhyst_")
    } <= ALLOWED_LIBRARY_FUNCTIONS
    assert found.writable_objects == set()


@pytest.mark.parametrize("start", ["", " = 1"])
def test_a_static_object_in_a_source_is_seen(tmp_path: Path, start: str) -> None:
    source = tmp_path / "counts.c"
    source.write_text(
        f"int ticks(void);\nint ticks(void)\n{{\n  static int count{start};\n  return count++;\n}}\n",
        encoding="utf-8",
    )
    assert {name.partition(".")[0] for name in symbols([source], tmp_path).writable_objects} == {"count"}
