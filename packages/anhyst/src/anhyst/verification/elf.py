"""Read a linked program: memory image, symbols, sizes, worst-case stack, estimated cycles.

The 16-bit Freescale 56F8322 of the paper (core 56800E, 60 MHz) has no open emulator and no open
compiler. Its cycles are estimated from the machine code of the Cortex-M0+: each instruction belongs
to a class, and each class has a price in cycles. The instruction counts of the Cortex-M0+ are
measured. The prices are assumptions, listed in :data:`PRICES`.
"""

from __future__ import annotations

import math
import re
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from anhyst.compilation.toolchain import PIDD2_SOURCES

FLASH_ADDRESS = 0x08000000
"""Start of the code of a Cortex-M, as in ``harness/cortex_m.ld``."""

CONTROL_FILES = {name.rpartition("/")[2] for name in PIDD2_SOURCES}


@dataclass(frozen=True, slots=True)
class Symbol:
    """Function or object of a program; ``source`` is its C file if the linker knows it."""

    name: str
    address: int
    size: int
    kind: str
    section: str
    source: str


@dataclass(frozen=True, slots=True)
class Image:
    """A linked program."""

    segments: tuple[tuple[int, bytes], ...]  # load address and content
    symbols: tuple[Symbol, ...]  # functions and objects

    def address(self, name: str) -> int:
        """Return the address of a symbol, without the Thumb bit."""
        for symbol in self.symbols:
            if symbol.name == name:
                return symbol.address & ~1 if symbol.kind == "STT_FUNC" else symbol.address
        raise KeyError(name)

    def thumb_ranges(self) -> list[tuple[int, int]]:
        """Return begin and end of each range of Thumb code, without the constants in between.

        The linker marks these ranges with symbols called ``$t`` and ``$d``.
        """
        markers = sorted(
            (symbol.address & ~1, symbol.name[:2])
            for symbol in self.symbols
            if symbol.name[:2] in {"$t", "$d"} and symbol.section == ".text"
        )
        ends = [address for address, _ in markers[1:]]
        ends.append(max((f.address & ~1) + f.size for f in self.functions()))
        return [(begin, end) for (begin, name), end in zip(markers, ends, strict=True) if name == "$t"]

    def functions(self) -> list[Symbol]:
        """Return the functions, sorted by address."""
        functions = [symbol for symbol in self.symbols if symbol.kind == "STT_FUNC"]
        return sorted(functions, key=lambda symbol: symbol.address)


def read_image(path: Path) -> Image:
    """Read an ELF file."""
    from elftools.elf.elffile import ELFFile

    with path.open("rb") as stream:
        elf = ELFFile(stream)
        segments = tuple(
            (int(part["p_paddr"]), part.data())
            for part in elf.iter_segments()
            if part["p_type"] == "PT_LOAD" and part["p_filesz"]
        )
        return Image(segments, tuple(_symbols(elf)))


def _symbols(elf: Any) -> Iterator[Symbol]:
    """Yield the symbols; local ones follow the name of their source file."""
    source = ""
    for symbol in elf.get_section_by_name(".symtab").iter_symbols():
        kind, section_index = symbol["st_info"]["type"], symbol["st_shndx"]
        if kind == "STT_FILE":
            source = Path(symbol.name).name
            continue
        section = section_index
        if not isinstance(section_index, str):
            section = elf.get_section(section_index).name
        value, size = int(symbol["st_value"]), int(symbol["st_size"])
        is_local = symbol["st_info"]["bind"] == "STB_LOCAL"
        yield Symbol(symbol.name, value, size, kind, section, source if is_local else "")


@dataclass(frozen=True, slots=True)
class ProgramSizes:
    """Memory of the compensator in a linked program, bytes."""

    # machine code of the core: solve, commit, start-up and check of the block; without compiler
    # routines such as long multiplication
    code: int
    control_code: int  # machine code of the position controller
    tables: int  # constants of the core
    parameters: int  # parameter block; in floating point the structure and its tables
    variables: int  # static variables; 0, because the caller owns all state


def measure_sizes(
    image: Image, actuator: str, sources: Collection[str], constants_in_data: bool
) -> ProgramSizes:
    """Add up the sizes of all symbols of the compensator."""
    parameters = f"{actuator}_parameters"
    symbol_prefixes = ("anhyst_", parameters, f"{actuator}_controller")
    code = control = tables = parameters_bytes = variables = 0
    for symbol in image.symbols:
        is_counted = symbol.name.startswith(symbol_prefixes) or symbol.source in sources
        if symbol.kind == "STT_FUNC" and is_counted:
            if symbol.name.startswith("anhyst_pidd2") or symbol.source in CONTROL_FILES:
                control += symbol.size
            else:
                code += symbol.size
        elif symbol.kind == "STT_OBJECT" and is_counted:
            is_constant = symbol.section.startswith(".data" if constants_in_data else ".rodata")
            if symbol.name == parameters or symbol.source == f"{parameters}.c":
                parameters_bytes += symbol.size
            elif is_constant:
                tables += symbol.size
            else:
                variables += symbol.size
    return ProgramSizes(code, control, tables, parameters_bytes, variables)


