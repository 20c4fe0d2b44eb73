"""Test the instructions of the Cortex-M4 header in an emulator against exact integers."""

from __future__ import annotations

import io
import random
import struct
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.repository import ROOT

# Applies each operator to two rows of words; the third row contains the results.
SOURCE = """
#include "anhyst/numeric/fixed.h"
void every(const int32_t *a, const int32_t *b, int32_t *out, int32_t n, int32_t which)
{
  for (int32_t i = 0; i < n; i++) {
    switch (which) {
    case 0: out[i] = anhyst_scale(a[i], (int16_t)b[i]); break;
    case 1: out[i] = anhyst_add_q31(a[i], b[i]); break;
    case 2: out[i] = anhyst_sub_q31(a[i], b[i]); break;
    case 3: out[i] = anhyst_sat_q15(a[i]); break;
    case 4: out[i] = anhyst_sat_u15(a[i]); break;
    case 5: out[i] = anhyst_sat_q28(a[i]); break;
    case 6: out[i] = anhyst_sat_q30(a[i]); break;
    default: out[i] = anhyst_headroom((a[i] & 0x7FFFFFFF) == 0 ? 1 : a[i] & 0x7FFFFFFF);
    }
  }
}
"""
LOW, HIGH = -(2**31), 2**31 - 1


def package(name: str) -> Any:
    return pytest.importorskip(name, reason=f"{name} is missing: pip install 'anhyst[verify]'")


def saturated(exact: int) -> int:
    return max(LOW, min(HIGH, exact))


def low_half(word: int) -> int:
    return (word + 2**15) % 2**16 - 2**15


def positive(word: int) -> int:
    return word & HIGH or 1


ORACLES: list[Callable[[int, int], int]] = [
    lambda a, b: a * low_half(b) // 65536,
    lambda a, b: saturated(a + b),
    lambda a, b: saturated(a - b),
    lambda a, b: max(-(2**15), min(2**15 - 1, a)),
    lambda a, b: max(0, min(2**15 - 1, a)),
    lambda a, b: max(-(2**28), min(2**28 - 1, a)),
    lambda a, b: max(-(2**30), min(2**30 - 1, a)),
    lambda a, b: 31 - positive(a).bit_length(),
]


def words() -> tuple[list[int], list[int]]:
    """Return two rows: edge values with edge values, then pseudo-random numbers of all magnitudes."""
    powers = [sign * 2**k + d for k in range(0, 31, 3) for sign in (-1, 1) for d in (-1, 0, 1)]
    edges = sorted({LOW, LOW + 1, HIGH - 1, HIGH, *powers})
    draw = random.Random(4)
    loose = [saturated(draw.getrandbits(32) + LOW) >> draw.randrange(32) for _ in range(8000)]
    pairs = [(a, b) for a in edges for b in edges] + list(zip(loose[::2], loose[1::2], strict=True))
    return [a for a, _ in pairs], [b for _, b in pairs]


def compile_object(folder: Path, header: str | None) -> bytes:
    """Return the code of ``every`` for a Cortex-M4; it calls no other function."""
    source, image = folder / "every.c", folder / "every.elf"
    source.write_text(SOURCE, encoding="utf-8")
    command = [sys.executable, "-m", "ziglang", "cc", "-target", "thumb-freestanding-eabi"]
    command += ["-mcpu=cortex_m4", "-ffreestanding", "-nostdlib", "-fno-sanitize=undefined", "-O2"]
    command += ["-std=c99", "-Wall", "-Wextra", "-Werror", "-Wno-error=unused-command-line-argument"]
    command += [f"-I{ROOT / 'core/include'}", f"-I{ROOT / 'core/port'}", "-Wl,-e,every"]
    if header:
        command.append(f'-DANHYST_PORT_HEADER="{header}"')
    completed = subprocess.run(
        [*command, str(source), "-o", str(image)], capture_output=True, text=True, check=False
    )
    assert completed.returncode == 0, completed.stderr
    return image.read_bytes()


def run(image: bytes, which: int, a: list[int], b: list[int]) -> list[int]:
    """Run ``every`` in the emulator, and return its row of results."""
    unicorn = package("unicorn")
    arm = package("unicorn.arm_const")
    machine = unicorn.Uc(unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS)
    machine.ctl_set_cpu_model(arm.UC_CPU_ARM_CORTEX_M4)
    machine.mem_map(0, 0x100000)
    machine.mem_map(0x20000000, 0x100000)
    elf = package("elftools.elf.elffile").ELFFile(io.BytesIO(image))
    for segment in elf.iter_segments("PT_LOAD"):
        machine.mem_write(segment["p_vaddr"], segment.data())
    rows, stack, back = 0x20000000, 0x200FFF00, 0xFFFF0
    n = len(a)
    machine.mem_write(rows, struct.pack(f"<{2 * n}i", *a, *b))
    machine.mem_write(stack, struct.pack("<i", which))
    arguments = (rows, rows + 4 * n, rows + 8 * n, n)
    registers = (arm.UC_ARM_REG_R0, arm.UC_ARM_REG_R1, arm.UC_ARM_REG_R2, arm.UC_ARM_REG_R3)
    for register, value in zip(registers, arguments, strict=True):
        machine.reg_write(register, value)
    machine.reg_write(arm.UC_ARM_REG_SP, stack)
    machine.reg_write(arm.UC_ARM_REG_LR, back | 1)
    machine.emu_start(elf.header["e_entry"] | 1, back)
    return list(struct.unpack(f"<{n}i", machine.mem_read(rows + 8 * n, 4 * n)))


@pytest.mark.parametrize("header", [None, "anhyst_port_cortex_m4.h"], ids=["portable", "port"])
def test_operators_are_exact_on_an_emulated_cortex_m4(tmp_path: Path, header: str | None) -> None:
    package("ziglang")
    image = compile_object(tmp_path, header)
    a, b = words()
    for which, oracle in enumerate(ORACLES):
        expected = [oracle(x, y) for x, y in zip(a, b, strict=True)]
        assert run(image, which, a, b) == expected


def test_the_header_s_instructions_are_really_used(tmp_path: Path) -> None:
    package("ziglang")
    capstone = package("capstone")
    elf = package("elftools.elf.elffile").ELFFile(
        io.BytesIO(compile_object(tmp_path, "anhyst_port_cortex_m4.h"))
    )
    text = elf.get_section_by_name(".text")
    machine = capstone.Cs(capstone.CS_ARCH_ARM, capstone.CS_MODE_THUMB | capstone.CS_MODE_MCLASS)
    used = {line.mnemonic for line in machine.disasm(text.data(), text["sh_addr"])}
    assert {"smulwb", "qadd", "qsub", "clz"} <= used
