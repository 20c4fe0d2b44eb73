"""The C tests: built for both number formats, with and without sanitizers, and run."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]


def program_names() -> list[str]:
    names = []
    for file in sorted(HERE.glob("test_*.c")):
        single = file.stem.endswith("_f64")
        names += [file.stem] if single else [f"{file.stem}_f64", f"{file.stem}_f32"]
    return names


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


@pytest.fixture(scope="session", params=["cc", "cc-sanitized", "clang-sanitized"])
def programs(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the C tests, built by one compiler in one way; warnings are errors."""
    build = tmp_path_factory.mktemp(request.param)
    compiler, _, sanitized = request.param.partition("-")
    options = [f"-DANHYST_SANITIZE={'ON' if sanitized else 'OFF'}"]
    if compiler == "clang":
        options.append(f"-DCMAKE_C_COMPILER={tool('clang', 'clang-19', 'clang-16', 'clang-14')}")
    cmake = tool("cmake")
    settings = ["-DANHYST_PYTHON=OFF", "-DANHYST_TESTS=ON", *options]
    quietly(cmake, "-S", str(ROOT), "-B", str(build), *settings)
    quietly(cmake, "--build", str(build), "--parallel", "2")
    return build / "tests" / "core"


@pytest.mark.parametrize("name", program_names())
def test_claims_of_the_core_hold(programs: Path, name: str) -> None:
    done = subprocess.run(
        [programs / name], capture_output=True, text=True, check=False, timeout=120
    )
    lines = (done.stdout + done.stderr).splitlines()
    broken = [line for line in lines if not line.lstrip().startswith("ok ")]
    assert done.returncode == 0, "\n".join(broken[:40])


def test_sanitizers_are_really_on(programs: Path) -> None:
    binary = (programs / "test_solver_f64").read_bytes()
    sanitized = programs.parents[1].name.startswith(("cc-sanitized", "clang-sanitized"))
    assert (b"__asan_init" in binary) == sanitized
    assert (b"__ubsan_handle" in binary) == sanitized
