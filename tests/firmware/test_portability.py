"""Test the firmware on other processors: any width of int, and the documented memory."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

from .build import FIRMWARE_SOURCES, HERE, POSITION_SOURCES, ROOT, tool

FIRMWARE_FOLDER = ROOT / "firmware"
INCLUDE = [f"-I{ROOT / 'firmware'}", f"-I{HERE}", f"-I{ROOT / 'core' / 'include'}"]
PARTS = {
    "control task": "sizeof(app_control)",
    "body of force": "sizeof(force)",
    "body of position": "sizeof(position)",
    "settings": "LINK_SETTING_COUNT * sizeof(int32_t)",
    "signals of the last tick": "LINK_SIGNAL_COUNT * sizeof(int32_t)",
    "link: frame": "sizeof(app_session)",
    "two places for parameter blocks": "sizeof(app_download)",
    "slave of XCP": "sizeof(xcp_slave)",
    "line of XCP": "sizeof(xcp_line) - sizeof(xcp_slave)",
}


def test_sixteen_bit_int_is_enough(tmp_path: Path) -> None:
    # Warnings show constants and shifts that do not fit. avr-gcc 5 gives false conversion warnings,
    # therefore only the other compilers use -Wconversion.
    command = [tool("avr-gcc"), "-mmcu=atmega1284p", "-std=c99", "-Os", "-Wall", "-Wextra"]
    command += ["-Werror", *INCLUDE, "-c", *map(str, {*FIRMWARE_SOURCES, *POSITION_SOURCES})]
    completed = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert completed.returncode == 0, completed.stderr


def compile_for_cortex_m4(source: Path, out: Path) -> None:
    """Compile for a Cortex-M4."""
    command = [sys.executable, "-m", "ziglang", "cc", "-target", "thumb-freestanding-eabi"]
    command += ["-mcpu=cortex_m4", "-ffreestanding", "-std=c99", "-Os", *INCLUDE]
    completed = subprocess.run(
        [*command, "-c", str(source), "-o", str(out)], capture_output=True, text=True, check=False
    )
    assert completed.returncode == 0, completed.stderr


def test_the_page_states_the_memory_that_is_used(tmp_path: Path) -> None:
    from elftools.elf.elffile import ELFFile
    from elftools.elf.sections import SymbolTableSection

    page = (ROOT / "docs" / "firmware.md").read_text(encoding="utf-8")
    stated_sizes = dict(re.findall(r"^\| ([^|]+) \| (\d+) \|$", page.partition("## Memory")[2], re.M))
    lines = [f"char part_{i}[{size}];" for i, size in enumerate(PARTS.values())]
    source = tmp_path / "parts.c"
    bodies = (
        '#include "app/app.h"\n#include "xcp/line.h"\n#include "force/force.h"\ntypedef app_body force;\n'
        "#define app_body position_body\n"
        '#include "position/position.h"\ntypedef struct position_body position;\n'
    )
    source.write_text(bodies + "\n".join(lines) + "\n", encoding="utf-8")
    compile_for_cortex_m4(source, tmp_path / "parts.o")
    with (tmp_path / "parts.o").open("rb") as file:
        symbols = ELFFile(file).get_section_by_name(".symtab")
        assert isinstance(symbols, SymbolTableSection)
        sizes = {symbol.name: symbol["st_size"] for symbol in symbols.iter_symbols()}
    for number, name in enumerate(PARTS):
        (size_text,) = [int(value) for key, value in stated_sizes.items() if key.startswith(name)]
        assert sizes[f"part_{number}"] == size_text, name


def test_the_page_states_the_code_of_xcp(tmp_path: Path) -> None:
    """The tolerance is a tenth, so that another version of the compiler still passes."""
    from elftools.elf.elffile import ELFFile

    size = 0
    for source in sorted((FIRMWARE_FOLDER / "xcp").glob("*.c")):
        out = tmp_path / f"{source.stem}.o"
        compile_for_cortex_m4(source, out)
        with out.open("rb") as file:
            size += sum(
                int(section["sh_size"])
                for section in ELFFile(file).iter_sections()
                if section.name.startswith((".text", ".rodata"))
            )
    page = (ROOT / "docs" / "firmware.md").read_text(encoding="utf-8")
    (stated_bytes,) = re.findall(r"^\| code and constants of XCP[^|]* \| (\d+) \|$", page, re.M)
    assert abs(size - int(stated_bytes)) < 0.1 * size, size
    xcp_sections = (ROOT / "docs" / "xcp.md").read_text(encoding="utf-8")
    assert f"code is {stated_bytes} bytes" in xcp_sections
