"""List the targets by name, and build the C files for each of them.

Each target lists the builds that the installed tools allow, and the missing tools. Other packages
can add targets that run a whole firmware, with the entry point ``anhyst.targets``.
"""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Protocol

from anhyst.compilation.toolchain import (
    FREESTANDING_FLAGS,
    Build,
    MissingTool,
    compile_c,
    compile_cortex_m,
    missing_modules,
    missing_programs,
    zig_cc,
)
from anhyst.support.errors import InputError, NegativeResult, wrong_key
from anhyst.support.registry import Registry
from anhyst.verification import protocol
from anhyst.verification.bundle import PLAY_KIND, PORT_HEADER, Bundle
from anhyst.verification.compare import HARNESS_FOLDER, BuildFolder, Variant
from anhyst.verification.elf import read_image
from anhyst.verification.emulators import CortexProgram, Msp430Program, build_counter
from anhyst.verification.result import TargetResult

TIME_LIMIT_S = 1800.0


@dataclass(frozen=True, slots=True)
class ProcessProgram:
    """Test program that runs as a process and answers requests."""

    name: str  # target and build, for messages
    command: tuple[str, ...]  # command of the process

    def run(self, requests: Sequence[protocol.Request]) -> list[protocol.Reply]:
        """Reset the program once, and then answer all requests in their order."""
        requests_bytes = b"".join(request.pack() + request.pack_rows() for request in requests)
        try:
            process = subprocess.run(
                self.command, input=requests_bytes, capture_output=True, timeout=TIME_LIMIT_S, check=False
            )
        except subprocess.TimeoutExpired:
            raise protocol.time_limit_error(self.name, TIME_LIMIT_S) from None
        size = requests[0].box_bytes
        if process.returncode or len(process.stdout) != len(requests) * size:
            raise protocol.target_failed_error(self.name, _failure_reason(process.stderr, process.returncode))
        boxes = range(0, len(process.stdout), size)
        return [protocol.Reply.unpack(process.stdout[offset : offset + size]) for offset in boxes]


def _failure_reason(stderr: bytes, code: int) -> str:
    lines = [line.strip() for line in stderr.decode(errors="replace").splitlines()]
    for line in lines:
        if "runtime error" in line or "ERROR" in line:
            return line
    reason = next((line for line in reversed(lines) if line), "no reason given")
    return f"the program ended with {code}: {reason}"


PendingBuild = Callable[[], Variant]
"""Function that makes a build."""


@dataclass(frozen=True, slots=True)
class TargetBuilds:
    """Possible builds of a target with the installed tools, and the missing tools."""

    builds: tuple[PendingBuild, ...] = ()  # possible builds; empty if the target cannot run
    # tools that are required, or that would allow more builds
    missing: tuple[MissingTool, ...] = ()


FindTargetBuilds = Callable[[BuildFolder], TargetBuilds]

