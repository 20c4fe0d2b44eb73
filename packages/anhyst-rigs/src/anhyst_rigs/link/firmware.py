"""Build the firmware of a board from its sources and from a compiled compensator."""

from __future__ import annotations

import importlib.util
import json
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from anhyst.compilation.toolchain import actuator_defines
from anhyst.support import running_version
from anhyst.support.atomic import PathLike, core_folder, shipped_folder, write_bytes
from anhyst.support.cache import compile_and_link
from anhyst.support.errors import InputError, NegativeResult
from anhyst.support.kinds import COMPILED_FOLDER, require_kind
from anhyst_rigs.link.virtual_boards import check_runs_here

_MANIFEST = "manifest.json"
_WARNINGS = ["-Wall", "-Wextra", "-Wconversion"]
_THUMB_OPTIONS = ("-target", "thumb-freestanding-eabi")
_FREESTANDING_OPTIONS = ("-ffreestanding", "-nostdlib", "-fno-sanitize=undefined")
_SIZE_OPTIONS = ("-Os", "-ffunction-sections", "-fdata-sections", "-Wl,--gc-sections")
_COMPILE_TIME_LIMIT_S = 300.0


@dataclass(frozen=True, slots=True)
class Board:
    """How the firmware of a board is built."""

    folders: tuple[str, ...]  # folders in ``firmware/boards`` that contain its sources
    cpu: str = ""  # name of the processor in zig; empty for this PC
    # header with processor instructions, from the folder ``port`` of a compiled folder
    port_header: str = ""
    options: tuple[str, ...] = ()  # further compiler options


BOARDS = {
    "host": Board(("host", "lockstep")),
    "library": Board(("library", "lockstep"), options=("-shared", "-fPIC", "-fvisibility=hidden")),
    "qemu-mps2": Board(("qemu-mps2", "lockstep", "cortex-m"), "cortex_m3"),
    "nucleo": Board(("nucleo", "cortex-m"), "cortex_m4", "anhyst_port_cortex_m4.h"),
}


def build(board: str, parameters: PathLike, out: PathLike) -> Path:
    """Build the firmware of a board around a compiled compensator."""
    if board not in BOARDS:
        text = f"board {board}: is unknown; choose one of {', '.join(BOARDS)}"
        raise InputError(text, code="unknown-board", key="board")
    folder = Path(parameters).resolve()
    actuator = _read_actuator_name(folder)
    with tempfile.TemporaryDirectory(prefix="anhyst-") as temporary_folder:
        program = Path(temporary_folder, "firmware")
        _compile(board, folder, actuator, program)
        write_bytes(out, program.read_bytes())
    target = Path(out)
    target.chmod(0o755)
    return target


def check_compiler(board: str) -> None:
    """Raise an error if the compiler for a board is not installed."""
    _compiler_command(board)


def firmware_folder() -> Path:
    """Return the folder that contains the sources of the firmware."""
    return shipped_folder("anhyst_rigs", "firmware", "_firmware", "boards")


def _read_actuator_name(folder: Path) -> str:
    """Return the C name of the actuator of a compiled folder.

    Raise an error if the rate is not a whole number of 10 to 1,000,000 ticks per second.
    """
    require_kind(folder, [COMPILED_FOLDER])
    path = folder / _MANIFEST
    try:
        manifest = json.loads(path.read_text(encoding="utf-8"))
        name, rate = str(manifest["name"]), float(manifest["rate_Hz"])
    except (OSError, ValueError, KeyError, TypeError):
        text = f"{path}: is missing or has no actuator name; enter a folder of anhyst compile"
        raise InputError(text, code="not-a-compiled-folder") from None
    if rate != int(rate) or not 10 <= rate <= 1_000_000:
        raise InputError(
            f"{path}: rate_Hz is {rate:g}; compile for a whole number of ticks per second, 10 to 1000000",
            code="rate-not-whole",
            key="rate_Hz",
        )
    return name


