"""Run test programs on emulated processors: Cortex-M by Unicorn, MSP430 by mspdebug's simulator."""

from __future__ import annotations

import ctypes
import re
import subprocess
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from anhyst.compilation.toolchain import Build, compile_c, zig_cc
from anhyst.support.errors import NegativeResult
from anhyst.verification.elf import FLASH_ADDRESS, Image, Prefix
from anhyst.verification.protocol import (
    BOX_BYTES,
    VECTORS,
    WINDOW_OFFSET,
    Reply,
    Request,
    target_failed_error,
    time_limit_error,
)

TIME_LIMIT_S = 60.0  # time limit of an answer
TIME_PER_STEP_S = 0.02  # additional time limit for each step; solid iron takes 1 ms
FLASH_BYTES = 256 * 1024
RAM_ADDRESS = 0x20000000
RAM_BYTES = 64 * 1024

CostFunction = Callable[[Image, bytes], Prefix]


class _Counter(ctypes.Structure):
    """Structure of ``harness/counter.c``."""

    _fields_ = (
        ("code_begin", ctypes.c_uint32),
        ("code_end", ctypes.c_uint32),
        ("prefix", ctypes.POINTER(ctypes.c_uint32)),
        ("start", ctypes.c_uint32),
        ("stop", ctypes.c_uint32),
        ("result", ctypes.c_void_p),
        ("count", ctypes.c_uint64),
    )


def build_counter(harness: Path, folder: Path, target: str) -> Path:
    """Compile the hook that counts instructions, for this machine."""
    build = Build((harness / "counter.c",), flags=("-O2", "-shared", "-fPIC"))
    library = folder / "counter.so"
    compile_c(zig_cc(target), build, library, target)
    return library


def count_instructions(image: Image, code: bytes) -> Prefix:
    """Return the number of instructions before each half-word, as prefix sums."""
    halfwords = np.frombuffer(code, dtype="<u2")
    instruction_starts = np.zeros(len(halfwords), dtype=np.uint32)
    for begin, stop in image.thumb_ranges():
        index, end = (begin - FLASH_ADDRESS) // 2, (stop - FLASH_ADDRESS) // 2
        while index < end:
            instruction_starts[index] = 1
            index += 2 if halfwords[index] >= 0xE800 else 1  # Thumb instruction of 32 or 16 bits
    return np.concatenate(([np.uint32(0)], np.cumsum(instruction_starts, dtype=np.uint32)))


@dataclass(frozen=True, slots=True)
class CortexProgram:
    """Linked test program for a Cortex-M."""

    name: str  # target, for messages
    cpu: str  # Unicorn's name of the processor
    image: Image  # the program
    counter: Path  # compiled hook that counts instructions
    # costs of the code, as prefix sums over half-words
    costs: CostFunction = count_instructions

    def run(self, requests: Sequence[Request]) -> list[Reply]:
        """Reset the program once, and then answer all requests; repeat once after a time limit.

        A run is repeated because the emulator has hung in the past.
        """
        try:
            return self._run(requests)
        except NegativeResult as error:
            if error.code != "time-limit":
                raise
            return self._run(requests)

    def _run(self, requests: Sequence[Request]) -> list[Reply]:
        machine = _Machine(self)
        return [machine.answer(request) for request in requests]


