"""Packages of ecosystems: their layout, and that each plays the golden vectors bit for bit."""

from __future__ import annotations

import configparser
import json
import os
import re
import shutil
import subprocess
import tomllib
import zipfile
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, get_args
from xml.etree import ElementTree

import kconfiglib
import pytest
import yaml

from anhyst.cli.app import main
from anhyst.cli.compile import PackageName
from anhyst.compensate.plan import CompileRequest
from anhyst.compilation import output, play
from anhyst.compilation.manifest import write_folder
from anhyst.compilation.output import compile_model
from anhyst.compilation.packages import (
    PACKAGES,
    Ecosystem,
    check_package,
    license_text,
    package_files,
)
from anhyst.compilation.play import compile_play
from anhyst.link import firmware
from anhyst.model.writer import write_model
from anhyst.support.atomic import write_files
from anhyst.verification.bundle import read_bundle
from tests.actuators import magnet, ring
from tests.compensate.test_solid import LAYERS, RATE
from tests.compensate.test_solid import magnet as solid_magnet
from tests.compilation.test_compile import WARNINGS, measured
from tests.core.test_c_core import tool
from tests.refusals import refused, says
from tests.truths import path_of

ROOT = Path(__file__).resolve().parents[2]
CONTROLLER = ROOT / "examples" / "bearing" / "controller.toml"
CARGO = shutil.which("cargo", path=f"{os.environ['PATH']}:{Path.home()}/.cargo/bin")
AVR_BOARD = "arduino:avr:mega:cpu=atmega2560"


@dataclass(frozen=True)
class Plain:
    """What a package is made of: the files of a compiled folder, its manifest, its names."""

    files: Mapping[str, str]
    manifest: Mapping[str, Any]
    values: Mapping[str, Any]

    def write(self, package: str, folder: Path) -> Path:
        write_files(folder, package_files(package, self.files, self.manifest, self.values))
        return folder


def recorded(module: Any, compile_: Callable[[], object]) -> Plain:
    """Compile without a package, and keep what a package would be made of."""
    kept: list[Plain] = []

    def keep(package: None, files: Any, manifest: Any, values: Any) -> Any:
        kept.append(Plain(files, dict(manifest), values))
        return files

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "package_files", keep)
        compile_()
    return kept[0]


def _model(place: Path, model: Any) -> Path:
    write_model(model, place / "model.toml")
    return place / "model.toml"


def _cells(place: Path) -> Plain:
    request = CompileRequest("full", "q15", 1e4, accuracy=2.0, name="upper_2")
    return recorded(
        output, lambda: compile_model(path_of("cells-play-cells"), place / "c", request)
    )


def _single(place: Path) -> Plain:
    request = CompileRequest("simplified", "f32", 1e4, accuracy=40.0, name="real")
    file = _model(place, measured(magnet()))
    return recorded(output, lambda: compile_model(file, place / "c", request))


def _ring(place: Path) -> Plain:
    request = CompileRequest("full", "q31", 1e4, accuracy=2.0)
    file = _model(place, measured(ring(), -120.0, 120.0))
    return recorded(output, lambda: compile_model(file, place / "c", request))


def _euler(place: Path) -> Plain:
    request = CompileRequest("euler", "q15", 1e4, accuracy=40.0, name="anhyst_euler")
    file = _model(place, measured(magnet()))
    return recorded(output, lambda: compile_model(file, place / "c", request))


def _play(place: Path) -> Plain:
    file = _model(place, measured(magnet()))
    return recorded(play, lambda: compile_play(file, place / "c", 1e4, "q31", "a"))


def _controller(place: Path) -> Plain:
    request = CompileRequest("full", "q31", 20e3)
    file = path_of("bearing")
    return recorded(output, lambda: compile_model(file, place / "c", request, CONTROLLER))


def _solid(place: Path) -> Plain:
    file = solid_magnet(LAYERS["three and sheets"]).save(place / "model.toml")
    request = CompileRequest("full", "q31", RATE, name="solid")
    return recorded(output, lambda: compile_model(file, place / "c", request))


CASES = {
    "cells": _cells,
    "single": _single,
    "controller": _controller,
    "ring": _ring,
    "euler": _euler,
    "play": _play,
    "solid": _solid,
}
MARKS = dict.fromkeys(("controller", "play", "solid"), pytest.mark.slow)
MARKS |= dict.fromkeys(("ring", "euler"), pytest.mark.campaign)
PARAMS = [pytest.param(one, marks=MARKS.get(one, ())) for one in CASES]


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("packages")