PORT_DEFINE = {"ANHYST_PORT_HEADER": f'"{Path(PORT_HEADER).name}"'}
PORT_SUFFIX = ", port header"
OPTIMISATIONS = ("-O0", "-O2", "-O3")
SANITIZE_FLAGS = ("-O1", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
HOST_COMPILERS = {"gcc": "gcc", "clang": "clang"}
SANITIZER_PACKAGES = {"gcc": "libgcc-12-dev", "clang": "libclang-rt-dev"}
"""System packages with the sanitizer libraries of each compiler."""

AVR_CPU = "atmega1284p"
AVR_DATA = 0x800000
SIMAVR_HEADERS = Path("/usr/include/simavr")


@dataclass(frozen=True, slots=True)
class CortexProcessor:
    """Names of a processor for compiler and emulator, and its optional units."""

    cpu: str  # name for the compiler, and for the emulator
    model: str
    # compiler option for the floating-point unit; empty without one
    float_unit: str = ""
    has_port: bool = False  # whether the processor has the DSP instructions of the port header


CORTEX_PROCESSORS = {
    "cortex-m0plus": CortexProcessor("cortex_m0plus", "UC_CPU_ARM_CORTEX_M0"),
    "cortex-m3": CortexProcessor("cortex_m3", "UC_CPU_ARM_CORTEX_M3"),
    "cortex-m4": CortexProcessor("cortex_m4", "UC_CPU_ARM_CORTEX_M4", "+vfp4d16sp", has_port=True),
    "cortex-m33": CortexProcessor("cortex_m33", "UC_CPU_ARM_CORTEX_M33", "+fp_armv8d16sp"),
    "cortex-m7": CortexProcessor("cortex_m7", "UC_CPU_ARM_CORTEX_M7", "+fp_armv8d16sp", has_port=True),
}


def host_compilers() -> dict[str, list[str]]:
    """Return the commands of the installed compilers for this machine, by name.

    The report uses these compilers. If none of them is installed, any other compiler is used.
    """
    compilers = {name: [name] for name in HOST_COMPILERS if shutil.which(name)}
    if compilers:
        return compilers
    if shutil.which("cc"):
        return {"cc": ["cc"]}
    return {} if missing_modules("host", ["ziglang"]) else {"zig cc": zig_cc("host")}


def build_reference(build_folder: BuildFolder) -> Variant:
    """Build the reference: the C files, compiled for this machine."""
    for name, command in host_compilers().items():
        return _build_host(build_folder, name, command, ("-O2",))
    raise InputError(
        "no C compiler for this machine, which all targets are compared with: apt install gcc, or "
        "pip install 'anhyst[verify]'",
        code="not-installed",
        key="gcc",
    )


def find_host_builds(build_folder: BuildFolder) -> TargetBuilds:
    """Find the builds for this machine: each compiler with each optimisation, and sanitizers."""
    builds: list[PendingBuild] = []
    missing_tools = list(missing_programs("host", HOST_COMPILERS))
    for name, command in host_compilers().items():
        settings: list[tuple[str, ...]] = [(level,) for level in OPTIMISATIONS]
        if name in SANITIZER_PACKAGES:
            if _has_sanitizers(command, build_folder.folder):
                settings.append(SANITIZE_FLAGS)
            else:
                tool = f"sanitizers of {name}"
                missing_tools.append(MissingTool("host", tool, f"apt install {SANITIZER_PACKAGES[name]}"))
        builds += [partial(_build_host, build_folder, name, command, flags) for flags in settings]
    return TargetBuilds(tuple(builds), tuple(missing_tools))


def _has_sanitizers(command: Sequence[str], folder: Path) -> bool:
    probe = folder / "probe.c"
    probe.write_text("int main(void) { return 0; }\n", encoding="ascii")
    try:
        compile_c(command, Build((probe,), flags=SANITIZE_FLAGS), folder / "probe", "host")
    except NegativeResult:
        return False
    return True


def _build_host(build_folder: BuildFolder, name: str, command: list[str], flags: tuple[str, ...]) -> Variant:
    is_sanitized = flags == SANITIZE_FLAGS
    title = f"{name} sanitizers" if is_sanitized else f"{name} {flags[0]}"
    program = build_folder.folder / f"host-{title.replace(' ', '-')}"
    label = f"host ({title})"
    warnings = compile_c(command, build_folder.make_build("host", *flags), program, label)
    process = ProcessProgram(label, (str(program),))
    return Variant("host", title, process, "", "this machine", name, warnings)


def find_cortex_m_builds(name: str, build_folder: BuildFolder) -> TargetBuilds:
    """List the builds for a Cortex-M: portable, and with optional instructions of the processor.

    Optional instructions are those of the port header in fixed point, and those of the
    floating-point unit in floating point. On a processor with this unit, a stage in floating point
    has a single build: with the unit, and with the port header if it exists.
    """
    if missing_tools := missing_modules(name, ["ziglang", "unicorn", "elftools", "capstone"]):
        return TargetBuilds(missing=missing_tools)
    counter = build_counter(HARNESS_FOLDER, build_folder.folder, name)
    is_float = build_folder.bundle.io == "f32"
    has_port = CORTEX_PROCESSORS[name].has_port and build_folder.bundle.has_port
    builds = [("soft float" if is_float else "portable", "")]
    if is_float and CORTEX_PROCESSORS[name].float_unit:
        builds = [] if build_folder.stage_record is not None else builds
        builds.append((f"hard float{PORT_SUFFIX if has_port else ''}", CORTEX_PROCESSORS[name].float_unit))
    elif has_port:
        builds.append(("port header", ""))
    return TargetBuilds(
        tuple(partial(_build_cortex_m, name, build_folder, counter, *build) for build in builds)
    )


def _build_cortex_m(
    name: str, build_folder: BuildFolder, counter: Path, title: str, float_unit: str
) -> Variant:
    cpu = CORTEX_PROCESSORS[name].cpu + float_unit
    build = build_folder.make_build("cortex_m", "-O2", "-Wl,--gc-sections")
    if title.endswith("port header"):
        build = replace(build, defines={**build.defines, **PORT_DEFINE})
    path = build_folder.folder / f"{name}-{title.replace(' ', '-').replace(',', '')}.elf"
    warnings = compile_cortex_m(cpu, build, HARNESS_FOLDER / "cortex_m.ld", path)
    image = read_image(path)
    program = CortexProgram(name, CORTEX_PROCESSORS[name].model, image, counter)
    return Variant(name, title, program, "instructions", cpu, "zig cc -O2", warnings, image)


def find_avr_builds(build_folder: BuildFolder) -> TargetBuilds:
    """List the build for an ATmega, run by simavr."""
    missing_tools = list(missing_programs("avr", {"avr-gcc": "gcc-avr avr-libc"}))
    missing_tools += missing_modules("avr", ["elftools"])
    compilers = list(host_compilers().values())
    if not compilers:
        missing_tools += missing_programs("avr", HOST_COMPILERS)
    if not (SIMAVR_HEADERS / "sim_avr.h").exists():
        missing_tools.append(MissingTool("avr", "libsimavr", "apt install libsimavr-dev libelf-dev"))
    if missing_tools:
        return TargetBuilds(missing=tuple(missing_tools))
    return TargetBuilds((partial(_build_avr, build_folder, compilers[0]),))


def _build_avr(build_folder: BuildFolder, host_compiler: list[str]) -> Variant:
    path = build_folder.folder / "avr.elf"
    build = build_folder.make_build("avr", "-O2", f"-mmcu={AVR_CPU}", "-Wl,--gc-sections")
    warnings = compile_c(["avr-gcc"], build, path, "avr")
    image = read_image(path)
    runner = build_folder.folder / "avr_runner"
    headers = [str(SIMAVR_HEADERS), str(SIMAVR_HEADERS / "avr")]
    # The headers of simavr cause warnings with the flags of this project.
    flags = ("-O2", *(f"-isystem{folder}" for folder in headers), "-Wno-conversion")
    source = Build((HARNESS_FOLDER / "avr_runner.c",), flags=flags, libraries=("-lsimavr", "-lelf"))
    compile_c(host_compiler, source, runner, "avr")
    box_addresses = (image.address(name) - AVR_DATA for name in ("harness_box", "harness_count"))
    numbers = (*box_addresses, protocol.REQUEST_BYTES, protocol.WINDOW_OFFSET, protocol.BOX_BYTES)
    program = ProcessProgram("avr", (str(runner), str(path), AVR_CPU, *map(str, numbers)))
    return Variant("avr", "portable", program, "cycles", AVR_CPU, "avr-gcc -O2", warnings, image)


def find_msp430_builds(build_folder: BuildFolder) -> TargetBuilds:
    """List the build for an MSP430 with a hardware multiplier, run by mspdebug's simulator."""
    missing_tools = (
        *missing_programs("msp430", {"mspdebug": "mspdebug"}),
        *missing_modules("msp430", ["ziglang", "elftools"]),
    )
    if missing_tools:
        return TargetBuilds(missing=missing_tools)
    return TargetBuilds((partial(_build_msp430, build_folder),))


def _build_msp430(build_folder: BuildFolder) -> Variant:
    path = build_folder.folder / "msp430.elf"
    compiler = [*zig_cc("msp430"), "-target", "msp430-freestanding-none", *FREESTANDING_FLAGS]
    compiler += ["-T", str(HARNESS_FOLDER / "msp430.ld"), "-Wl,--entry=reset"]
    # A whole position controller fits into 56 KiB of flash only if it is optimised for size, and if
    # only functions that are declared inline are copied into their callers.
    is_controller = build_folder.subject == "controller"
    level, size_flags = ("-Os", ["-finline-hint-functions"]) if is_controller else ("-O2", [])
    # Without -g, the linker removes the symbols.
    build = build_folder.make_build("msp430", level, *size_flags, "-g", "-Wl,--gc-sections")
    warnings = compile_c(compiler, build, path, "msp430")
    image = read_image(path)
    program, chip = Msp430Program(path, image), "MSP430, 16x16 multiplier"
    compiler_text = f"zig cc {level}"
    return Variant("msp430", "portable", program, "cycles", chip, compiler_text, warnings, image)


TARGETS: Mapping[str, FindTargetBuilds] = {
    "host": find_host_builds,
    **{name: partial(find_cortex_m_builds, name) for name in CORTEX_PROCESSORS},
    "avr": find_avr_builds,
    "msp430": find_msp430_builds,
}


class WholeTarget(Protocol):
    """Target of another package that runs a whole program with a compensator."""

    def missing_tools(self) -> tuple[MissingTool, ...]:
        """Return the missing tools."""

    def verify(self, bundle: Bundle, folder: Path, steps: int, seed: int) -> TargetResult:
        """Run a bundle; ``folder`` is for temporary files."""


def _find_target_fault(target: object, _: str) -> str:
    """Return the reason why a target of another package cannot be used; empty if it can."""
    target_functions = (getattr(target, name, None) for name in ("missing_tools", "verify"))
    return "" if all(map(callable, target_functions)) else "and it is not a target"


WHOLE_TARGETS: Registry[WholeTarget] = Registry(
    "anhyst.targets", {}, _find_target_fault, reserved_names=TARGETS
)
"""Targets by name, from the entry points ``anhyst.targets`` of installed packages."""

FLOAT_TARGETS = ("host", *CORTEX_PROCESSORS)
"""Targets that compare single precision and stages."""


def parse_targets(names: str, bundle: Bundle) -> list[str]:
    """Read a list of targets such as ``host,cortex-m4``."""
    targets = list(dict.fromkeys(name.strip() for name in names.split(",") if name.strip()))
    known_targets = (*TARGETS, *WHOLE_TARGETS)
    if not targets:
        raise wrong_key("--on", f"no target; known are {', '.join(known_targets)}", code="no-target")
    for name in targets:
        if reason := WHOLE_TARGETS.explain_unusable(name):
            raise InputError(f"--on: {name}: {reason}", code="not-installed", key="--on")
        if name not in known_targets:
            hint = "; cortex-m3-qemu is in the package anhyst-rigs" * (name == "cortex-m3-qemu")
            text = f"unknown target {name}; known are {', '.join(known_targets)}{hint}"
            raise wrong_key("--on", text, code="unknown-target")
        if bundle.stage and name not in FLOAT_TARGETS:
            text = f"{name} is not for the controller of a stage; give {', '.join(FLOAT_TARGETS)}"
            raise wrong_key("--on", text, code="target-not-for-this")
        if bundle.io == "f32" and name not in FLOAT_TARGETS:
            text = f"{name} is not for f32; compile with --io q15 or q31 for it"
            raise wrong_key("--on", text, code="target-not-for-this")
        if bundle.kind == PLAY_KIND and name in WHOLE_TARGETS:
            text = f"{name} is built around a compensator, not a map with one play"
            raise wrong_key("--on", text, code="target-not-for-this")
    return targets
