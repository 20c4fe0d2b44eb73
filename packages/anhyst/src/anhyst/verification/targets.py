"""The targets by name, and how the C is built for each."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Protocol

from anhyst.compilation.toolchain import (
    FREESTANDING,
    Build,
    Missing,
    compile_c,
    compile_cortex_m,
    missing_modules,
    missing_programs,
    zig_cc,
)
from anhyst.support.errors import InputError, NegativeResult, wrong_key
from anhyst.support.registry import Registry
from anhyst.verification import protocol
from anhyst.verification.bundle import PLAY, PORT_HEADER, Bundle
from anhyst.verification.compare import HARNESS, Variant, Workshop
from anhyst.verification.elf import read_image
from anhyst.verification.emulators import CortexProgram, Msp430Program, build_counter
from anhyst.verification.result import TargetResult

TIME_LIMIT = 1800.0


@dataclass(frozen=True, slots=True)
class ProcessProgram:
    """A command that answers requests."""

    name: str  # target and build, for messages
    command: tuple[str, ...]  # what to run

    def run(self, requests: Sequence[protocol.Request]) -> list[protocol.Reply]:
        """Answer one request after the other, from reset."""
        reason = b"".join(request.pack() + request.pack_rows() for request in requests)
        try:
            done = subprocess.run(
                self.command, input=reason, capture_output=True, timeout=TIME_LIMIT, check=False
            )
        except subprocess.TimeoutExpired:
            raise protocol.too_slow(self.name, TIME_LIMIT) from None
        size = requests[0].box_bytes
        if done.returncode or len(done.stdout) != len(requests) * size:
            raise protocol.target_failed(self.name, _reason(done.stderr, done.returncode))
        boxes = range(0, len(done.stdout), size)
        return [protocol.Reply.unpack(done.stdout[at : at + size]) for at in boxes]


def _reason(stderr: bytes, code: int) -> str:
    lines = [line.strip() for line in stderr.decode(errors="replace").splitlines()]
    for line in lines:
        if "runtime error" in line or "ERROR" in line:
            return line
    reason = next((line for line in reversed(lines) if line), "no reason given")
    return f"the program ended with {code}: {reason}"


Order = Callable[[], Variant]
"""A build that has not been made yet."""


@dataclass(frozen=True, slots=True)
class Offer:
    """What can be built for a target with the tools that are there, and which are not."""

    orders: tuple[Order, ...] = ()  # empty where the target cannot run
    # tools that would be needed, or with which more could be built
    missing: tuple[Missing, ...] = ()


Maker = Callable[[Workshop], Offer]

PORT_DEFINE = {"ANHYST_PORT_HEADER": f'"{Path(PORT_HEADER).name}"'}
PORTED = ", port header"
OPTIMISATIONS = ("-O0", "-O2", "-O3")
SANITIZE = ("-O1", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
HOST_COMPILERS = {"gcc": "gcc", "clang": "clang"}
SANITIZERS = {"gcc": "libgcc-12-dev", "clang": "libclang-rt-dev"}
"""Packages with the libraries of their sanitizers."""

AVR_CPU = "atmega1284p"
AVR_DATA = 0x800000
SIMAVR_HEADERS = Path("/usr/include/simavr")


@dataclass(frozen=True, slots=True)
class Cortex:
    """A processor: as the compiler and the emulator call it, and what it may have beyond others."""

    cpu: str  # names of compiler and emulator
    model: str
    # what the compiler is asked to use floating-point instructions; empty without
    float_unit: str = ""
    has_port: bool = False  # whether it has the instructions of the port header


CORTEX = {
    "cortex-m0plus": Cortex("cortex_m0plus", "UC_CPU_ARM_CORTEX_M0"),
    "cortex-m3": Cortex("cortex_m3", "UC_CPU_ARM_CORTEX_M3"),
    "cortex-m4": Cortex("cortex_m4", "UC_CPU_ARM_CORTEX_M4", "+vfp4d16sp", has_port=True),
    "cortex-m33": Cortex("cortex_m33", "UC_CPU_ARM_CORTEX_M33", "+fp_armv8d16sp"),
    "cortex-m7": Cortex("cortex_m7", "UC_CPU_ARM_CORTEX_M7", "+fp_armv8d16sp", has_port=True),
}


def host_compilers() -> dict[str, list[str]]:
    """Return the commands of the compilers for this machine that are there, by name.

    Those that a report names; where there is none of them, any other.
    """
    compilers = {name: [name] for name in HOST_COMPILERS if shutil.which(name)}
    if compilers:
        return compilers
    if shutil.which("cc"):
        return {"cc": ["cc"]}
    return {} if missing_modules("host", ["ziglang"]) else {"zig cc": zig_cc("host")}


def reference(workshop: Workshop) -> Variant:
    """Build what all others are compared with: the C on this machine."""
    for name, command in host_compilers().items():
        return _host(workshop, name, command, ("-O2",))
    raise InputError(
        "no C compiler for this machine, which all targets are compared with: apt install gcc, or "
        "pip install 'anhyst[verify]'",
        code="not-installed",
        key="gcc",
    )


def host(workshop: Workshop) -> Offer:
    """Return the builds for this machine: each compiler at each optimisation, and sanitizers."""
    orders: list[Order] = []
    missing = list(missing_programs("host", HOST_COMPILERS))
    for name, command in host_compilers().items():
        settings: list[tuple[str, ...]] = [(level,) for level in OPTIMISATIONS]
        if name in SANITIZERS:
            if _has_sanitizers(command, workshop.folder):
                settings.append(SANITIZE)
            else:
                tool = f"sanitizers of {name}"
                missing.append(Missing("host", tool, f"apt install {SANITIZERS[name]}"))
        orders += [partial(_host, workshop, name, command, flags) for flags in settings]
    return Offer(tuple(orders), tuple(missing))


def _has_sanitizers(command: Sequence[str], folder: Path) -> bool:
    probe = folder / "probe.c"
    probe.write_text("int main(void) { return 0; }\n", encoding="ascii")
    try:
        compile_c(command, Build((probe,), flags=SANITIZE), folder / "probe", "host")
    except NegativeResult:
        return False
    return True


def _host(workshop: Workshop, name: str, command: list[str], flags: tuple[str, ...]) -> Variant:
    sanitized = flags == SANITIZE
    title = f"{name} sanitizers" if sanitized else f"{name} {flags[0]}"
    program = workshop.folder / f"host-{title.replace(' ', '-')}"
    label = f"host ({title})"
    warnings = compile_c(command, workshop.build("host", *flags), program, label)
    process = ProcessProgram(label, (str(program),))
    return Variant("host", title, process, "", "this machine", name, warnings)


def cortex_m(name: str, workshop: Workshop) -> Offer:
    """Return the builds for a Cortex-M: without and with its own instructions, if it has some.

    In fixed point those are the port header's, in floating point those of its floating-point unit.
    A stage is not run without that, nor without the port header where there is one.
    """
    if missing := missing_modules(name, ["ziglang", "unicorn", "elftools", "capstone"]):
        return Offer(missing=missing)
    counter = build_counter(HARNESS, workshop.folder, name)
    floating = workshop.bundle.io == "f32"
    has_port = CORTEX[name].has_port and workshop.bundle.has_port
    builds = [("soft float" if floating else "portable", "")]
    if floating and CORTEX[name].float_unit:
        builds = [] if workshop.form is not None else builds
        builds.append((f"hard float{PORTED if has_port else ''}", CORTEX[name].float_unit))
    elif has_port:
        builds.append(("port header", ""))
    return Offer(tuple(partial(_cortex, name, workshop, counter, *build) for build in builds))


def _cortex(name: str, workshop: Workshop, counter: Path, title: str, float_unit: str) -> Variant:
    cpu = CORTEX[name].cpu + float_unit
    build = workshop.build("cortex_m", "-O2", "-Wl,--gc-sections")
    if title.endswith("port header"):
        build = replace(build, defines={**build.defines, **PORT_DEFINE})
    path = workshop.folder / f"{name}-{title.replace(' ', '-').replace(',', '')}.elf"
    warnings = compile_cortex_m(cpu, build, HARNESS / "cortex_m.ld", path)
    image = read_image(path)
    program = CortexProgram(name, CORTEX[name].model, image, counter)
    return Variant(name, title, program, "instructions", cpu, "zig cc -O2", warnings, image)


def avr(workshop: Workshop) -> Offer:
    """Return the build for an ATmega, run by simavr."""
    missing = list(missing_programs("avr", {"avr-gcc": "gcc-avr avr-libc"}))
    missing += missing_modules("avr", ["elftools"])
    compilers = list(host_compilers().values())
    if not compilers:
        missing += missing_programs("avr", HOST_COMPILERS)
    if not (SIMAVR_HEADERS / "sim_avr.h").exists():
        missing.append(Missing("avr", "libsimavr", "apt install libsimavr-dev libelf-dev"))
    if missing:
        return Offer(missing=tuple(missing))
    return Offer((partial(_avr, workshop, compilers[0]),))


def _avr(workshop: Workshop, host_compiler: list[str]) -> Variant:
    path = workshop.folder / "avr.elf"
    build = workshop.build("avr", "-O2", f"-mmcu={AVR_CPU}", "-Wl,--gc-sections")
    warnings = compile_c(["avr-gcc"], build, path, "avr")
    image = read_image(path)
    runner = workshop.folder / "avr_runner"
    headers = [str(SIMAVR_HEADERS), str(SIMAVR_HEADERS / "avr")]
    # simavr's own headers are not clean under this project's warnings.
    flags = ("-O2", *(f"-isystem{folder}" for folder in headers), "-Wno-conversion")
    source = Build((HARNESS / "avr_runner.c",), flags=flags, libraries=("-lsimavr", "-lelf"))
    compile_c(host_compiler, source, runner, "avr")
    places = (image.address(name) - AVR_DATA for name in ("harness_box", "harness_count"))
    numbers = (*places, protocol.REQUEST_BYTES, protocol.WINDOW_OFFSET, protocol.BOX_BYTES)
    program = ProcessProgram("avr", (str(runner), str(path), AVR_CPU, *map(str, numbers)))
    return Variant("avr", "portable", program, "cycles", AVR_CPU, "avr-gcc -O2", warnings, image)


def msp430(workshop: Workshop) -> Offer:
    """Return the build for an MSP430 with a hardware multiplier, run by mspdebug's simulator."""
    missing = (
        *missing_programs("msp430", {"mspdebug": "mspdebug"}),
        *missing_modules("msp430", ["ziglang", "elftools"]),
    )
    if missing:
        return Offer(missing=missing)
    return Offer((partial(_msp430, workshop),))


