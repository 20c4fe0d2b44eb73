"""Build the firmware's sources with the installed compilers."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]

WARNINGS = ["-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Werror"]
SANITIZERS = ["-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
SHARED_LIBRARY_OPTIONS = [
    *(
        file
        for part in ("link", "app", "services", "xcp")
        for file in sorted(ROOT.glob(f"firmware/{part}/*.c"))
    ),
    ROOT / "core" / "src" / "control" / "supervisor.c",
]
FIRMWARE_SOURCES = [*SHARED_LIBRARY_OPTIONS, ROOT / "firmware" / "force" / "force.c"]
POSITION_SOURCES = [*SHARED_LIBRARY_OPTIONS, ROOT / "firmware" / "position" / "position.c"]


def tool(*names: str) -> str:
    """Return the first of these programs that is installed; skip the test if there is none."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}"
    for name in names:
        if found := shutil.which(name, path=path):
            return found
    package = {"avr-gcc": "gcc-avr avr-libc"}.get(names[0], names[0])
    pytest.skip(f"{names[0]} is not installed: apt install {package}")


def compile_c(
    compiler: str, sources: Sequence[Path], output_file: Path, *options: str
) -> subprocess.CompletedProcess[str]:
    """Compile and link; warnings are errors. With -c, `out` is the folder of the object files."""
    include = [f"-I{ROOT / 'firmware'}", f"-I{HERE}", f"-I{ROOT / 'core' / 'include'}"]
    command = [compiler, "-std=c99", "-O1", *WARNINGS, *options, *include, *map(str, sources)]
    if "-c" in options:
        return subprocess.run(command, capture_output=True, text=True, check=False, cwd=output_file)
    command += ["-o", str(output_file), "-lm"]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def can_compile(compiler: str, folder: Path, *options: str) -> bool:
    """Whether a compiler can build with these options, because some options need extra packages."""
    source = folder / "probe.c"
    source.write_text(
        "int LLVMFuzzerTestOneInput(const unsigned char *data, unsigned long size);\n"
        "int LLVMFuzzerTestOneInput(const unsigned char *data, unsigned long size)\n"
        "{\n  return data == 0 && size > 0;\n}\n"
        "#ifndef PROBE_FUZZER\nint main(void) { return LLVMFuzzerTestOneInput(0, 0); }\n#endif\n",
        encoding="utf-8",
    )
    return compile_c(compiler, [source], folder / "probe", *options).returncode == 0
