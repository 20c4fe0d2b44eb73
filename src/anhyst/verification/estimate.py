"""How long a step would take on a 16-bit digital signal controller that nobody can emulate.

The Freescale 56F8322 of the paper (core 56800E, 60 MHz) has no open emulator and no open compiler.
Its cycles are estimated from the machine code of another processor with plain instructions, the
Cortex-M0+, whose every instruction is put into a class with a price. The prices are assumptions,
stated in :data:`PRICES`; the counts are measured.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from anhyst.verification.elf import FLASH, Image

CLOCK_HZ = 60e6
SOURCE = "cortex-m0plus"

Prefix = NDArray[np.uint32]


@dataclass(frozen=True, slots=True)
class Prices:
    """Cycles of each class of instruction."""

    simple: int  # addition, logic, shift, comparison, move, of 16 or 32 bits
    multiply: int  # one 16x16 product
    memory: int  # A load or store, a word on the stack included
    branch: int  # A conditional or unconditional branch, taken or not
    call: int  # A call or a return


PRICES: Mapping[str, Prices] = {
    "at best": Prices(simple=1, multiply=1, memory=1, branch=1, call=1),
    "cautious": Prices(simple=1, multiply=1, memory=2, branch=5, call=8),
}
"""``at best``: everything in one cycle, branches as if they cost nothing extra. ``cautious``: every
memory access is two of 16 bits, every branch is taken and the pipeline refilled."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """Cycles of one part of a step, worst case, and the rate they would allow."""

    part: str  # part of the step
    prices: str  # which of :data:`PRICES`
    cycles: int  # most over all steps
    rate: float  # ticks a second at :data:`CLOCK_HZ` if nothing else ran, Hz


def costs_of(prices: Prices, image: Image, code: bytes) -> Prefix:
    """Price each instruction of a Thumb program: the cycles before each half-word."""
    import capstone

    decoder = capstone.Cs(capstone.CS_ARCH_ARM, capstone.CS_MODE_THUMB | capstone.CS_MODE_MCLASS)
    cycles = np.zeros(len(code) // 2, dtype=np.uint32)
    for begin, end in image.thumb_ranges():
        for instruction in decoder.disasm(code[begin - FLASH : end - FLASH], begin):
            cycles[(instruction.address - FLASH) // 2] = _price(prices, instruction)
    return np.concatenate(([np.uint32(0)], np.cumsum(cycles, dtype=np.uint32)))


def _price(prices: Prices, instruction: Any) -> int:
    name = str(instruction.mnemonic).split(".")[0]
    if name in {"bl", "blx", "bx"}:
        return prices.call
    if name in {"push", "pop", "ldm", "stm", "ldmia", "stmia"}:
        operands = str(instruction.op_str).partition("{")[2]
        registers = operands.count(",") + 1
        return registers * prices.memory + (prices.call if "pc" in operands else 0)
    if name.startswith(("ldr", "str")):
        return prices.memory
    if name.startswith("mul"):
        return prices.multiply
    if name.startswith("b") and name not in {"bic", "bics"}:
        return prices.branch
    return prices.simple
