"""Prepare .venv with what builds the package; run by make, with any Python that is there.

Without arguments: check the machine, create .venv and install the build requirements.
With ``--extra NAME``: print the requirements of that extra of pyproject.toml.
"""

import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

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


def requirements(extra: str | None) -> list[str]:
    """Return the build requirements, or those of one extra."""
    import tomllib

    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    if extra:
        return list(project["project"]["optional-dependencies"][extra])
    return list(project["build-system"]["requires"]) + BUILD_TOOLS


def prepare() -> None:
    """Create .venv and fill it; the binding is C++, so without a C++ compiler one is added."""
    python = VENV / "bin" / "python"
    subprocess.run([sys.executable, "-m", "venv", str(VENV)], check=True)
    pip = [str(python), "-m", "pip", "--disable-pip-version-check", "--quiet", "install"]
    subprocess.run([*pip, "--upgrade", "pip"], check=True)
    wanted = requirements(None)
    needs_compiler = not any(map(shutil.which, ("c++", "g++", "clang++")))
    subprocess.run(pip + wanted + ["ziglang"] * needs_compiler, check=True)
    if needs_compiler:
        compiler = VENV / "bin" / "c++"
        compiler.write_text(ZIG_AS_CPP.format(python=python), encoding="utf-8")
        compiler.chmod(0o755)


def main() -> int:
    """Do what the arguments say; return the exit code."""
    problem = missing()
    if problem:
        print(f"make: {problem}", file=sys.stderr)
        return 2
    if sys.argv[1:2] == ["--extra"]:
        print("\n".join(requirements(sys.argv[2])))
    else:
        prepare()
    return 0


if __name__ == "__main__":
    sys.exit(main())
