"""Describe the machine that runs the benchmark, and measure its speed with a reference program."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from anhyst._core import batch_levels
from anhyst.identification.screening import read_instruction_set

SOURCE = Path(__file__).with_name("yardstick.c")


@dataclass(frozen=True)
class Machine:
    """Properties of a machine that determine its measured times.

    Parameters
    ----------
    processor : str
        Name that the system reports.
    cores : int
        Number of cores that the system reports.
    levels : tuple of str
        Instruction sets for which the batch code was built and which the processor supports.
    level : str
        The instruction set in use.
    compiler : str
        C compiler of this machine, which compiles ``yardstick.c``.
    system : str
        Operating system, C library, Python and NumPy.
    yardstick : float
        Processor time of one step of ``yardstick.c``, s.
    """

    processor: str
    cores: int
    levels: tuple[str, ...]
    level: str
    compiler: str
    system: str
    yardstick: float

    def lines(self) -> list[str]:
        """Describe the machine in sentences."""
        return [
            f"{self.processor}, {self.cores} cores; the batch runs on {self.level} of "
            f"{', '.join(self.levels)}; {self.compiler}; {self.system}.",
            f"A yardstick is {1e9 * self.yardstick:.1f} ns: one step of `benchmarks/yardstick.c`, "
            "a polynomial of twelve terms and a division in scalar double precision, which waits "
            "for the step before.",
        ]


def this_machine() -> Machine:
    """Describe this machine and measure the time of one step of ``yardstick.c``.

    Raises
    ------
    RuntimeError
        There is no C compiler.
    """
    compiler = next(filter(None, map(shutil.which, ("cc", "gcc", "clang"))), None)
    if compiler is None:
        raise RuntimeError("a C compiler is missing: apt install gcc libc6-dev")
    version = subprocess.run([compiler, "--version"], capture_output=True, text=True, check=True)
    libc = " ".join(platform.libc_ver())
    return Machine(
        processor=_processor(),
        cores=os.cpu_count() or 1,
        levels=tuple(batch_levels()),
        level=read_instruction_set(),
        compiler=version.stdout.splitlines()[0],
        system=f"{platform.system()}, {libc}, Python {platform.python_version()}, NumPy {np.__version__}",
        yardstick=_yardstick(compiler),
    )


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    fields = dict(line.replace("\t", "").split(":", 1) for line in lines if ":" in line)
    name = fields.get("model name", platform.processor() or platform.machine()).strip()
    family, model = (fields.get(key, "").strip() for key in ("cpu family", "model"))
    return f"{name} (family {family}, model {model})" if family and model else name


def _yardstick(compiler: str) -> float:
    with tempfile.TemporaryDirectory(prefix="anhyst-bench-") as folder:
        program = Path(folder) / "yardstick"
        flags = ["-std=c99", "-O2", "-ffp-contract=off"]
        subprocess.run([compiler, *flags, str(SOURCE), "-o", str(program)], check=True)
        done = subprocess.run([program], capture_output=True, text=True, check=True)
    return 1e-9 * float(done.stdout)
