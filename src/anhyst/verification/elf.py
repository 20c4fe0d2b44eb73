"""What stands in a linked program: memory image, symbols, sizes by source file."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from anhyst.compilation.core import PIDD2

FLASH = 0x08000000
"""Where the code of a Cortex-M stands, as in ``harness/cortex_m.ld``."""

CONTROL = {name.rpartition("/")[2] for name in PIDD2}


@dataclass(frozen=True, slots=True)
class Symbol:
    """A named piece of a program; ``source`` is the C file where the linker knows it."""

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
        """Return begin and end of each stretch of Thumb code, without the constants in between.

        The linker marks them by symbols called ``$t`` and ``$d``.
        """
        marks = sorted(
            (symbol.address & ~1, symbol.name[:2])
            for symbol in self.symbols
            if symbol.name[:2] in {"$t", "$d"} and symbol.section == ".text"
        )
        ends = [address for address, _ in marks[1:]]
        ends.append(max((f.address & ~1) + f.size for f in self.functions()))
        return [(at, end) for (at, name), end in zip(marks, ends, strict=True) if name == "$t"]

    def functions(self) -> list[Symbol]:
        """Return the functions, by address."""
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
    """Give the symbols; local ones follow the name of their source file."""
    source = ""
    for symbol in elf.get_section_by_name(".symtab").iter_symbols():
        kind, place = symbol["st_info"]["type"], symbol["st_shndx"]
        if kind == "STT_FILE":
            source = Path(symbol.name).name
            continue
        section = place if isinstance(place, str) else elf.get_section(place).name
        local = symbol["st_info"]["bind"] == "STB_LOCAL"
        yield Symbol(
            symbol.name,
            int(symbol["st_value"]),
            int(symbol["st_size"]),
            kind,
            section,
            source if local else "",
        )


@dataclass(frozen=True, slots=True)
class ProgramSizes:
    """What the compensator takes in a linked program; bytes."""

    # Machine code of the core: solve, commit, start-up and check of the block. The compiler's own
    # routines, such as a long multiplication, are not counted.
    code: int
    control_code: int  # machine code of the position controller
    tables: int  # constants of the core
    parameters: int  # the parameter block; in floating point the structure and its tables
    variables: int  # variables of the core and of the parameters: 0, as all state is the caller's


def measure_sizes(
    image: Image, actuator: str, sources: Collection[str], constants_in_data: bool
) -> ProgramSizes:
    """Add up what the linker kept of the compensator."""
    parameters = f"{actuator}_parameters"
    prefixes = ("anhyst_", parameters, f"{actuator}_controller")
    code = control = tables = block = variables = 0
    for symbol in image.symbols:
        ours = symbol.name.startswith(prefixes) or symbol.source in sources
        if symbol.kind == "STT_FUNC" and ours:
            if symbol.name.startswith("anhyst_pidd2") or symbol.source in CONTROL:
                control += symbol.size
            else:
                code += symbol.size
        elif symbol.kind == "STT_OBJECT" and ours:
            constant = symbol.section.startswith(".data" if constants_in_data else ".rodata")
            if symbol.name == parameters or symbol.source == f"{parameters}.c":
                block += symbol.size
            elif constant:
                tables += symbol.size
            else:
                variables += symbol.size
    return ProgramSizes(code, control, tables, block, variables)
