"""Run compilers, report their errors in one line, and list the C files of the core for each kind."""

from __future__ import annotations

import importlib.util
import posixpath
import re
import shutil
import subprocess
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from anhyst.compensate.block import Kind
from anhyst.support.atomic import core_folder
from anhyst.support.cache import compile_and_link
from anhyst.support.errors import InputError, NegativeResult


@dataclass(frozen=True, slots=True)
class MissingTool:
    """Missing tool of a target."""

    target: str  # target that needs the tool
    tool: str  # program, Python package or library
    install: str  # command that installs it

    def text(self) -> str:
        """Return the tool and its install command in one line."""
        return f"{self.target}: {self.tool} ({self.install})"


def missing_programs(target: str, packages: Mapping[str, str]) -> tuple[MissingTool, ...]:
    """Return the programs that are not installed."""
    return tuple(
        MissingTool(target, name, f"apt install {package}")
        for name, package in packages.items()
        if shutil.which(name) is None
    )


def missing_modules(
    target: str, names: Iterable[str], extra: str = "anhyst[verify]"
) -> tuple[MissingTool, ...]:
    """Return the Python packages of an extra that are not installed."""
    return tuple(
        MissingTool(target, name, f"pip install '{extra}'")
        for name in names
        if importlib.util.find_spec(name) is None
    )


ACTUATOR_HEADER = "include/anhyst/actuator.h"
"""Header with common names for the functions and types of a program's only actuator."""


def actuator_defines(name: str) -> dict[str, str]:
    """Return the macros that define the actuator's name for this header."""
    return {"ACTUATOR_NAME": name, "ACTUATOR_MACRO": name.upper()}


WARNING_FLAGS = ("-Wall", "-Wextra", "-Wconversion")
FREESTANDING_FLAGS = ("-ffreestanding", "-nostdlib", "-fno-sanitize=undefined", "-fomit-frame-pointer")
TIME_LIMIT_S = 300.0


def zig_cc(target: str) -> list[str]:
    """Return the command of the C compiler in the PyPI package ziglang."""
    for missing in missing_modules(target, ["ziglang"]):
        raise InputError(f"target {missing.text()}", code="tool-missing", key=missing.tool)
    return [sys.executable, "-m", "ziglang", "cc"]


@dataclass(frozen=True, slots=True)
class Build:
    """Sources and options of a program."""

    sources: tuple[Path, ...]  # C files
    include: tuple[Path, ...] = ()  # include folders
    defines: Mapping[str, str] = field(default_factory=dict)  # macros and their values
    flags: tuple[str, ...] = ()  # other options
    libraries: tuple[str, ...] = ()  # libraries, after the sources

    def options(self) -> list[str]:
        """Return the compiler options for every source."""
        return ["-std=c99", *WARNING_FLAGS, *self.flags]

    def preprocessor_options(self) -> list[str]:
        """Return macros and include folders as options."""
        return [
            *(f"-D{name}={value}" for name, value in self.defines.items()),
            *(f"-I{folder}" for folder in self.include),
        ]


def compile_c(compiler: Sequence[str], build: Build, output: Path, target: str) -> int:
    """Compile and link; return the number of warnings."""
    messages = compile_and_link(
        compiler,
        build.options(),
        build.preprocessor_options(),
        build.sources,
        [*build.libraries, "-o", str(output)],
        partial(run_tool, target=target),
    )
    return sum(": warning:" in line for text in messages for line in text.splitlines())


def compile_cortex_m(cpu: str, build: Build, linker_script: Path, output: Path) -> int:
    """Compile and link a program for a Cortex-M, with ziglang only."""
    name, _, float_unit = cpu.replace("_", "-").partition("+")
    compiler = [
        *zig_cc(name),
        "-target",
        "thumb-freestanding-eabihf" if float_unit else "thumb-freestanding-eabi",
        f"-mcpu={cpu}",
        *FREESTANDING_FLAGS,
        "-rtlib=compiler-rt",
        "-T",
        str(linker_script),
        "-Wl,--entry=reset",
    ]
    return compile_c(compiler, build, output, name)


def run_tool(command: Sequence[str], target: str) -> str:
    """Run a compiler or linker, and return its messages."""
    try:
        process = subprocess.run(
            command, capture_output=True, text=True, errors="replace", timeout=TIME_LIMIT_S, check=False
        )
    except subprocess.TimeoutExpired:
        raise NegativeResult(
            f"target {target}: {Path(command[0]).name} did not end within {TIME_LIMIT_S:.0f} s",
            code="time-limit",
            key=target,
        ) from None
    if process.returncode:
        text = f"target {target}: does not compile: {_first_error(process.stderr)}"
        raise NegativeResult(text, code="does-not-compile", key=target)
    return process.stderr


def _first_error(text: str) -> str:
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    for line in lines:
        if "error" in line or "undefined" in line:
            return line
    return lines[0] if lines else "no reason given"