@cache
def plain(place: Path, case: str) -> Plain:
    folder = place / case
    folder.mkdir()
    return CASES[case](folder)


@pytest.fixture(params=PARAMS)
def case(place: Path, request: pytest.FixtureRequest) -> Plain:
    return plain(place, request.param)


def run(*command: object, text: str | None = None, folder: Path | None = None) -> str:
    """Run a command; return what it prints."""
    words = [str(word) for word in command]
    done = subprocess.run(
        words, cwd=folder, input=text, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, f"{' '.join(words)}\n{done.stdout}{done.stderr}"
    return done.stdout


def built(program: Path, sources: Iterable[Path], folders: Iterable[Path], *flags: str) -> Path:
    """Compile with all warnings."""
    include = [f"-I{folder}" for folder in folders]
    run(tool("cc"), *WARNINGS, *flags, *include, *sources, "-o", program)
    return program


def passed(plain: Plain) -> str:
    """Return what an example prints if every bit is right."""
    table = plain.files["controller.csv" if plain.values["control"] else "vectors.csv"]
    return f"{len(table.splitlines()) - 1} rows, 0 differ\n"


# The layout of each ecosystem


@pytest.mark.parametrize("package", PACKAGES)
def test_every_package_has_licence_readme_and_every_c_file(
    place: Path, package: str, tmp_path: Path
) -> None:
    one = plain(place, "cells")
    folder = one.write(package, tmp_path / "out")
    assert (folder / "LICENSE").read_text() == (ROOT / "LICENSE").read_text()
    readme = (folder / "README.md").read_text()
    assert "Apache-2.0" in readme
    assert "--name" in readme
    files = {path for path in folder.rglob("*") if path.is_file()}
    written = {path.name for path in files}
    for name in one.files:
        if name.startswith(("include/", "src/", "upper_2_")):
            assert name.rpartition("/")[2] in written, name
    for path in files:
        own = path.suffix in {".c", ".h", ".rs", ".ino", ".yml", ".yaml", ".conf", ".pdsc"}
        if own or path.name in {"Cargo.toml", "CMakeLists.txt", "Kconfig", "platformio.ini"}:
            assert "SPDX-License-Identifier: Apache-2.0" in path.read_text(), path
        if package in {"zephyr", "platformio", "cmsis-pack"} and path.suffix in {".c", ".h"}:
            same = [text for name, text in one.files.items() if name.endswith(f"/{path.name}")]
            assert not same or path.read_text() in same, path


def test_the_licence_of_an_installed_wheel_is_that_of_the_project() -> None:
    assert license_text() == (ROOT / "LICENSE").read_text()


PDSC_CHILDREN = {
    "package": {
        "vendor", "name", "description", "url", "license", "requirements", "releases", "keywords",
        "taxonomy", "conditions", "components",
    },
    "condition": {"description", "require", "accept"},
    "component": {
        "description", "files", "Pre_Include_Global_h", "Pre_Include_Local_Component_h",
    },
    "files": {"file"},
}  # fmt: skip
PDSC_ATTRIBUTES = {
    "component": {
        "Cclass", "Cgroup", "Csub", "Cvariant", "Cversion", "condition", "isDefaultVariant",
    },
    "require": {"Cclass", "Cgroup", "Csub", "Cversion"},
    "accept": {"Dcore", "Ddsp"},
    "file": {"category", "name", "attr", "select"},
    "release": {"version"},
}  # fmt: skip
"""What the documented schema of pack descriptions (1.7) allows, as far as packs here use it."""


def test_the_pack_description_keeps_the_documented_rules(case: Plain, tmp_path: Path) -> None:
    folder = case.write("cmsis-pack", tmp_path / "out")
    name = case.values["name"]
    root = ElementTree.parse(folder / f"anhyst.{name}.pdsc").getroot()
    for element in root.iter():
        tag = element.tag
        if tag in PDSC_CHILDREN:
            assert {child.tag for child in element} <= PDSC_CHILDREN[tag], tag
        if tag in PDSC_ATTRIBUTES:
            assert set(element.keys()) <= PDSC_ATTRIBUTES[tag], tag
        for key in ("Cclass", "Cgroup", "Csub", "Cvariant"):
            assert 2 <= len(element.get(key, "xx")) <= 32
        if tag == "description":
            assert 0 < len(element.text or "") <= 256
    for key in ("name", "vendor"):
        assert re.fullmatch(r"[-_A-Za-z0-9]+", root.findtext(key, ""))
    (release,) = root.iter("release")
    assert re.fullmatch(r"\d+\.\d+\.\d+", release.attrib["version"])
    conditions = {one.get("id") for one in root.iter("condition")}
    for component in root.iter("component"):
        assert component.get("condition") in {None, *conditions}
        assert [child.tag for child in component].count("files") == 1
    for file in root.iter("file"):
        named = folder / file.attrib["name"]
        assert named.exists(), named
        assert named.is_dir() == (file.get("category") == "include")


def test_the_cmsis_solution_names_components_of_the_pack(case: Plain, tmp_path: Path) -> None:
    folder = case.write("cmsis-pack", tmp_path / "out")
    (file,) = folder.glob("*.pdsc")
    identities = [
        tuple(one.get(key) for key in ("Cgroup", "Csub", "Cvariant"))
        for one in ElementTree.parse(file).getroot().iter("component")
    ]
    assert len(set(identities)) == len(identities)
    project = folder / "examples" / "golden_vectors" / "golden_vectors.cproject.yml"
    listed = yaml.safe_load(project.read_text())["project"]["components"]
    pattern = re.compile(r"anhyst::Anhyst:(\w+)(?::(\w+))?(?:&([\w-]+))?")
    found = [pattern.fullmatch(one["component"]) for one in listed]
    own = [one.groups() for one in found if one is not None]
    assert set(own) <= set(identities)
    assert {group for group, _, _ in own} == {group for group, _, _ in identities}


def test_the_pack_contains_every_file_and_has_the_same_bytes(case: Plain, tmp_path: Path) -> None:
    folder = case.write("cmsis-pack", tmp_path / "out")
    (pack,) = folder.glob("*.pack")
    with zipfile.ZipFile(pack) as archive:
        packed = {info.filename for info in archive.infolist()}
        assert archive.testzip() is None
    on_disk = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    assert packed == on_disk - {pack.name}
    again = case.write("cmsis-pack", tmp_path / "again")
    assert (again / pack.name).read_bytes() == pack.read_bytes()


def test_zephyr_finds_what_the_module_names(case: Plain, tmp_path: Path) -> None:
    folder = case.write("zephyr", tmp_path / "out")
    module = yaml.safe_load((folder / "zephyr" / "module.yml").read_text())
    assert set(module) == {"name", "build", "samples"}
    assert set(module["build"]) == {"cmake", "kconfig"}
    assert (folder / module["build"]["cmake"] / "CMakeLists.txt").is_file()
    assert (folder / module["build"]["kconfig"]).is_file()
    sample = yaml.safe_load((folder / "samples/golden_vectors/sample.yaml").read_text())
    assert set(sample) == {"sample", "tests"}
    (test,) = sample["tests"].values()
    assert test["harness_config"]["regex"] == [passed(case).strip()]
    option = f"ANHYST_{case.values['name'].upper()}"
    assert f"CONFIG_{option}=y" in (folder / "samples/golden_vectors/prj.conf").read_text()
    assert f"config {option}\n" in (folder / "zephyr" / "Kconfig").read_text()


KCONFIG = """
config CPU_CORTEX_M4
	def_bool {is_m4}
config CPU_CORTEX_M7
	bool
config CPU_CORTEX_M33
	bool
config ARMV8_M_DSP
	bool
config CPU_HAS_FPU
	def_bool y
config FPU
	bool "FPU"
	depends on CPU_HAS_FPU
rsource "first/zephyr/Kconfig"
rsource "second/zephyr/Kconfig"
"""
"""What the Kconfig files of Zephyr declare, and two modules after it."""


@pytest.mark.parametrize("is_m4", ["y", "n"])
def test_kconfig_turns_on_what_the_processor_has(place: Path, is_m4: str, tmp_path: Path) -> None:
    plain(place, "cells").write("zephyr", tmp_path / "first")
    plain(place, "single").write("zephyr", tmp_path / "second")
    (tmp_path / "Kconfig").write_text(KCONFIG.format(is_m4=is_m4))
    found = kconfiglib.Kconfig(str(tmp_path / "Kconfig"))
    port, fpu = found.syms["ANHYST_PORT_CORTEX_M4"], found.syms["FPU"]
    assert (port.str_value, fpu.str_value) == ("n", "n")
    found.syms["ANHYST_UPPER_2"].set_value("y")
    assert (port.str_value, fpu.str_value) == (is_m4, "n")
    found.syms["ANHYST_REAL"].set_value("y")
    assert fpu.str_value == "y"
    assert found.warnings == []


def test_manifests_of_libraries_say_what_the_folder_has(case: Plain, tmp_path: Path) -> None:
    name = case.values["name"]
    library = case.write("platformio", tmp_path / "platformio")
    described = json.loads((library / "library.json").read_text())
    assert described["license"] == "Apache-2.0"
    assert (library / "include" / described["headers"]).is_file()
    for example in described["examples"]:
        assert all((library / example["base"] / file).is_file() for file in example["files"])
    assert case.values["real"] == ("-ffp-contract=off" in described["build"].get("flags", []))
    sketch = case.write("arduino", tmp_path / "arduino")
    reader = configparser.ConfigParser()
    reader.optionxform = str  # type: ignore[assignment, method-assign]
    reader.read_string("[properties]\n" + (sketch / "library.properties").read_text())
    properties = reader["properties"]
    needed = [
        "name",
        "version",
        "author",
        "maintainer",
        "sentence",
        "paragraph",
        "category",
        "url",
        "architectures",
    ]
    assert set(needed) <= set(properties)
    assert re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9 _.-]*", properties["name"])
    assert (sketch / "src" / properties["includes"]).is_file()
    for line in (sketch / "keywords.txt").read_text().splitlines():
        assert re.fullmatch(r"\w+\t(KEYWORD[12]|LITERAL1)", line)
    crate = case.write("cargo", tmp_path / "cargo")
    manifest = tomllib.loads((crate / "Cargo.toml").read_text())
    assert manifest["package"]["links"] == manifest["lib"]["name"] == f"anhyst_{name}"
    assert "dependencies" not in manifest