WORD_BYTES = 4
UNKNOWN_OFFSET = -1
_LOAD_OPERANDS = re.compile(r"(\w+), \[\w+(?:, #((?:0x)?[0-9a-f]+))?\]")
_NUMBER = re.compile(r"#(-?(?:0x)?[0-9a-f]+)")


@dataclass(frozen=True, slots=True)
class _Function:
    """Stack use and calls of a function; ``referenced``: functions whose address it loads."""

    frame: int
    callees: frozenset[int]
    referenced: frozenset[int]
    # calls through a pointer: offset of the pointer in its table, or UNKNOWN_OFFSET
    pointer_offsets: frozenset[int]


def worst_case_stack(image: Image, roots: Iterable[str]) -> int | None:
    """Return the largest stack of a call of any of these functions, bytes; None if it is unbounded.

    Frames and calls are read from the code. A call through a pointer may reach each function whose
    address is at the same offset of a constant, or is not part of a constant. Functions that are
    already active are excluded, because no function calls itself through a pointer.
    """
    functions = {symbol.address & ~1: symbol for symbol in image.functions()}
    analysed_functions = {
        address: _analyse_function(image, symbol, functions) for address, symbol in functions.items()
    }
    functions_by_offset = _find_function_pointers(image, functions)
    functions_by_offset[UNKNOWN_OFFSET] = functions_by_offset[UNKNOWN_OFFSET].union(
        *(function.referenced for function in analysed_functions.values())
    )

    def pointer_targets(address: int) -> set[int]:
        if address == UNKNOWN_OFFSET:
            return set().union(*functions_by_offset.values())
        return functions_by_offset[address] | functions_by_offset[UNKNOWN_OFFSET]

    def stack_depth(address: int, running_functions: frozenset[int]) -> float:
        function, callers = analysed_functions[address], running_functions | {address}
        if function.callees & callers:
            return math.inf
        callees = function.callees.union(
            *(pointer_targets(pointer_offset) - callers for pointer_offset in function.pointer_offsets)
        )
        return function.frame + max((stack_depth(callee, callers) for callee in callees), default=0)

    deepest_stack = max(stack_depth(image.address(root), frozenset()) for root in roots)
    return None if deepest_stack == math.inf else int(deepest_stack)


def _find_function_pointers(image: Image, functions: dict[int, Symbol]) -> defaultdict[int, set[int]]:
    """Return the functions whose address is stored in a constant, by the offset of the address.

    Addresses that are stored outside constants have the offset UNKNOWN_OFFSET.
    """
    objects = (symbol for symbol in image.symbols if symbol.kind == "STT_OBJECT")
    offset_by_address = {
        item.address + offset: offset for item in objects for offset in range(0, item.size, WORD_BYTES)
    }
    callees: defaultdict[int, set[int]] = defaultdict(set)
    for address, content in image.segments:
        for at in range(0, len(content) - WORD_BYTES + 1, WORD_BYTES):
            word = int.from_bytes(content[at : at + WORD_BYTES], "little")
            if word & 1 and word & ~1 in functions:
                callees[offset_by_address.get(address + at, UNKNOWN_OFFSET)].add(word & ~1)
    return callees


def _instructions(image: Image, begin: int = 0, end: int = 1 << 32) -> Iterator[Any]:
    """Decode the Thumb code between two addresses, without the constants in between."""
    import capstone

    decoder = capstone.Cs(capstone.CS_ARCH_ARM, capstone.CS_MODE_THUMB | capstone.CS_MODE_MCLASS)
    for first_address, last_address in image.thumb_ranges():
        low, high = max(first_address, begin), min(last_address, end)
        for address, content in image.segments:
            if low < high and address <= low < address + len(content):
                yield from decoder.disasm(content[low - address : high - address], low)


