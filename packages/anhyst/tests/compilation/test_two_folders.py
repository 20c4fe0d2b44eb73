"""Test several actuators in one program, and compilers that remove checks."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from anhyst.compensate.plan import CompileRequest
from anhyst.compilation.output import compile_model
from tests.compensate.test_solid import LAYERS, RATE, magnet
from tests.repository import ROOT

PROGRAM = """
#include <stdio.h>
#include "{first}_parameters.h"
#include "{second}_parameters.h"
int main(void)
{{
  static anhyst_compensator a, b;
  return anhyst_compensator_init(&a, &THIN_KERNEL, thin_parameters, THIN_PARAMETERS_WORDS) ||
         anhyst_compensator_init(&b, &SOLID_KERNEL, solid_parameters, SOLID_PARAMETERS_WORDS);
}}
"""


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Compile a laminated and a solid core into one folder."""
    place = tmp_path_factory.mktemp("folders")
    model = magnet(LAYERS["two"])
    for name, each in (("thin", model.at_rest), ("solid", model)):
        each.save(place / f"{name}.toml")
        request = CompileRequest("full", "q15", RATE, accuracy=2.0, name=name)
        compile_model(place / f"{name}.toml", place / name, request)
    return place


def compiler() -> str:
    found = shutil.which("cc") or shutil.which("gcc")
    if found is None:
        pytest.skip("a C compiler is not installed")
    return found


ORDERS = [("thin", "solid"), ("solid", "thin")]


@pytest.mark.parametrize(("first", "second"), ORDERS)
def test_make_files_of_thin_and_solid_iron_build_one_program(
    folders: Path, tmp_path: Path, first: str, second: str
) -> None:
    if shutil.which("make") is None:
        pytest.skip("make is not installed")
    (tmp_path / "main.c").write_text(PROGRAM.format(first=first, second=second), encoding="utf-8")
    (tmp_path / "Makefile").write_text(
        f"include {folders}/{first}/anhyst.mk\ninclude {folders}/{second}/anhyst.mk\n"
        f"p: main.c\n\t{compiler()} -std=c99 -Wall -Werror $(ANHYST_CPPFLAGS) main.c "
        "$(ANHYST_SOURCES) -o p\n",
        encoding="utf-8",
    )
    completed = subprocess.run(["make", "-C", tmp_path], capture_output=True, text=True, check=False)
    assert completed.returncode == 0, completed.stderr
    assert subprocess.run([tmp_path / "p"], check=False).returncode == 0


@pytest.mark.parametrize(("first", "second"), ORDERS)
def test_cmake_files_of_thin_and_solid_iron_build_one_program(
    folders: Path, tmp_path: Path, first: str, second: str
) -> None:
    cmake = shutil.which("cmake")
    if cmake is None or shutil.which("make") is None:
        pytest.skip("cmake or make is not installed")
    (tmp_path / "main.c").write_text(PROGRAM.format(first=first, second=second), encoding="utf-8")
    (tmp_path / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.16)\nproject(p C)\n"
        f"include({folders}/{first}/anhyst.cmake)\ninclude({folders}/{second}/anhyst.cmake)\n"
        "add_executable(p main.c)\ntarget_link_libraries(p anhyst)\n",
        encoding="utf-8",
    )
    for command in (
        [cmake, "-S", str(tmp_path), "-B", str(tmp_path / "b")],
        [cmake, "--build", str(tmp_path / "b")],
    ):
        completed = subprocess.run(command, capture_output=True, text=True, check=False)
        assert completed.returncode == 0, completed.stderr + completed.stdout
    assert subprocess.run([tmp_path / "b" / "p"], check=False).returncode == 0


def test_thin_core_before_solid_parameters_does_not_compile(folders: Path, tmp_path: Path) -> None:
    (tmp_path / "main.c").write_text(PROGRAM.format(first="thin", second="solid"), encoding="utf-8")
    include = [f"-I{folders}/{name}/{part}" for name in ("thin", "solid") for part in ("include", "")]
    command = [compiler(), "-std=c99", "-fsyntax-only", *include, str(tmp_path / "main.c")]
    completed = subprocess.run(command, capture_output=True, text=True, check=False)
    assert completed.returncode != 0
    assert "-DANHYST_MEMORIES=2" in completed.stderr


def test_object_files_with_different_memory_counts_are_detected_at_start(
    folders: Path, tmp_path: Path
) -> None:
    (tmp_path / "main.c").write_text(
        '#include "thin_parameters.h"\nint main(void)\n{\n  static anhyst_compensator c;\n'
        "  return anhyst_compensator_init(&c, &THIN_KERNEL, thin_parameters,\n"
        "                                 THIN_PARAMETERS_WORDS) != ANHYST_BAD_SIZE;\n}\n",
        encoding="utf-8",
    )
    solid, objects = folders / "solid", []
    sources = [(path, 2) for path in sorted((solid / "src").rglob("*.c"))]
    sources += [(folders / "thin" / "thin_parameters.c", 1), (tmp_path / "main.c", 1)]
    for number, (source, room) in enumerate(sources):
        objects.append(str(tmp_path / f"{number}.o"))
        include = [f"-I{solid}/include", f"-I{folders}/thin"]
        command = [compiler(), "-std=c99", f"-DANHYST_MEMORIES={room}", *include]
        subprocess.run([*command, "-c", str(source), "-o", objects[-1]], check=True)
    subprocess.run([compiler(), *objects, "-o", str(tmp_path / "p")], check=True)
    assert subprocess.run([tmp_path / "p"], check=False).returncode == 0


@pytest.mark.parametrize("option", ["-ffast-math", "-ffinite-math-only", "-Ofast"])
def test_single_precision_refuses_fast_math(folders: Path, tmp_path: Path, option: str) -> None:
    core = tmp_path / "main.c"
    core.write_text('#include "anhyst/numeric/f32.h"\nint main(void) { return 0; }\n')
    include = ROOT / "core" / "include"
    command = [compiler(), option, "-fsyntax-only", f"-I{include}", str(core)]
    completed = subprocess.run(command, capture_output=True, text=True, check=False)
    assert completed.returncode != 0
    assert "not numbers" in completed.stderr