def test_another_ecosystem_is_one_record(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own = Ecosystem(
        "own library",
        places={"include": "h", "src": "c", "headers": "h", "sources": "c"},
        templates={"{name}.json": "platformio/library.json.j2"},
    )
    monkeypatch.setitem(PACKAGES, "own", own)
    check_package("own")
    one = plain(place, "cells")
    files = package_files("own", one.files, one.manifest, one.values)
    assert {"h/anhyst/numeric/fixed.h", "h/upper_2_parameters.h", "upper_2.json"} <= set(files)
    assert {"c/compensator/cells.c", "c/upper_2_parameters.c", "LICENSE"} <= set(files)
    assert not any(name.startswith("port/") or name.endswith(".md") for name in files)


# Each package with a compiler


def cmsis_program(folder: Path, name: str, program: Path, variant: str = "Portable C") -> Path:
    """Build what a tool would build that selects an actuator and resolves its dependencies."""
    root = ElementTree.parse(folder / f"anhyst.{name}.pdsc").getroot()
    components = {
        (one.get("Cgroup"), one.get("Csub")): one
        for one in root.iter("component")
        if one.get("Cvariant") in {None, variant}
    }
    ((_, actuator),) = [one for one in components.items() if one[0][0] == "Actuator"]
    chosen = [actuator]
    for condition in root.iter("condition"):
        if condition.get("id") == actuator.get("condition"):
            required = [(one.get("Cgroup"), one.get("Csub")) for one in condition.iter("require")]
            chosen += [components[key] for key in required]
    example = folder / "examples" / "golden_vectors"
    sources, folders = [example / "main.c"], [example]
    before: list[str] = []
    for component in chosen:
        tags = ("Pre_Include_Global_h", "Pre_Include_Local_Component_h")
        before += filter(None, map(component.findtext, tags))
        for file in component.iter("file"):
            if file.get("attr") is None and file.get("category") in {"source", "include"}:
                target = sources if file.get("category") == "source" else folders
                target.append(folder / file.attrib["name"])
    first = program.with_suffix(".h")
    first.write_text("\n".join(dict.fromkeys(before)))
    return built(program, sources, folders, "-include", str(first))


ZEPHYR = """
set(CMAKE_C_STANDARD 99)
add_library(zephyr_interface INTERFACE)
function(zephyr_library_named name)
  add_library(${name} STATIC)
  target_link_libraries(${name} PRIVATE zephyr_interface)
endfunction()
function(zephyr_include_directories)
  target_include_directories(zephyr_interface INTERFACE ${ARGV})
endfunction()
function(zephyr_compile_definitions)
  target_compile_definitions(zephyr_interface INTERFACE ${ARGV})
endfunction()
enable_language(C)
add_executable(app)
foreach(module IN LISTS ZEPHYR_EXTRA_MODULES)
  get_filename_component(part "${module}" NAME)
  get_filename_component(module "${module}" ABSOLUTE)
  string(MD5 place "${module}")
  add_subdirectory(${module}/zephyr ${CMAKE_BINARY_DIR}/${place})
endforeach()
target_include_directories(zephyr_interface INTERFACE ${CMAKE_CURRENT_LIST_DIR})
target_link_libraries(app PRIVATE zephyr_interface
  -Wl,--whole-archive anhyst -Wl,--no-whole-archive)
"""
"""A stand-in for the functions of Zephyr's build that a module calls. Zephyr itself is in no
registry of packages."""


def zephyr_program(sample: Path, build: Path, *options: str) -> Path:
    fake = build.with_name("zephyr")
    (fake / "zephyr" / "sys").mkdir(parents=True, exist_ok=True)
    (fake / "ZephyrConfig.cmake").write_text(ZEPHYR)
    printk = fake / "zephyr" / "sys" / "printk.h"
    printk.write_text("#include <stdio.h>\n#define printk printf\n")
    ours = [f"-D{option}=y" for option in options]
    cmake = tool("cmake")
    run(cmake, "-G", "Ninja", "-S", sample, "-B", build, f"-DZephyr_DIR={fake}", *ours)
    run(cmake, "--build", build)
    return build / "app"


def test_the_cmsis_pack_plays_the_golden_vectors(case: Plain, tmp_path: Path) -> None:
    folder = case.write("cmsis-pack", tmp_path / "out")
    run(cmsis_program(folder, case.values["name"], tmp_path / "program"))
    wrong = folder / "examples" / "golden_vectors" / "golden_vectors.h"
    rows = wrong.read_text()
    last = re.findall(r"^  \{.*, (\S+)\},$", rows, re.M)[-1]
    wrong.write_text(rows.replace(f", {last}}},\n}};", ", 1},\n};"))
    spoiled = cmsis_program(folder, case.values["name"], tmp_path / "spoiled")
    assert subprocess.run([spoiled], check=False).returncode == 1


def test_the_pack_compiles_with_the_instructions_of_a_cortex_m4(
    place: Path, tmp_path: Path
) -> None:
    folder = plain(place, "cells").write("cmsis-pack", tmp_path / "out")
    (file,) = folder.glob("*.pdsc")
    (port,) = ElementTree.parse(file).findall(".//component[@Cvariant='Cortex-M4']")
    first = tmp_path / "first.h"
    first.write_text(port.findtext("Pre_Include_Global_h", ""))
    command = [tool("clang"), "--target=thumbv7em-none-eabi", "-mcpu=cortex-m4", "-ffreestanding"]
    command += [f"-I{folder / part}" for part in ("include", "actuator", "port")]
    command += ["-std=c99", "-O2", "-Wall", "-Wextra", "-Werror", "-include", str(first), "-S"]
    code = [run(*command, "-o", "-", source) for source in (folder / "src").rglob("*.c")]
    assert sum(text.count("smulwb") for text in code) > 10


def test_the_zephyr_module_plays_the_golden_vectors(case: Plain, tmp_path: Path) -> None:
    folder = case.write("zephyr", tmp_path / "out")
    sample = folder / "samples" / "golden_vectors"
    option = f"CONFIG_ANHYST_{case.values['name'].upper()}"
    assert run(zephyr_program(sample, tmp_path / "build", option)) == passed(case)


def test_the_platformio_library_plays_the_golden_vectors(case: Plain, tmp_path: Path) -> None:
    folder = case.write("platformio", tmp_path / "out")
    flags = json.loads((folder / "library.json").read_text())["build"].get("flags", [])
    sources = [*(folder / "src").rglob("*.c"), folder / "examples/golden_vectors/src/main.c"]
    program = built(tmp_path / "program", sources, [folder / "include"], *flags)
    assert run(program) == passed(case)


ARDUINO = """
#include <cstdio>
#define F(text) text
struct Printer {
  void begin(long) {}
  explicit operator bool() const { return true; }
  void print(long value) { std::printf("%ld", value); }
  void print(const char *text) { std::printf("%s", text); }
  void println(const char *text) { std::printf("%s\\n", text); }
} Serial;
#include "golden_vectors.ino"
int main() { setup(); }
"""
"""What the Arduino core gives a sketch."""


def test_the_arduino_library_plays_the_golden_vectors(case: Plain, tmp_path: Path) -> None:
    """The sketch is C++, and only src is in the include path, as Arduino builds it."""
    folder = case.write("arduino", tmp_path / "out")
    objects = tmp_path / "objects"
    objects.mkdir()
    sources = sorted((folder / "src").rglob("*.c"))
    run(tool("cc"), *WARNINGS, f"-I{folder / 'src'}", "-c", *sources, folder=objects)
    (tmp_path / "sketch.cpp").write_text(ARDUINO)
    include = [f"-I{folder / 'src'}", f"-I{folder / 'examples' / 'golden_vectors'}"]
    compiler = [tool("c++"), "-std=c++11", "-Wall", "-Wextra", "-Werror"]
    program = tmp_path / "program"
    run(*compiler, *include, tmp_path / "sketch.cpp", *objects.glob("*.o"), "-o", program)
    assert run(program) == passed(case)


def fma_count(source: Path, include: Path, *flags: str) -> int:
    """Count fused products and sums in the code of a source for a processor that has them."""
    text = run(tool("gcc"), "-O2", "-mfma", *flags, f"-I{include}", "-S", "-o", "-", source)
    return len(re.findall(r"\bvfn?m(?:add|sub)", text))


@pytest.mark.skipif(os.uname().machine != "x86_64", reason="looks at instructions of x86-64")
def test_sources_in_single_precision_fuse_no_products_without_a_flag(
    place: Path, tmp_path: Path
) -> None:
    """Arduino passes no flags of a library; the pragma in each source does what the flag does."""
    folder = plain(place, "single").write("arduino", tmp_path / "out") / "src"
    source = folder / "compensator" / "compensator_f32.c"
    assert fma_count(source, folder) == 0
    bare = source.with_name("bare.c")
    bare.write_text(source.read_text().partition("#endif\n")[2])
    assert fma_count(bare, folder) > 0


def test_the_8_bit_compiler_builds_the_arduino_library(place: Path, tmp_path: Path) -> None:
    folder = plain(place, "cells").write("arduino", tmp_path / "out") / "src"
    options = ["-std=gnu11", "-Os", "-mmcu=atmega2560", "-Wall", "-Wextra", "-Werror"]
    for source in folder.rglob("*.c"):
        run(tool("avr-gcc"), *options, f"-I{folder}", "-c", source, "-o", tmp_path / "object.o")


# Several actuators in one program


def renamed(text: str, number: int) -> str:
    """Give the golden vectors of an actuator names of their own."""
    text = re.sub(r"\b(play_golden_vectors|golden_rows)\b", rf"\1_{number}", text)
    return re.sub(r"\bGOLDEN", f"G{number}", text)


ALL_ROWS_SAME = '#include "0.h"\n#include "1.h"\n' + (
    "int main(void) { return play_golden_vectors_0() != 0 || play_golden_vectors_1() != 0; }\n"
)


def both(place: Path, package: str, folder: Path) -> tuple[Path, Path]:
    """Write packages of two actuators, whose cores have files in common."""
    names = ("ring", "cells")
    first, second = (plain(place, name).write(package, folder / name) for name in names)
    for number, one in enumerate((first, second)):
        (header,) = one.rglob("golden_vectors.h")
        (folder / f"{number}.h").write_text(renamed(header.read_text(), number))
    (folder / "main.c").write_text(ALL_ROWS_SAME)
    return first, second


@pytest.mark.parametrize(("package", "part"), [("platformio", "include"), ("arduino", "src")])
def test_two_libraries_link_as_archives(
    place: Path, package: str, part: str, tmp_path: Path
) -> None:
    archives: list[Path] = []
    folders = both(place, package, tmp_path)
    for number, folder in enumerate(folders):
        objects = tmp_path / f"objects{number}"
        objects.mkdir()
        sources = sorted((folder / "src").rglob("*.c"))
        run(tool("cc"), *WARNINGS, f"-I{folder / part}", "-c", *sources, folder=objects)
        archives.append(objects / "library.a")
        run(tool("ar"), "rcs", archives[-1], *objects.glob("*.o"))
    include = [folder / part for folder in folders]
    run(built(tmp_path / "program", [tmp_path / "main.c", *archives], include))
    run(built(tmp_path / "turned", [tmp_path / "main.c", *reversed(archives)], include))


def test_two_zephyr_modules_share_a_core_of_the_same_version_only(
    place: Path, tmp_path: Path
) -> None:
    modules = both(place, "zephyr", tmp_path)
    (tmp_path / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.20)\n"
        f"list(APPEND ZEPHYR_EXTRA_MODULES {modules[0]} {modules[1]})\n"
        "find_package(Zephyr REQUIRED)\nproject(two LANGUAGES C)\n"
        "target_sources(app PRIVATE main.c)\n"
    )
    options = [f"CONFIG_ANHYST_{plain(place, name).values['macro']}" for name in ("ring", "cells")]
    run(zephyr_program(tmp_path, tmp_path / "build", *options))
    header = modules[1] / "include" / "anhyst" / "compensator" / "compensator.h"
    header.write_text(header.read_text() + "/* another version */\n")
    cmake = [tool("cmake"), "-S", str(tmp_path), "-B", str(tmp_path / "build")]
    done = subprocess.run(cmake, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert "same version of anhyst" in " ".join(done.stderr.split())


def test_packs_name_the_shared_core_alike(place: Path, tmp_path: Path) -> None:
    """So a project selects each source of the core once, whichever pack it comes from."""
    found = []
    for folder in both(place, "cmsis-pack", tmp_path):
        (file,) = folder.glob("*.pdsc")
        root = ElementTree.parse(file).getroot()
        found.append(
            {
                (one.get("Csub"), one.get("Cversion")): [f.get("name") for f in one.iter("file")]
                for one in root.iter("component")
                if one.get("Cgroup") == "Core"
            }
        )
    shared = found[0].keys() & found[1].keys()
    assert {("compensator", "0.1.0"), ("block", "0.1.0")} <= shared
    assert all(found[0][key] == found[1][key] for key in shared)


# Rust


def cargo(folder: Path, *words: str) -> str:
    if CARGO is None:
        pytest.skip("cargo is not installed: apt install cargo")
    environment = {**os.environ, "CARGO_NET_OFFLINE": "true", "CARGO_TARGET_DIR": f"{folder}.out"}
    environment["PATH"] += f":{Path(CARGO).parent}"
    done = subprocess.run(
        [CARGO, *words], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "warning" not in done.stderr, done.stderr
    return done.stdout


@pytest.mark.slow
def test_the_crate_plays_the_golden_vectors(case: Plain, tmp_path: Path) -> None:
    folder = case.write("cargo", tmp_path / "crate")
    said = cargo(folder, "test", "--quiet")
    expected = 3 if case.values["control"] else 2
    assert f"test result: ok. {expected} passed" in said
    assert "failed; 0" not in said.replace("0 failed; 0", "")


@pytest.mark.slow
def test_two_crates_keep_their_cores_apart(place: Path, tmp_path: Path) -> None:
    """Of different iron: the structures of one core are larger than those of the other."""
    crates = [plain(place, name).write("cargo", tmp_path / name) for name in ("cells", "solid")]
    program = tmp_path / "program"
    (program / "src").mkdir(parents=True)
    names = [tomllib.loads((one / "Cargo.toml").read_text())["package"]["name"] for one in crates]
    lines = [f'{name} = {{ path = "{one}" }}' for name, one in zip(names, crates, strict=True)]
    (program / "Cargo.toml").write_text(
        '[package]\nname = "program"\nversion = "0.0.0"\nedition = "2021"\n[dependencies]\n'
        + "\n".join(lines)
    )
    calls = "".join(
        f"    {{ use {name.replace('-', '_')}::*; let mut one = Compensator::new().unwrap();\n"
        "      let gap = Gap::default(); let current = one.solve(Demand::from_si(1.0), gap);\n"
        "      one.commit(current, gap); assert!(one.output().to_si() > 0.5); }\n"
        for name in names
    )
    (program / "src" / "main.rs").write_text(f"fn main() {{\n{calls}}}\n")
    cargo(program, "run", "--quiet")


def test_a_crate_reserves_enough_memory_on_32_bits(case: Plain, tmp_path: Path) -> None:
    """The binding does not compile if the state does not fit; here for a Cortex-M4."""
    folder = case.write("cargo", tmp_path / "crate") / "c"
    include = [f"-I{folder / part}" for part in ("include", "actuator")]
    binding = folder / "actuator" / f"{case.values['name']}_binding.c"
    command = [tool("clang"), "--target=thumbv7em-none-eabi", "-ffreestanding", "-std=c99"]
    run(*command, "-Wall", "-Wextra", "-Werror", "-fsyntax-only", *include, binding)


# Tools of ecosystems


@pytest.mark.slow
@pytest.mark.needs("arduino-builder", "simavr", "avr-gcc")
def test_the_arduino_builder_and_an_avr_give_the_golden_vectors(
    place: Path, tmp_path: Path
) -> None:
    folder = plain(place, "cells").write("arduino", tmp_path / "libraries" / "anhyst_upper_2")
    hardware = "/usr/share/arduino/hardware"
    ctags = (
        'tools.ctags.pattern="{cmd.path}" -u --language-force=c++ -f - --c++-kinds=svpf '
        '--fields=KSTtzns --line-directives "{source_file}"'
    )
    build = tmp_path / "build"
    build.mkdir()
    run(
        *("arduino-builder", "-compile", "-hardware", hardware, "-tools", hardware),
        *("-libraries", tmp_path / "libraries", "-fqbn", AVR_BOARD, "-build-path", build),
        *("-prefs=tools.ctags.cmd.path=/usr/bin/arduino-ctags", f"-prefs={ctags}"),
        "-prefs=compiler.cpp.extra_flags=-DDECIMAL_DIG=__DECIMAL_DIG__",
        "-prefs=runtime.tools.avr-gcc.path=/usr",
        folder / "examples" / "golden_vectors" / "golden_vectors.ino",
    )
    program = build / "golden_vectors.ino.elf"
    simulator = ["simavr", "-m", "atmega2560", "-f", "16000000", str(program)]
    with subprocess.Popen(simulator, stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as running:
        assert running.stdout is not None
        said = running.stdout.readline().decode()  # the sketch never ends
        running.kill()
    assert passed(plain(place, "cells")).strip() in said


@pytest.mark.campaign
@pytest.mark.needs("pio")
def test_platformio_builds_and_runs_the_example(place: Path, tmp_path: Path) -> None:
    folder = plain(place, "cells").write("platformio", tmp_path / "out")
    said = run("pio", "run", "-d", folder / "examples" / "golden_vectors", "-t", "exec")
    assert passed(plain(place, "cells")) in said


# The command


def test_the_command_writes_and_replaces_a_package(
    place: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = _model(tmp_path, measured(magnet()))
    out = tmp_path / "out"
    one = plain(place, "cells")
    write_folder(out, package_files("cmsis-pack", one.files, one.manifest, one.values), {})
    options = ["--rate", "1e4", "--kind", "simplified", "--accuracy", "40", "--name", "lower"]
    command = ["compile", str(file), "--out", str(out), *options]
    assert main([*command, "--package", "zephyr"]) == 0
    manifest = json.loads((out / "manifest.json").read_text())
    assert manifest["package"] == "zephyr"
    written = {path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file()}
    assert written == {"manifest.json", *manifest["files"]}
    for verb in ("verify", "live"):
        assert main([verb, str(out)]) == 2
        assert says(capsys.readouterr().err, "wrong-kind: package; --package")
    with refused("wrong-kind: package"):
        read_bundle(out)
    with refused("wrong-kind: package"):
        firmware.build("host", out, tmp_path / "firmware")
    (out / "notes.txt").write_text("mine")
    assert main([*command, "--package", "zephyr"]) == 2
    assert (out / "notes.txt").read_text() == "mine"


@pytest.mark.parametrize("source", ["model", "stage"])
def test_the_command_refuses_what_has_no_package(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], source: str
) -> None:
    stage = ROOT / "examples" / "stage" / "rig.toml"
    file = stage if source == "stage" else _model(tmp_path, measured(magnet()))
    package = "zephyr" if source == "stage" else "conan"
    out = tmp_path / "out"
    command = ["compile", str(file), "--rate", "1e4", "--out", str(out), "--package", package]
    assert main(command) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    kind = "option-not-for-this" if source == "stage" else "unknown-package"
    assert says(said, f"{kind} --package")
    assert source == "stage" or all(name in said for name in PACKAGES)
    assert not out.exists()


def test_help_and_documents_name_every_package() -> None:
    help_ = get_args(PackageName)[1].help
    page = (ROOT / "docs" / "compile.md").read_text()
    for name in PACKAGES:
        assert name in help_
        assert f"`{name}`" in page
