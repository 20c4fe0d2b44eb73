"""Test that built packages of ecosystems play the golden vectors bit for bit."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import tomllib
from pathlib import Path
from xml.etree import ElementTree

import pytest

from tests.compilation.packaged import Plain, built, passed, plain, run
from tests.compilation.test_compile import WARNINGS
from tests.core.test_c_core import tool

CARGO = shutil.which("cargo", path=f"{os.environ['PATH']}:{Path.home()}/.cargo/bin")
AVR_BOARD = "arduino:avr:mega:cpu=atmega2560"


def cmsis_program(folder: Path, name: str, program: Path) -> Path:
    """Build the program of a selected actuator and its resolved dependencies."""
    root = ElementTree.parse(folder / f"anhyst.{name}.pdsc").getroot()
    components = {
        (one.get("Cgroup"), one.get("Csub")): one
        for one in root.iter("component")
        if one.get("Cvariant") in {None, "Portable C"}
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
"""Stand-in for the build functions of Zephyr that a module calls. Zephyr itself is not in a
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


def test_the_pack_compiles_with_the_instructions_of_a_cortex_m4(place: Path, tmp_path: Path) -> None:
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
"""Functions of the Arduino core that a sketch uses."""


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
    """Count fused products and sums in the machine code of a source."""
    text = run(tool("gcc"), "-O2", "-mfma", *flags, f"-I{include}", "-S", "-o", "-", source)
    return len(re.findall(r"\bvfn?m(?:add|sub)", text))


@pytest.mark.skipif(os.uname().machine != "x86_64", reason="looks at instructions of x86-64")
def test_sources_in_single_precision_fuse_no_products_without_a_flag(place: Path, tmp_path: Path) -> None:
    """Arduino passes no flags of a library; the pragma in each source has the same effect."""
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
    """Rename the golden vectors of an actuator."""
    text = re.sub(r"\b(play_golden_vectors|golden_rows)\b", rf"\1_{number}", text)
    return re.sub(r"\bGOLDEN", f"G{number}", text)


ALL_ROWS_SAME = '#include "0.h"\n#include "1.h"\n' + (
    "int main(void) { return play_golden_vectors_0() != 0 || play_golden_vectors_1() != 0; }\n"
)


def both(place: Path, package: str, folder: Path) -> tuple[Path, Path]:
    """Write packages of two actuators whose cores have common files."""
    names = ("ring", "cells")
    first, second = (plain(place, name).write(package, folder / name) for name in names)
    for number, one in enumerate((first, second)):
        (header,) = one.rglob("golden_vectors.h")
        (folder / f"{number}.h").write_text(renamed(header.read_text(), number))
    (folder / "main.c").write_text(ALL_ROWS_SAME)
    return first, second


@pytest.mark.parametrize(("package", "part"), [("platformio", "include"), ("arduino", "src")])
def test_two_libraries_link_as_archives(place: Path, package: str, part: str, tmp_path: Path) -> None:
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


def test_two_zephyr_modules_share_a_core_of_the_same_version_only(place: Path, tmp_path: Path) -> None:
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
    completed = subprocess.run(cmake, capture_output=True, text=True, check=False)
    assert completed.returncode != 0
    assert "same version of anhyst" in " ".join(completed.stderr.split())


def test_packs_name_the_shared_core_alike(place: Path, tmp_path: Path) -> None:
    """A project can then select each source of the core once, from any pack."""
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
    completed = subprocess.run(
        [CARGO, *words], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    assert completed.returncode == 0, completed.stdout + completed.stderr
    assert "warning" not in completed.stderr, completed.stderr
    return completed.stdout


@pytest.mark.slow
def test_the_crate_plays_the_golden_vectors(case: Plain, tmp_path: Path) -> None:
    folder = case.write("cargo", tmp_path / "crate")
    said = cargo(folder, "test", "--quiet")
    expected = 3 if case.values["control"] else 2
    assert f"test result: ok. {expected} passed" in said
    assert "failed; 0" not in said.replace("0 failed; 0", "")


@pytest.mark.slow
def test_two_crates_keep_their_cores_apart(place: Path, tmp_path: Path) -> None:
    """The structures of one core are larger than those of the other."""
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
def test_the_arduino_builder_and_an_avr_give_the_golden_vectors(place: Path, tmp_path: Path) -> None:
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
        said = running.stdout.readline().decode()  # the sketch does not end
        running.kill()
    assert passed(plain(place, "cells")).strip() in said


@pytest.mark.campaign
@pytest.mark.needs("pio")
def test_platformio_builds_and_runs_the_example(place: Path, tmp_path: Path) -> None:
    folder = plain(place, "cells").write("platformio", tmp_path / "out")
    said = run("pio", "run", "-d", folder / "examples" / "golden_vectors", "-t", "exec")
    assert passed(plain(place, "cells")) in said
