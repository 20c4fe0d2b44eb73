"""Write a compiled folder from the core's own files, without the compiler."""

from __future__ import annotations

import json
from pathlib import Path

from anhyst.compensate.block import Kind
from anhyst.compilation.parameters import scales_initialiser
from anhyst.compilation.toolchain import KIND_SOURCES, core_files
from tests.actuators import compiled

KIND: Kind = "simplified"


def write_parameters(folder: Path, rate: float) -> Path:
    """Write what a firmware is built from: a compensator for `rate` ticks a second."""
    block = compiled(KIND)
    words = [int(word) for word in block.words]
    files = core_files(KIND_SOURCES[KIND]) | {
        "manifest.json": json.dumps({"name": "handmade", "rate_Hz": rate}),
        "handmade_parameters.h": f"""\
#include "anhyst/compensator/compensator.h"
#define HANDMADE_KERNEL anhyst_kernel_{KIND}
#define HANDMADE_RATE_HZ {rate}
#define HANDMADE_SCALES {scales_initialiser(block)}
#define HANDMADE_PARAMETERS_WORDS {len(words)}
extern const int16_t handmade_parameters[HANDMADE_PARAMETERS_WORDS];
""",
        "handmade_parameters.c": '#include "handmade_parameters.h"\n'
        f"const int16_t handmade_parameters[] = {{{', '.join(map(str, words))}}};\n",
    }
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")
    return folder
