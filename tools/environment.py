"""Prepare .venv. ``make`` runs this script with the Python of the machine.

Without arguments, it checks the machine, creates .venv, and installs what builds, runs and verifies
anhyst. With ``--package``, it compiles the core and installs the parts of packages/ in editable
mode. With ``--group NAME``, it installs that dependency group of pyproject.toml. It prints one line
for each step, and its duration when the step is complete.
"""

import os
import re
import shutil
import subprocess
import sys
import sysconfig
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
BIN = ROOT / ".venv" / "bin"
PIP = [str(BIN / "python"), "-m", "pip", "--disable-pip-version-check"]

# These tools are installed from PyPI, so that every machine builds with the same versions.
BUILD_TOOLS = ["cmake", "ninja"]

PARTS = ("anhyst", "anhyst-rigs", "anhyst-exchange")
"""Folders of packages/. Each part depends only on parts before it."""

# Extras that `make demo` needs, and the page that it mentions. `make test` adds further extras.
DEMO_EXTRAS = ["anhyst[verify]", "anhyst-rigs[link,live]"]

ZIG_AS_CPP = """#!/bin/sh
exec "{python}" -m ziglang c++ "$@"
"""


def find_missing_requirement() -> str:
    """Return what the machine lacks, with the remedy; an empty string if nothing is missing."""
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


def read_project(folder: Path) -> dict[str, Any]:
    """Return the contents of a folder's pyproject.toml."""
    import tomllib

    return tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))


def requirements(listed_requirements: list[str]) -> list[str]:
    """Return requirements, with extras of this repository replaced by what they require."""
    all_requirements = []
    for requirement_text in listed_requirements:
        if nested_extras := re.fullmatch(r"(anhyst[a-z-]*)\[(.*)\]", requirement_text):
            extras = read_project(ROOT / "packages" / nested_extras[1])["project"]["optional-dependencies"]
            all_requirements += [
                requirement for name in nested_extras[2].split(",") for requirement in extras[name]
            ]
        elif not requirement_text.startswith("anhyst"):
            all_requirements.append(requirement_text)
    return all_requirements


def run_step(name: str, action: Callable[[], None]) -> None:
    """Print the name of a step, run the step, and print its duration."""
    print(f"make: {name} ...", end="", flush=True)
    start_time = time.monotonic()
    try:
        action()
    except BaseException:
        print(flush=True)
        raise
    print(f" {time.monotonic() - start_time:.0f} s", flush=True)


def uses_other_index() -> bool:
    """Whether pip uses a package index other than PyPI. uv does not read that setting of pip."""
    pip_settings = subprocess.run([*PIP, "config", "list"], capture_output=True, text=True, check=False)
    return bool(re.search(r"index[-_]url|no[-_]index", pip_settings.stdout))


def create_environment() -> None:
    """Create .venv, and install uv if possible: it needs a tenth of pip's time."""
    subprocess.run([sys.executable, "-m", "venv", str(BIN.parent)], check=True)
    if not uses_other_index():
        # Without a wheel of uv for this machine, pip would compile it for minutes.
        build_packages = ["--quiet", "--only-binary", ":all:", "uv"]
        subprocess.run([*PIP, "install", *build_packages], capture_output=True, check=False)


def install_packages(packages: list[str]) -> None:
    """Install packages into .venv with uv, or with pip if uv fails."""
    uv = [str(BIN / "uv"), "pip", "install", "--quiet", "--python", str(BIN / "python")]
    if (BIN / "uv").exists():
        if subprocess.run([*uv, *packages], capture_output=True, check=False).returncode == 0:
            return
        print(" (with pip)", end="", flush=True)
    # Python compiles a module when it is imported. Compiling all modules here takes longer than the
    # downloads.
    subprocess.run([*PIP, "install", "--quiet", "--no-compile", *packages], check=True)


def prepare_environment() -> None:
    """Create .venv and install the packages. Without a C++ compiler, zig compiles the binding."""
    run_step("1 of 3: .venv; nothing is installed outside this folder", create_environment)
    parts = [read_project(ROOT / "packages" / part) for part in PARTS]
    build_requirements = [requirement for part in parts for requirement in part["build-system"]["requires"]]
    build_requirements += [one for part in parts for one in part["project"]["dependencies"]] + DEMO_EXTRAS
    packages = list(dict.fromkeys([*requirements(build_requirements), *BUILD_TOOLS]))
    names = ", ".join(re.split(r"[=<>]", package)[0] for package in packages)
    run_step(f"2 of 3: what builds and runs anhyst: {names}", lambda: install_packages(packages))
    if not any(map(shutil.which, ("c++", "g++", "clang++"))):
        compiler = BIN / "c++"
        compiler.write_text(ZIG_AS_CPP.format(python=BIN / "python"), encoding="utf-8")
        compiler.chmod(0o755)


def install_package() -> None:
    """Compile the core and install the parts; their dependencies are installed already."""
    variables = dict(os.environ, PATH=f"{BIN}:{os.environ['PATH']}")
    if (BIN / "c++").exists():
        variables["CXX"] = str(BIN / "c++")
    pip_arguments = ["--quiet", "--no-deps", "--no-build-isolation"]
    pip_arguments += [word for part in PARTS for word in ("--editable", str(ROOT / "packages" / part))]
    subprocess.run([*PIP, "install", *pip_arguments], check=True, env=variables)


def main() -> int:
    """Run the step that the arguments select; return the exit code."""
    problem = find_missing_requirement()
    if problem:
        print(f"make: {problem}", file=sys.stderr)
        return 2
    try:
        if sys.argv[1:2] == ["--group"]:
            name = sys.argv[2]
            group = read_project(ROOT)["dependency-groups"][name]
            run_step(f"what '{name}' needs", lambda: install_packages(requirements(group)))
        elif sys.argv[1:2] == ["--package"]:
            run_step("3 of 3: compile the core, install anhyst into .venv", install_package)
        else:
            prepare_environment()
    except subprocess.CalledProcessError as error:
        return error.returncode or 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
