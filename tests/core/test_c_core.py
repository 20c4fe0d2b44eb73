"""Build the C tests with and without sanitizers, and run them."""

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
    """Return the first of these programs that is installed; skip the test if none is."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}"
    for name in names:
        if found := shutil.which(name, path=path):
            return found
    pytest.skip(f"{names[0]} is not installed")


def run_command(*command: str) -> None:
    completed = subprocess.run(command, capture_output=True, text=True, check=False)
    assert completed.returncode == 0, f"{' '.join(command)}\n{completed.stdout}{completed.stderr}"


def can_sanitize(compiler: str, folder: Path) -> bool:
    """Whether the compiler's sanitizers are installed, which are separate packages."""
    source = folder / "probe.c"
    source.write_text("int main(void) { return 0; }\n", encoding="utf-8")
    command = [compiler, "-fsanitize=address,undefined", str(source), "-o", str(folder / "probe")]
    return subprocess.run(command, capture_output=True, check=False).returncode == 0


# Builds of the C tests. Sanitizers find faults of the sources that no machine shows otherwise.
BUILDS = [
    "cc",
    pytest.param("cc-sanitized", marks=[pytest.mark.slow, pytest.mark.campaign]),
    pytest.param("clang-sanitized", marks=[pytest.mark.slow, pytest.mark.needs("clang")]),
]


@pytest.fixture(scope="session", params=BUILDS)
def programs(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the C tests, built by one compiler with one set of options; warnings are errors."""
    build_name: str = request.param
    build = made_once(tmp_path_factory, f"core-{build_name}", lambda folder: build_tests(folder, build_name))
    return build / "tests" / "core"


def build_tests(build: Path, build_name: str) -> None:
    kind, _, sanitized = build_name.partition("-")
    compiler = "clang" if kind == "clang" else tool("cc", "gcc")
    if sanitized and not can_sanitize(compiler, build):
        pytest.skip(f"{compiler} has no sanitizers here")
    cmake = tool("cmake")
    settings = [
        "-DANHYST_TESTS=ON",
        f"-DANHYST_SANITIZE={'ON' if sanitized else 'OFF'}",
        f"-DCMAKE_C_COMPILER={compiler}",
    ]
    run_command(cmake, "-S", str(ROOT), "-B", str(build), *settings)
    run_command(cmake, "--build", str(build), "--parallel", "2")


# Tests of every pair of 16-bit numbers and of millions of random numbers; each takes seconds.
LONG_TESTS = {"test_branch", "test_fixed_q15", "test_operator", "test_play_at_rest", "test_round_trip"}


@pytest.mark.parametrize(
    "name", [pytest.param(one, marks=[pytest.mark.slow] * (one in LONG_TESTS)) for one in program_names()]
)
def test_claims_of_the_core_hold(programs: Path, name: str) -> None:
    completed = subprocess.run([programs / name], capture_output=True, text=True, check=False, timeout=600)
    lines = (completed.stdout + completed.stderr).splitlines()
    failed_claims = [line for line in lines if not line.lstrip().startswith("ok ")]
    assert completed.returncode == 0, "\n".join(failed_claims[:40])


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


# What core and plant may use of a C library: no heap, no input or output, no clock, and only exact
# functions, so that every library gives the same bits.
ALLOWED_FUNCTIONS = {"sqrt", "sqrtf", "floor", "memcpy", "memset", "memmove"}
COMPILER = {"_GLOBAL_OFFSET_TABLE_", "__cpu_model", "__cpu_indicator_init"}


@pytest.mark.parametrize("folder", ["core", "plant"])
def test_core_and_plant_have_no_heap_no_globals_no_clock_and_no_output(programs: Path, folder: str) -> None:
    if "sanitized" in programs.parents[1].name:
        return  # the sanitizers need their own functions
    library = programs.parents[1] / f"libanhyst_{folder}.a"
    command = [tool("nm"), "--format=sysv", str(library)]
    listing = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    rows = [[field.strip() for field in line.split("|")] for line in listing.splitlines()]
    symbols = [(row[2], row[0], row[6]) for row in rows if len(row) == 7]
    expected = {name for kind, name, _ in symbols if kind == "U" and not name.startswith("anhyst_")}
    writable = {
        name
        for kind, name, section in symbols
        # The loader writes addresses into these constants. Afterwards, they are read-only.
        if kind in set("BbCDdGgSs") and not section.startswith(".data.rel.ro")
    }
    assert symbols
    assert expected <= ALLOWED_FUNCTIONS | COMPILER
    assert writable == set()


def test_sanitizers_are_really_on(programs: Path) -> None:
    binary = (programs / "test_solver").read_bytes()
    sanitized = "sanitized" in programs.parents[1].name
    assert (b"__asan_init" in binary) == sanitized
    assert (b"__ubsan_handle" in binary) == sanitized
