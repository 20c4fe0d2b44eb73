"""A folder as the compiler writes it, made from the core's own files, in no time."""

from __future__ import annotations

from pathlib import Path

from tests.actuators import compiled

from anhyst.compile.block import Kind
from anhyst.compile.core import SOURCES, core_folder
from anhyst.compile.parameters import scales_source

KIND: Kind = "simplified"


def write_parameters(folder: Path, rate: int | str) -> Path:
    """Write what a firmware is built from: a compensator for `rate` ticks a second."""
    core = core_folder()
    block = compiled(KIND)
    words = [int(word) for word in block.words]
    folder.mkdir()
    (folder / "anhyst").symlink_to(core / "include" / "anhyst")
    files = {
        "anhyst.h": '#include "anhyst/compensator.h"\n',
        "anhyst.c": "".join(f'#include "{core}/src/{name}"\n' for name in SOURCES[KIND]),
        "anhyst_parameters.h": f"""\
#include "anhyst.h"
#define ANHYST_KERNEL anhyst_kernel_{KIND}
#define ANHYST_RATE_HZ {rate}
#define ANHYST_SCALES {scales_source(block)}
#define ANHYST_PARAMETERS_WORDS {len(words)}
extern const int16_t anhyst_parameters[ANHYST_PARAMETERS_WORDS];
""",
        "anhyst_parameters.c": '#include "anhyst_parameters.h"\n'
        f"const int16_t anhyst_parameters[] = {{{', '.join(map(str, words))}}};\n",
    }
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
    return folder