def _msp430(workshop: Workshop) -> Variant:
    path = workshop.folder / "msp430.elf"
    compiler = [*zig_cc("msp430"), "-target", "msp430-freestanding-none", *FREESTANDING]
    compiler += ["-T", str(HARNESS / "msp430.ld"), "-Wl,--entry=reset"]
    # 56 KiB of flash hold a whole position controller only where it is compiled for size.
    level = "-Os" if workshop.subject == "controller" else "-O2"
    # Without -g the linker drops the symbols.
    build = workshop.build("msp430", level, "-g", "-Wl,--gc-sections")
    warnings = compile_c(compiler, build, path, "msp430")
    image = read_image(path)
    program, chip = Msp430Program(path, image), "MSP430, 16x16 multiplier"
    made_by = f"zig cc {level}"
    return Variant("msp430", "portable", program, "cycles", chip, made_by, warnings, image)


TARGETS: Mapping[str, Maker] = {
    "host": host,
    **{name: partial(cortex_m, name) for name in CORTEX},
    "avr": avr,
    "msp430": msp430,
}


class WholeTarget(Protocol):
    """A target that runs a whole program around a compensator: another package builds it."""

    def missing_tools(self) -> tuple[Missing, ...]:
        """Return what it would need and is not there."""

    def verify(self, bundle: Bundle, folder: Path, steps: int, seed: int) -> TargetResult:
        """Run a bundle; ``folder`` is for what is built."""


