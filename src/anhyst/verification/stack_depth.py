"""Worst-case stack of a Thumb program, read from its machine code."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from anhyst.verification.elf import Image, Symbol

WORD = 4
ANYWHERE = -1
_LOADED = re.compile(r"(\w+), \[\w+(?:, #((?:0x)?[0-9a-f]+))?\]")
_NUMBER = re.compile(r"#(-?(?:0x)?[0-9a-f]+)")


@dataclass(frozen=True, slots=True)
class _Function:
    """What one function does to the stack; ``named`` are functions whose address it forms."""

    frame: int
    callees: frozenset[int]
    named: frozenset[int]
    # calls through a pointer: where in its table that was read, ANYWHERE where that is not seen
    places: frozenset[int]


def stack_below(image: Image, roots: Iterable[str]) -> int | None:
    """Return the deepest stack of a call of any of these functions; bytes.

    Frames and calls are read from the code. A call through a pointer is taken to reach any
    function whose address stands at that place of a constant, or where it is no part of one, but
    none that is already running: nothing here calls itself through a pointer.
    """
    functions = {symbol.address & ~1: symbol for symbol in image.functions()}
    known = {address: _read(image, symbol, functions) for address, symbol in functions.items()}
    pointed = _in_constants(image, functions)
    pointed[ANYWHERE] = pointed[ANYWHERE].union(*(function.named for function in known.values()))

    def reached(address: int) -> set[int]:
        if address == ANYWHERE:
            return set().union(*pointed.values())
        return pointed[address] | pointed[ANYWHERE]

    def depth(address: int, running: frozenset[int]) -> int | None:
        function, inside = known[address], running | {address}
        if function.callees & inside:
            return None
        callees = function.callees.union(*(reached(place) - inside for place in function.places))
        below = [depth(callee, inside) for callee in callees]
        numbers = [each for each in below if each is not None]
        return function.frame + max(numbers, default=0) if len(numbers) == len(below) else None

    depths = [depth(image.address(root), frozenset()) for root in roots]
    numbers = [each for each in depths if each is not None]
    return max(numbers) if len(numbers) == len(depths) else None


def _in_constants(image: Image, functions: dict[int, Symbol]) -> defaultdict[int, set[int]]:
    """Find functions whose address stands in a constant, by its place there, or between functions."""
    objects = (symbol for symbol in image.symbols if symbol.kind == "STT_OBJECT")
    places = {item.address + at: at for item in objects for at in range(0, item.size, WORD)}
    callees: defaultdict[int, set[int]] = defaultdict(set)
    for address, content in image.segments:
        for at in range(0, len(content) - WORD + 1, WORD):
            word = int.from_bytes(content[at : at + WORD], "little")
            if word & 1 and word & ~1 in functions:
                callees[places.get(address + at, ANYWHERE)].add(word & ~1)
    return callees


def _instructions(image: Image, begin: int, end: int) -> Iterator[Any]:
    """Decode what lies between two addresses, without the constants in between."""
    import capstone

    decoder = capstone.Cs(capstone.CS_ARCH_ARM, capstone.CS_MODE_THUMB | capstone.CS_MODE_MCLASS)
    for first, last in image.thumb_ranges():
        low, high = max(first, begin), min(last, end)
        for address, content in image.segments:
            if low < high and address <= low < address + len(content):
                yield from decoder.disasm(content[low - address : high - address], low)


def _read(image: Image, symbol: Symbol, functions: dict[int, Symbol]) -> _Function:
    """Add up what a function pushes, and list what it calls."""
    begin = symbol.address & ~1
    frame, callees, named, places = 0, set(), set(), set()
    low_halves: dict[str, int] = {}
    loaded: dict[str, int] = {}
    for instruction in _instructions(image, begin, begin + symbol.size):
        name = instruction.mnemonic.split(".")[0]
        frame += _pushed(name, instruction.op_str)
        register, _, value = instruction.op_str.partition(", ")
        if name == "ldr" and (load := _LOADED.fullmatch(instruction.op_str)):
            loaded[load[1]] = int(load[2] or "0", 0)
        elif name == "movw":
            low_halves[register] = _value(value)
        elif name == "movt":
            named.add((_value(value) << 16 | low_halves.get(register, 0)) & ~1)
        elif name == "blx" or (name == "bx" and instruction.op_str != "lr"):
            places.add(loaded.get(instruction.op_str, ANYWHERE))
        elif name.startswith("b") and (number := _NUMBER.fullmatch(instruction.op_str)):
            target = int(number[1], 0)
            # A jump back to the start of a loop is not a call of itself.
            if target in functions and (target != begin or name == "bl"):
                callees.add(target)
    own = frozenset(callees), frozenset(named & functions.keys()), frozenset(places)
    return _Function(frame, *own)


def _value(operand: str) -> int:
    number = _NUMBER.fullmatch(operand)
    return int(number[1], 0) if number else 0


def _pushed(name: str, operands: str) -> int:
    if name in {"push", "vpush"}:
        size = 2 * WORD if operands.startswith("{d") else WORD
        return size * sum(_registers(part) for part in operands.strip("{}").split(","))
    if name in {"sub", "subw"} and operands.startswith("sp,"):
        number = _NUMBER.search(operands)
        return int(number[1], 0) if number else 0
    if name == "str" and "[sp, #-" in operands and operands.endswith("!"):
        number = _NUMBER.search(operands)
        return -int(number[1], 0) if number else 0
    return 0


def _registers(part: str) -> int:
    first, _, last = part.strip().partition("-")
    return int(last[1:]) - int(first[1:]) + 1 if last else 1