def _analyse_function(image: Image, symbol: Symbol, functions: dict[int, Symbol]) -> _Function:
    """Add up the pushed bytes of a function, and list its calls."""
    begin = symbol.address & ~1
    frame, callees, referenced_addresses, pointer_offsets = 0, set(), set(), set()
    low_halves: dict[str, int] = {}
    loaded_addresses: dict[str, int] = {}
    for instruction in _instructions(image, begin, begin + symbol.size):
        name = instruction.mnemonic.split(".")[0]
        frame += _pushed_bytes(name, instruction.op_str)
        register, _, value = instruction.op_str.partition(", ")
        if name == "ldr" and (load := _LOAD_OPERANDS.fullmatch(instruction.op_str)):
            loaded_addresses[load[1]] = int(load[2] or "0", 0)
        elif name == "movw":
            low_halves[register] = _read_immediate_operand(value)
        elif name == "movt":
            referenced_addresses.add(
                (_read_immediate_operand(value) << 16 | low_halves.get(register, 0)) & ~1
            )
        elif name == "blx" or (name == "bx" and instruction.op_str != "lr"):
            pointer_offsets.add(loaded_addresses.get(instruction.op_str, UNKNOWN_OFFSET))
        elif name.startswith("b") and (number := _NUMBER.fullmatch(instruction.op_str)):
            target = int(number[1], 0)
            # A jump to the start of the same function is a loop, not a call.
            if target in functions and (target != begin or name == "bl"):
                callees.add(target)
    calls = frozenset(callees), frozenset(referenced_addresses & functions.keys()), frozenset(pointer_offsets)
    return _Function(frame, *calls)


def _read_immediate_operand(operands: str) -> int:
    number = _NUMBER.search(operands)
    return int(number[1], 0) if number else 0


def _pushed_bytes(name: str, operands: str) -> int:
    if name in {"push", "vpush"}:
        size = 2 * WORD_BYTES if operands.startswith("{d") else WORD_BYTES
        return size * sum(_count_registers(part) for part in operands.strip("{}").split(","))
    if name in {"sub", "subw"} and operands.startswith("sp,"):
        return _read_immediate_operand(operands)
    if name == "str" and "[sp, #-" in operands and operands.endswith("!"):
        return -_read_immediate_operand(operands)
    return 0


def _count_registers(part: str) -> int:
    first_register, _, last_register = part.strip().partition("-")
    return int(last_register[1:]) - int(first_register[1:]) + 1 if last_register else 1


CLOCK_HZ = 60e6
ESTIMATE_TARGET = "cortex-m0plus"

Prefix = NDArray[np.uint32]


Prices = Mapping[str, int]
"""Cycles of each class of instruction.

Classes are ``simple`` (addition, logic, shift, comparison, move, of 16 or 32 bits), ``multiply``
(one 16x16 product), ``memory`` (a load or store, also each word of a push or pop), ``branch``
(taken or not) and ``call`` (or return).
"""
PRICES: Mapping[str, Prices] = {
    "at best": {"simple": 1, "multiply": 1, "memory": 1, "branch": 1, "call": 1},
    "cautious": {"simple": 1, "multiply": 1, "memory": 2, "branch": 5, "call": 8},
}
"""Two assumptions about a 16-bit DSC.

``at best``: every instruction takes one cycle, and branches cost nothing extra. ``cautious``: every
memory access is two accesses of 16 bits, every branch is taken, and the pipeline is refilled.
"""


@dataclass(frozen=True, slots=True)
class Estimate:
    """Worst-case cycles of one part of a step, and the sample rate that they allow."""

    part: str  # part of the step
    prices: str  # name in :data:`PRICES`
    cycles: int  # maximum over all steps
    rate: float  # sample rate at :data:`CLOCK_HZ` without any other load, Hz


def instruction_prices(prices: Prices, image: Image, code: bytes) -> Prefix:
    """Return the cycles before each half-word of a Thumb program, as prefix sums of prices."""
    cycles = np.zeros(len(code) // 2, dtype=np.uint32)
    for instruction in _instructions(image):
        cycles[(instruction.address - FLASH_ADDRESS) // 2] = _instruction_price(prices, instruction)
    return np.concatenate(([np.uint32(0)], np.cumsum(cycles, dtype=np.uint32)))


def _instruction_price(prices: Prices, instruction: Any) -> int:
    name = str(instruction.mnemonic).split(".")[0]
    if name in {"bl", "blx", "bx"}:
        return prices["call"]
    if name in {"push", "pop", "ldm", "stm", "ldmia", "stmia"}:
        operands = str(instruction.op_str).partition("{")[2]
        registers = operands.count(",") + 1
        return registers * prices["memory"] + (prices["call"] if "pc" in operands else 0)
    if name.startswith(("ldr", "str")):
        return prices["memory"]
    if name.startswith("mul"):
        return prices["multiply"]
    if name.startswith("b") and name not in {"bic", "bics"}:
        return prices["branch"]
    return prices["simple"]
