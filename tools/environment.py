"""Prepare .venv; run by make, with any Python that is there.

Without arguments: check the machine, create .venv and install what builds the package.
With ``--packages``: install what the package runs on, and what its tests and checks need.
With ``--extra NAME``: install that extra of pyproject.toml.

A line before each group of packages says what is coming and how far the work is.
"""

import re
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
VENV = ROOT / ".venv"

# Taken from PyPI, so that every machine builds with the same ones.
BUILD_TOOLS = ["cmake", "ninja"]

ZIG_AS_CPP = """#!/bin/sh
exec "{python}" -m ziglang c++ "$@"
"""


def missing() -> str:
    """Return what the machine lacks, with the remedy, or an empty string."""
    if sys.version_info < (3, 11):  # noqa: UP036 - run before the right Python is chosen
        found = ".".join(map(str, sys.version_info[:3]))
        return f"Python 3.11 or newer is needed, this is {found}: make PYTHON=python3.11"
    try:
        import ensurepip  # noqa: F401
        import venv  # noqa: F401
    except ImportError:
        return "Python's venv module is missing: apt install python3-venv"
    if not (Path(sysconfig.get_path("include")) / "Python.h").exists():
        return "Python's C headers (Python.h) are missing: apt install python3-dev"
    if not any(map(shutil.which, ("cc", "gcc", "clang"))):
        return "a C compiler is missing: apt install gcc libc6-dev"
    return ""


def project() -> dict[str, Any]:
    """Return pyproject.toml."""
    import tomllib

    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def extra(name: str) -> list[str]:
    """Return the requirements of one extra, without those that are extras themselves."""
    listed = project()["project"]["optional-dependencies"][name]
    return [one for one in listed if not one.startswith("anhyst[")]


def install(what: str, packages: list[str], place: str = "", *options: str) -> None:
    """Install packages into .venv; say so before, since it takes a while."""
    names = ", ".join(re.split(r"[=<>]", package)[0] for package in packages)
    print(f"make: installing {what}{place}: {names}", flush=True)
    python = VENV / "bin" / "python"
    pip = [str(python), "-m", "pip", "--disable-pip-version-check", "--quiet", "install"]
    subprocess.run([*pip, *options, *packages], check=True)


def prepare() -> None:
    """Create .venv and fill it; the binding is C++, so without a C++ compiler one is added."""
    print("make: preparing .venv, a minute or two; nothing is installed elsewhere", flush=True)
    subprocess.run([sys.executable, "-m", "venv", str(VENV)], check=True)
    needs_compiler = not any(map(shutil.which, ("c++", "g++", "clang++")))
    tools = ["pip", *project()["build-system"]["requires"], *BUILD_TOOLS]
    install("what builds the core", tools + ["ziglang"] * needs_compiler, " (1 of 4)", "--upgrade")
    if needs_compiler:
        compiler = VENV / "bin" / "c++"
        compiler.write_text(ZIG_AS_CPP.format(python=VENV / "bin" / "python"), encoding="utf-8")
        compiler.chmod(0o755)


def fill() -> None:
    """Install everything but the package itself."""
    install("what anhyst computes with", project()["project"]["dependencies"], " (2 of 4)")
    targets = [*extra("verify"), *extra("link"), *extra("control"), *extra("live"), *extra("io")]
    install("what it verifies, controls and shows with", targets, " (3 of 4)")
    install("what its tests and checks need", extra("dev"), " (4 of 4)")


def main() -> int:
    """Do what the arguments say; return the exit code."""
    problem = missing()
    if problem:
        print(f"make: {problem}", file=sys.stderr)
        return 2
    if sys.argv[1:2] == ["--extra"]:
        install("the extra", extra(sys.argv[2]))
    elif sys.argv[1:2] == ["--packages"]:
        fill()
    else:
        prepare()
    return 0


if __name__ == "__main__":
    sys.exit(main())