class _Machine:
    """Emulated processor with memory, stopped at harness_wait."""

    def __init__(self, program: CortexProgram) -> None:
        unicorn: Any = import_module("unicorn")
        arm_const: Any = import_module("unicorn.arm_const")
        self._name, self._error, self._registers = program.name, unicorn.UcError, arm_const
        thumb = unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS
        self._uc: Any = unicorn.Uc(unicorn.UC_ARCH_ARM, thumb)
        self._uc.ctl_set_cpu_model(getattr(arm_const, program.cpu))
        self._ram = (ctypes.c_ubyte * RAM_BYTES)()
        self._uc.mem_map(FLASH_ADDRESS, FLASH_BYTES, unicorn.UC_PROT_READ | unicorn.UC_PROT_EXEC)
        access = unicorn.UC_PROT_READ | unicorn.UC_PROT_WRITE
        self._uc.mem_map_ptr(RAM_ADDRESS, RAM_BYTES, access, ctypes.addressof(self._ram))
        for address, content in program.image.segments:
            self._uc.mem_write(address, content)
        self._box = program.image.address("harness_box") - RAM_ADDRESS
        self._wait = program.image.address("harness_wait")
        self._add_counting_hook(program)
        self._run_until_wait(program.image.address("reset"), program.image.address("link_stack_top"))

    def _add_counting_hook(self, program: CortexProgram) -> None:
        """Add the counting hook as native code, because Python would be 100 times slower."""
        unicorn: Any = import_module("unicorn")
        uclib: Any = import_module("unicorn.unicorn_py3.unicorn").uclib
        image = program.image
        code = bytes(self._uc.mem_read(FLASH_ADDRESS, FLASH_BYTES))
        self._prefix = np.ascontiguousarray(program.costs(image, code), dtype=np.uint32)
        prefix = self._prefix.ctypes.data_as(ctypes.POINTER(ctypes.c_uint32))
        clock = (image.address(f"harness_clock_{end}") for end in ("start", "stop"))
        result = ctypes.addressof(self._ram) + (image.address("harness_count") - RAM_ADDRESS)
        self._counter = _Counter(FLASH_ADDRESS, FLASH_ADDRESS + FLASH_BYTES, prefix, *clock, result, 0)
        self._library = ctypes.CDLL(str(program.counter))
        count = ctypes.cast(self._library.count_block, ctypes.c_void_p)
        hook, address_range = ctypes.c_size_t(), (ctypes.c_uint64(1), ctypes.c_uint64(0))
        block, counter_address = unicorn.UC_HOOK_BLOCK, ctypes.addressof(self._counter)
        status = uclib.uc_hook_add(
            self._uc._uch, ctypes.byref(hook), block, count, counter_address, *address_range
        )
        if status != unicorn.UC_ERR_OK:
            raise self._error(status)

    def _run_until_wait(self, address: int, stack: int | None = None, steps: int = 0) -> None:
        """Run until the program waits."""
        time_limit = TIME_LIMIT_S + TIME_PER_STEP_S * steps
        if stack is not None:
            self._uc.reg_write(self._registers.UC_ARM_REG_SP, stack)
        # Unicorn's own time limit would load a processor by polling the clock.
        watchdog = threading.Timer(time_limit, self._uc.emu_stop)
        watchdog.daemon = True
        watchdog.start()
        try:
            self._uc.emu_start(address | 1, self._wait)
        except self._error as error:
            program_counter = self._uc.reg_read(self._registers.UC_ARM_REG_PC)
            raise target_failed_error(self._name, f"{error} at {program_counter:#010x}") from None
        finally:
            watchdog.cancel()
        if self._uc.reg_read(self._registers.UC_ARM_REG_PC) != self._wait:
            raise time_limit_error(self._name, time_limit)

    def answer(self, request: Request) -> Reply:
        """Write a request into the mailbox, run, and read the mailbox."""
        for offset, content in ((0, request.pack()), (WINDOW_OFFSET, request.pack_rows())):
            ctypes.memmove(ctypes.addressof(self._ram) + self._box + offset, content, len(content))
        self._run_until_wait(self._uc.reg_read(self._registers.UC_ARM_REG_LR) & ~1, steps=request.steps)
        return Reply.unpack(bytes(self._ram[self._box : self._box + request.box_bytes]))


SIMULATOR_TIME_LIMIT_S = 1800.0
DUMP_LINE = re.compile(r"^\s+[0-9a-f]{5}: ((?:[0-9a-f]{2} ){1,16})\s*\|")
BYTES_PER_LINE = 16


@dataclass(frozen=True, slots=True)
class Msp430Program:
    """Linked test program for mspdebug."""

    path: Path
    image: Image  # content of the linked program

    def run(self, requests: Sequence[Request]) -> list[Reply]:
        """Reset the program once, and then answer all requests in their order."""
        script = self.path.with_suffix(".script")
        script.write_text("\n".join(self._simulator_commands(requests)) + "\n", encoding="ascii")
        command = ["mspdebug", "-q", "sim", f"read {script.name}"]
        try:
            process = subprocess.run(
                command,
                cwd=self.path.parent,
                capture_output=True,
                text=True,
                errors="replace",
                timeout=SIMULATOR_TIME_LIMIT_S,
                check=False,
            )
        except subprocess.TimeoutExpired:
            raise time_limit_error("msp430", SIMULATOR_TIME_LIMIT_S) from None
        mailbox_bytes = bytes(
            int(byte, 16)
            for line in process.stdout.splitlines()
            if (match := DUMP_LINE.match(line))
            for byte in match[1].split()
        )
        if process.returncode or len(mailbox_bytes) != len(requests) * BOX_BYTES:
            output_lines = (
                process.stderr.strip() or process.stdout.strip() or "no reason given"
            ).splitlines()
            raise target_failed_error("msp430", f"mspdebug ended early: {output_lines[-1]}")
        return [
            Reply.unpack(mailbox_bytes[offset : offset + BOX_BYTES])
            for offset in range(0, len(mailbox_bytes), BOX_BYTES)
        ]

    def _simulator_commands(self, requests: Sequence[Request]) -> list[str]:
        """Return the simulator's commands.

        Memory is written by ``mw`` and read by ``md``, because ``load_raw`` and ``save_raw`` reset
        the processor. A ``run`` at a breakpoint would stop immediately, so one ``step`` precedes
        it.
        """
        box = self.image.address("harness_box")
        lines = [
            f"prog {self.path.name}",
            "simio add timer fast",
            "simio add timer slow",
            "simio config slow base 0x180",
            "simio add hwmult multiplier",
            f"setbreak {self.image.address('harness_wait'):#x}",
            "run",
        ]
        for request in requests:
            lines += _write_commands(box, request.pack())
            if request.mode == VECTORS:
                lines += _write_commands(box + WINDOW_OFFSET, request.pack_rows())
            lines += ["step", "run", f"md {box:#x} {BOX_BYTES}"]
        return [*lines, "exit"]


def _write_commands(address: int, content: bytes) -> list[str]:
    return [
        f"mw {address + offset:#x} "
        + " ".join(f"{byte:#04x}" for byte in content[offset : offset + BYTES_PER_LINE])
        for offset in range(0, len(content), BYTES_PER_LINE)
    ]
