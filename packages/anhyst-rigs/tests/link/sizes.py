"""Memory of a firmware for a microcontroller."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from elftools.elf.elffile import ELFFile


@dataclass(frozen=True, slots=True)
class FirmwareSizes:
    """Memory of a firmware for a microcontroller, bytes."""

    flash: int  # code, constants and what variables start with
    ram: int  # variables: state, both parameter blocks, buffers
    stack: int  # kept for the stack


def read_sizes(program: Path) -> FirmwareSizes:
    """Return how much memory a firmware takes."""
    with program.open("rb") as stream:
        size = {entry.name: int(entry["sh_size"]) for entry in ELFFile(stream).iter_sections()}
    data = size.get(".data", 0)
    return FirmwareSizes(size[".text"] + data, size[".bss"] + data, size[".stack"])