def _fault_of(target: object, _: str) -> str:
    """Say what keeps a target of another package from being used; empty where nothing does."""
    work = (getattr(target, name, None) for name in ("missing_tools", "verify"))
    return "" if all(map(callable, work)) else "and it is no target"


WHOLE_TARGETS: Registry[WholeTarget] = Registry("anhyst.targets", {}, _fault_of, taken=TARGETS)
"""By name: the entry points ``anhyst.targets`` of installed packages."""

FLOATING = ("host", *CORTEX)
"""Where single precision and stages are compared."""


def parse_targets(names: str, bundle: Bundle) -> list[str]:
    """Read a list such as ``host,cortex-m4``."""
    targets = list(dict.fromkeys(name.strip() for name in names.split(",") if name.strip()))
    known = (*TARGETS, *WHOLE_TARGETS)
    if not targets:
        raise wrong_key("--on", f"no target; known are {', '.join(known)}", code="no-target")
    for name in targets:
        if why := WHOLE_TARGETS.why_unusable(name):
            raise InputError(f"--on: {name}: {why}", code="not-installed", key="--on")
        if name not in known:
            more = "; cortex-m3-qemu is in the package anhyst-rigs" * (name == "cortex-m3-qemu")
            text = f"unknown target {name}; known are {', '.join(known)}{more}"
            raise wrong_key("--on", text, code="unknown-target")
        if bundle.stage and name not in FLOATING:
            text = f"{name} is not for the controller of a stage; give {', '.join(FLOATING)}"
            raise wrong_key("--on", text, code="target-not-for-this")
        if bundle.io == "f32" and name not in FLOATING:
            text = f"{name} is not for f32; compile with --io q15 or q31 for it"
            raise wrong_key("--on", text, code="target-not-for-this")
        if bundle.kind == PLAY and name in WHOLE_TARGETS:
            text = f"{name} is built around a compensator, not a map with one play"
            raise wrong_key("--on", text, code="target-not-for-this")
    return targets