def _compile(name: str, folder: Path, actuator: str, program: Path) -> None:
    board = BOARDS[name]
    firmware_root = firmware_folder()
    board_folders = [firmware_root / "boards" / board_folder for board_folder in board.folders]
    controller_kind = "position" if (folder / f"{actuator}_controller.c").is_file() else "force"
    sources = [*sorted(folder.glob("src/*/*.c")), folder / f"{actuator}_parameters.c"]
    include = [firmware_root, folder / "include", folder, *board_folders]
    if controller_kind == "position":
        sources.append(folder / f"{actuator}_controller.c")
    else:
        # A folder without a position controller lacks this source, which the firmware needs.
        sources.append(core_folder() / "src" / "control" / "supervisor.c")
    include.append(core_folder() / "include")
    for source_part in ("app", "link", "services", "xcp", controller_kind):
        sources += sorted((firmware_root / source_part).glob("*.c"))
    for sources_of_board in board_folders:
        sources += sorted(
            file
            for file in sources_of_board.glob("*.c")
            if file.stem == f"board_{controller_kind}" or not file.stem.startswith("board_")
        )
    if not any(source.name == f"board_{controller_kind}.c" for source in sources):
        text = f"board {name}: has no {controller_kind} controller; choose another board"
        raise InputError(text, code="board-has-no-controller", key=name)
    major_version, minor_version = (*map(int, re.findall(r"\d+", running_version())), 0, 0)[:2]
    defines = {
        "BOARD_FIRMWARE_VERSION": str(256 * major_version + minor_version),
        **actuator_defines(actuator),
    }
    defines["BOARD_BODY"] = f'"{controller_kind}/{controller_kind}.h"'
    if board.port_header and (folder / "port" / board.port_header).is_file():
        include.append(folder / "port")
        defines["ANHYST_PORT_HEADER"] = f'"{board.port_header}"'
    preprocessor_options = [f"-I{folder}" for folder in include]
    preprocessor_options += [f"-D{macro}={value}" for macro, value in defines.items()]
    options = ["-std=c99", *_WARNINGS, *board.options]
    if board.cpu:
        options += ["-T", str(board_folders[0] / "board.ld")]
    run_compiler, output_options = partial(_run_compiler, board=name), ["-o", str(program)]
    compile_and_link(
        _compiler_command(name), options, preprocessor_options, sources, output_options, run_compiler
    )


def _compiler_command(name: str) -> list[str]:
    board = BOARDS[name]
    if board.cpu:
        if importlib.util.find_spec("ziglang") is None:
            text = f"board {name}: ziglang is not installed: pip install 'anhyst[verify]'"
            raise InputError(text, code="not-installed", key="ziglang")
        zig_command = [sys.executable, "-m", "ziglang", "cc"]
        return [*zig_command, *_THUMB_OPTIONS, f"-mcpu={board.cpu}", *_FREESTANDING_OPTIONS, *_SIZE_OPTIONS]
    check_runs_here(name)
    for compiler_name in ("cc", "gcc", "clang"):
        if shutil.which(compiler_name):
            return [compiler_name, "-O2"]
    text = f"board {name}: a C compiler is not installed: apt install gcc libc6-dev"
    raise InputError(text, code="not-installed", key="gcc")


def _run_compiler(command: Sequence[str], board: str) -> str:
    try:
        result = subprocess.run(
            command,
            capture_output=True,
            text=True,
            timeout=_COMPILE_TIME_LIMIT_S,
            check=False,
            # The compiler finds linker scripts from this folder.
            cwd=firmware_folder() / "boards" / "cortex-m",
        )
    except subprocess.TimeoutExpired:
        raise NegativeResult(
            f"board {board}: the compiler did not end within {_COMPILE_TIME_LIMIT_S:.0f} s", code="time-limit"
        ) from None
    if result.returncode:
        lines = [line for line in result.stderr.splitlines() if "error" in line] or ["no reason"]
        raise NegativeResult(f"board {board}: does not compile: {lines[0]}", code="does-not-compile")
    return result.stderr