_COMPENSATOR_SOURCES = ("compensator/block.c", "compensator/compensator.c")

KIND_SOURCES: dict[Kind, tuple[str, ...]] = {
    "full": (*_COMPENSATOR_SOURCES, "compensator/full.c"),
    "simplified": (*_COMPENSATOR_SOURCES, "compensator/simplified.c"),
    "cells": (*_COMPENSATOR_SOURCES, "compensator/cells.c"),
    "euler": (*_COMPENSATOR_SOURCES, "compensator/euler.c"),
}
"""Sources of each kind in fixed point."""

MONITOR_SOURCES = ("compensator/watch.c", "compensator/saved.c")
MONITOR_SOURCES_F32 = ("compensator/watch_f32.c", "compensator/saved_f32.c")
"""Sources that an interrupt and a power cycle need in addition to solve and commit."""

_COMPENSATOR_SOURCES_F32 = ("compensator/block_f32.c", "compensator/compensator_f32.c")

KIND_SOURCES_F32: dict[Kind, tuple[str, ...]] = {
    "full": (*_COMPENSATOR_SOURCES_F32, "compensator/full_f32.c"),
    "cells": (*_COMPENSATOR_SOURCES_F32, "compensator/cells_f32.c"),
    "simplified": (*_COMPENSATOR_SOURCES_F32, "compensator/simplified_f32.c"),
}
"""Sources of each kind in single precision."""

PIDD2_SOURCES = ("control/pidd2.c",)
"""Sources of PIDD2 in fixed point."""

CONTROL_SOURCES = (
    *PIDD2_SOURCES,
    *("compensator/map.c", "compensator/force_controller.c"),
    *("control/supervisor.c", "control/levitation.c", "control/position.c"),
)
"""Sources of a position controller, in addition to those of the compensator."""

AXES_SOURCES_F32 = (
    *("control/allocation_f32.c", "control/biquad_f32.c"),
    *("control/wrench_f32.c", "control/axes_f32.c"),
)
"""Sources of the controller of a stage in single precision, in addition to its force controllers.
"""

AXES_SOURCES_FIXED = ("control/allocation.c", "control/wrench_fixed.c", "control/axes_fixed.c")
"""Sources of the controller of a stage in fixed point, in addition to its force controllers."""

FORCE_SOURCES_F32 = (
    *("compensator/force_controller_f32.c", "compensator/map_f32.c"),
    *_COMPENSATOR_SOURCES_F32,
)
FORCE_SOURCES_FIXED = (*_COMPENSATOR_SOURCES, "compensator/force_controller.c", "compensator/map.c")
FORCE_SOURCES_CODED = (*FORCE_SOURCES_FIXED, "compensator/force_coded_f32.c")
"""Sources of force controllers, in addition to the kernel of a law: in single precision, in fixed
point, and in fixed point with a single-precision interface."""

PLAY_MAP_SOURCES_FIXED = ("compensator/play_map.c", "compensator/force_by_play.c")
PLAY_MAP_SOURCES_F32 = ("compensator/play_map_f32.c", "compensator/force_by_play_f32.c")
CORRECTED_SOURCES_F32 = ("compensator/force_corrected_f32.c",)
"""Additional sources for a map with one play operator, and for calibration corrections."""

INCLUDE_FOLDER = "include"
SOURCE_FOLDER = "src"

_INCLUDE_LINE = re.compile(r'^#include "([^"]+)"$', re.M)


def read_core(name: str) -> str:
    """Return the text of a file of the core, such as ``port/anhyst_port_cortex_m4.h``."""
    return (core_folder() / name).read_text(encoding="utf-8")


MEMORIES_HEADER = f"{INCLUDE_FOLDER}/anhyst/compensator/plays.h"
"""Header that defines the number of hysteresis states of a compensator."""


def core_files(sources: Iterable[str], memories: int = 1) -> dict[str, str]:
    """Return sources of the core with all headers that they include.

    With more than one hysteresis state, the number in `MEMORIES_HEADER` is replaced.
    """
    files: dict[str, str] = {}
    pending_files = [f"{SOURCE_FOLDER}/{name}" for name in sources]
    while pending_files:
        name = pending_files.pop()
        if name not in files:
            files[name] = read_core(name)
            pending_files += [
                _header_path(name, included_name) for included_name in _INCLUDE_LINE.findall(files[name])
            ]
    if memories > 1:
        files[MEMORIES_HEADER] = files[MEMORIES_HEADER].replace(
            "ANHYST_MEMORIES 1", f"ANHYST_MEMORIES {memories}"
        )
    return dict(sorted(files.items()))


def _header_path(file: str, included_name: str) -> str:
    """Return the path of an included header: a public one, or one in the folder of the file."""
    if included_name.startswith("anhyst/"):
        return f"{INCLUDE_FOLDER}/{included_name}"
    return posixpath.normpath(f"{file.rpartition('/')[0]}/{included_name}")
