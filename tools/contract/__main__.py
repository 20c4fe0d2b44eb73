"""Generate C, Python and tables of the documentation from the tables of contract/.

Without arguments, the script writes the files. With ``--check``, it writes nothing, and the exit
code is 1 if a file differs from the tables.
"""

from __future__ import annotations

import sys
from pathlib import Path

from block import layout_header
from c_code import bus_header, flags_header, frames_header, states_header
from link_page import link_tables, page_with_tables
from python_code import frames_module, states_module
from tables import ROOT, read
from xcp import map_header

CORE = ROOT / "core" / "include" / "anhyst"
PLANT = ROOT / "plant" / "include" / "anhyst_plant"
SOURCE = ROOT / "packages" / "anhyst" / "src" / "anhyst"
RIGS = ROOT / "packages" / "anhyst-rigs" / "src" / "anhyst_rigs"
PAGE = ROOT / "docs" / "link.md"


def generate_files() -> dict[Path, str]:
    """Return every generated file with its expected contents."""
    frames, signals = read("frames"), read("signals")
    controller, block, xcp = read("controller"), read("block"), read("xcp")
    tables = link_tables(frames, signals, controller)
    return {
        ROOT / "firmware" / "link" / "frames.h": frames_header(frames, signals),
        RIGS / "link" / "frames.py": frames_module(frames, signals),
        PLANT / "bus_words.h": bus_header(frames["plant"]),
        ROOT / "firmware" / "xcp" / "map.h": map_header(xcp, signals),
        CORE / "control" / "states.h": states_header(controller),
        CORE / "compensator" / "flags.h": flags_header(controller),
        SOURCE / "support" / "states.py": states_module(controller),
        CORE / "compensator" / "layout.h": layout_header(block),
        PAGE: page_with_tables(PAGE.read_text(encoding="utf-8"), tables),
    }


def main() -> int:
    """Write the files, or compare them with the tables."""
    files = generate_files()
    differing_files = [
        generated_file
        for generated_file, text in files.items()
        if not generated_file.exists() or generated_file.read_text("utf-8") != text
    ]
    if sys.argv[1:] == ["--check"]:
        for file in differing_files:
            print(f"{file.relative_to(ROOT)} is not what contract/ says: run python tools/contract")
        return 1 if differing_files else 0
    for file in differing_files:
        file.write_text(files[file], encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
