"""The C tests: built with and without sanitizers, and run."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.once import made_once

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]

pytestmark = pytest.mark.depends(
    *("CMakeLists.txt", "core", "plant", "firmware", "tests/core", "tests/firmware")
)


def program_names() -> list[str]:
    return [file.stem for file in sorted(HERE.glob("test_*.c"))]


def tool(*names: str) -> str:
    """Return the first of these programs that is there, else skip."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}"
    for name in names:
        if found := shutil.which(name, path=path):
            return found
    pytest.skip(f"{names[0]} is not installed")


def quietly(*command: str) -> None:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{' '.join(command)}\n{done.stdout}{done.stderr}"


def can_sanitize(compiler: str, folder: Path) -> bool:
    """Tell whether the compiler's sanitizers are installed: they are packages of their own."""
    source = folder / "probe.c"
    source.write_text("int main(void) { return 0; }\n", encoding="utf-8")
    command = [compiler, "-fsanitize=address,undefined", str(source), "-o", str(folder / "probe")]
    return subprocess.run(command, capture_output=True, check=False).returncode == 0


# Sanitizers look for what is wrong in the sources, whatever the machine.
BUILDS = [
    "cc",
    pytest.param("cc-sanitized", marks=[pytest.mark.slow, pytest.mark.campaign]),
    pytest.param("clang-sanitized", marks=[pytest.mark.slow, pytest.mark.needs("clang")]),
]


@pytest.fixture(scope="session", params=BUILDS)
def programs(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the C tests, built by one compiler in one way; warnings are errors."""
    way: str = request.param
    build = made_once(tmp_path_factory, f"core-{way}", lambda folder: build_tests(folder, way))
    return build / "tests" / "core"


def build_tests(build: Path, way: str) -> None:
    kind, _, sanitized = way.partition("-")
    compiler = "clang" if kind == "clang" else tool("cc", "gcc")
    if sanitized and not can_sanitize(compiler, build):
        pytest.skip(f"{compiler} has no sanitizers here")
    cmake = tool("cmake")
    settings = [
        "-DANHYST_TESTS=ON",
        f"-DANHYST_SANITIZE={'ON' if sanitized else 'OFF'}",
        f"-DCMAKE_C_COMPILER={compiler}",
    ]
    quietly(cmake, "-S", str(ROOT), "-B", str(build), *settings)
    quietly(cmake, "--build", str(build), "--parallel", "2")


# Every pair of numbers of 16 bits, and millions of drawn ones: seconds each.
SWEEPS = {"test_branch", "test_fixed_q15", "test_operator", "test_play_at_rest", "test_round_trip"}


@pytest.mark.parametrize(
    "name", [pytest.param(one, marks=[pytest.mark.slow] * (one in SWEEPS)) for one in program_names()]
)
def test_claims_of_the_core_hold(programs: Path, name: str) -> None:
    completed = subprocess.run([programs / name], capture_output=True, text=True, check=False, timeout=600)
    lines = (completed.stdout + completed.stderr).splitlines()
    broken = [line for line in lines if not line.lstrip().startswith("ok ")]
    assert completed.returncode == 0, "\n".join(broken[:40])


@pytest.mark.parametrize("flag", ["-ffast-math", "-ffinite-math-only"])
def test_single_precision_refuses_to_be_compiled_without_nan(flag: str, tmp_path: Path) -> None:
    core = ROOT / "core"
    reads = [f"-I{core / part}" for part in ("include", "src")]
    for source in sorted((core / "src").glob("*/*_f32.c")):
        command = [tool("cc", "gcc"), "-std=c99", "-O1", flag, *reads, "-c", str(source)]
        completed = subprocess.run(
            [*command, "-o", str(tmp_path / "o")], capture_output=True, text=True, check=False
        )
        assert completed.returncode != 0, source.name
        assert "-ffast-math and -ffinite-math-only" in completed.stderr, source.name


@pytest.mark.slow
def test_jiles_atherton_does_not_creep_in_ten_million_ticks(programs: Path) -> None:
    if "sanitized" in programs.parents[1].name:
        return
    command = [str(programs / "test_full_formats"), "10000000"]
    completed = subprocess.run(command, capture_output=True, text=True, check=False, timeout=600)
    assert completed.returncode == 0, completed.stdout + completed.stderr


# What core and plant may take from a C library: no heap, no input or output, no clock, and only
# functions that are exact, so that every library gives the same bits.
EXACT = {"sqrt", "sqrtf", "floor", "memcpy", "memset", "memmove"}
COMPILER = {"_GLOBAL_OFFSET_TABLE_", "__cpu_model", "__cpu_indicator_init"}


@pytest.mark.parametrize("part", ["core", "plant"])
def test_core_and_plant_have_no_heap_no_globals_no_clock_and_no_output(programs: Path, part: str) -> None:
    if "sanitized" in programs.parents[1].name:
        return  # the sanitizers bring their own
    library = programs.parents[1] / f"libanhyst_{part}.a"
    command = [tool("nm"), "--format=sysv", str(library)]
    listing = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    rows = [[field.strip() for field in line.split("|")] for line in listing.splitlines()]
    symbols = [(row[2], row[0], row[6]) for row in rows if len(row) == 7]
    expected = {name for kind, name, _ in symbols if kind == "U" and not name.startswith("anhyst_")}
    writable = {
        name
        for kind, name, section in symbols
        # Constants that hold addresses are filled in by the loader, then nobody may write to them.
        if kind in set("BbCDdGgSs") and not section.startswith(".data.rel.ro")
    }
    assert symbols
    assert expected <= EXACT | COMPILER
    assert writable == set()


def test_sanitizers_are_really_on(programs: Path) -> None:
    binary = (programs / "test_solver").read_bytes()
    sanitized = "sanitized" in programs.parents[1].name
    assert (b"__asan_init" in binary) == sanitized
    assert (b"__ubsan_handle" in binary) == sanitized
