"""Build wheels for Linux into dist/, and test them in empty environments.

    python -m tools.wheel [PYTHON ...]

A wheel of anhyst is built for each Python (by default the one that runs this script) and for each
machine. zig compiles it against an old glibc, and auditwheel checks the platform tag. A wheel for
CPython 3.12 is valid for all later versions. The wheels of the other parts are independent of the
machine. Each Python then gets an empty environment outside the repository. With the wheel of anhyst
alone, the script runs the tutorial up to step 6. With all wheels, it runs the whole tutorial.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from tools.environment import PARTS

ROOT = Path(__file__).resolve().parents[1]
DIST = ROOT / "dist"
TUTORIAL = ROOT / "docs" / "tutorial.md"
PURE_PYTHON_PARTS = PARTS[1:]
"""The parts that contain no compiled code."""
LAST_STEP_WITH_ANHYST_ALONE = 6
"""The last step of the tutorial that needs only the part anhyst."""

MACHINES = ("x86_64", "aarch64")
MIN_GLIBC = (2, 17)
"""Oldest supported glibc, of 2012, as in manylinux2014."""

_FIRST_STABLE_ABI = (3, 12)
"""First version of Python whose stable ABI contains the functions that nanobind needs."""
_CODE_BLOCK = re.compile(r"^(<!-- not run\b[^>]*-->\s*)?^```(sh|python)\n(.*?)^```$", re.M | re.S)


def wheel_tag(version: tuple[int, int], machine: str) -> str:
    """Return the compatibility tag of a wheel: interpreter, ABI and platform."""
    platform = f"manylinux_{MIN_GLIBC[0]}_{MIN_GLIBC[1]}_{machine}"
    if version >= _FIRST_STABLE_ABI:
        return f"cp{_FIRST_STABLE_ABI[0]}{_FIRST_STABLE_ABI[1]}-abi3-{platform}"
    interpreter_tag = f"cp{version[0]}{version[1]}"
    return f"{interpreter_tag}-{interpreter_tag}-{platform}"


def build_wheel(python: Path, machine: str, dist: Path) -> Path:
    """Build the wheel for a version of Python and a machine.

    Parameters
    ----------
    python : Path
        A Python of this machine. If it is not the running one, its build tools are installed into a
        separate folder.
    machine : str
        One of :data:`MACHINES`.
    dist : Path
        Folder for the wheel.

    Returns
    -------
    Path
        The wheel.
    """
    version = python_version(python)
    zig = f"{sys.executable} -m ziglang"
    target = f"-target {machine}-linux-gnu.{MIN_GLIBC[0]}.{MIN_GLIBC[1]}"
    tag_text = wheel_tag(version, machine)
    settings = {
        "build-dir": str(ROOT / "build" / f"wheel-{tag_text}"),
        "env._PYTHON_HOST_PLATFORM": tag_text.split("-")[2],
        "env.SETUPTOOLS_EXT_SUFFIX": f".cpython-{version[0]}{version[1]}-{machine}-linux-gnu.so",
        "cmake.define.CMAKE_SYSTEM_NAME": "Linux",
        "cmake.define.CMAKE_SYSTEM_PROCESSOR": machine,
    }
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet"]
    if python == Path(sys.executable):
        pip += ["wheel", "--no-build-isolation"]
    else:
        pip += ["--python", str(python), "wheel"]
    options = [f"--config-settings={name}={value}" for name, value in settings.items()]
    run(
        [*pip, "--no-deps", *options, "--wheel-dir", str(dist), str(ROOT / "packages" / "anhyst")],
        variables={
            "CC": f"{zig} cc {target}",
            # Without symbols from the first check on: zig keeps a C++ library for each set of
            # options.
            "CXX": f"{zig} c++ {target} -s",
            "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        },
    )
    (wheel,) = dist.glob(f"anhyst-*-{tag_text}.whl")
    return wheel


def build_others(dist: Path) -> list[Path]:
    """Build the wheels of the other parts into a folder; return the wheels."""
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet", "wheel"]
    folders = [str(ROOT / "packages" / part) for part in PURE_PYTHON_PARTS]
    run(
        [*pip, "--no-build-isolation", "--no-deps", "--wheel-dir", str(dist), *folders],
        variables={"PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"},
    )
    return [next(dist.glob(f"{part.replace('-', '_')}-*.whl")) for part in PURE_PYTHON_PARTS]


def check_wheel(wheel: Path) -> None:
    """Check that a wheel needs no newer glibc, and only the stable ABI, as its name promises.

    Raises
    ------
    RuntimeError
        If the wheel needs more than its name promises.
    """
    platform = wheel.stem.split("-")[4]
    report = run([sys.executable, "-m", "auditwheel", "show", str(wheel)])
    if f'platform tag: "{platform}"' not in " ".join(report.split()):
        raise RuntimeError(f"{wheel.name}: {report}")
    if "-abi3-" in wheel.name:
        run([sys.executable, "-m", "abi3audit", "--strict", str(wheel)])


def empty_environment(python: Path, wheel: Path, folder: Path) -> Path:
    """Install a wheel and its dependencies into a new environment; return its Python."""
    run([str(python), "-m", "venv", str(folder)])
    environment_python = folder / "bin" / "python"
    install(environment_python, [wheel])
    return environment_python


def install(python: Path, wheels: Sequence[Path]) -> None:
    """Install wheels and their dependencies into the environment of a Python."""
    # Most modules of the dependencies are never imported here. Not compiling them halves the time.
    run([str(python), "-m", "pip", "--quiet", "install", "--no-compile", *map(str, wheels)])


def installed_megabytes(python: Path) -> float:
    """Return the size of the packages in the environment of a Python, without pip, MB."""
    (packages,) = (python.parents[1] / "lib").glob("python*/site-packages")
    files = (path for path in packages.rglob("*") if path.is_file() and not path.is_symlink())
    own_files = (path for path in files if path.relative_to(packages).parts[0] not in {"pip", "setuptools"})
    return sum(path.stat().st_size for path in own_files) / 1e6


def page_up_to_step(page: str, last_step: int) -> str:
    """Return a page up to the end of a numbered step."""
    return page.partition(f"\n## {last_step + 1}. ")[0]


def run_page(page: str, python: Path, working_folder: Path) -> int:
    """Run the shell and Python blocks of a page in their order, in a folder.

    Parameters
    ----------
    page : str
        The page, in Markdown.
    python : Path
        The Python of the environment whose ``anhyst`` the blocks run.
    place : Path
        The working folder of the blocks.

    Returns
    -------
    int
        Number of blocks that were run.

    Raises
    ------
    RuntimeError
        If a block fails.
    """
    blocks = [
        (language, code) for printed_code, language, code in _CODE_BLOCK.findall(page) if not printed_code
    ]
    for language, code in blocks:
        if language == "sh":
            command = ["bash", "-e", "-o", "pipefail", "-c", code]
        else:
            command = [str(python), "-c", code]
        run(command, working_folder, {"PATH": f"{python.parent}{os.pathsep}{os.defpath}"})
    return len(blocks)


def run(command: Sequence[str], cwd: Path | None = None, variables: Mapping[str, str] | None = None) -> str:
    """Run a command without the Python variables of this environment; return its output.

    Raises
    ------
    RuntimeError
        If the command fails.
    """
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    completed = subprocess.run(
        command,
        cwd=cwd,
        capture_output=True,
        text=True,
        check=False,
        env=environment | {"MPLBACKEND": "agg"} | dict(variables or {}),
    )
    if completed.returncode:
        output_text = (completed.stdout + completed.stderr).splitlines()
        raise RuntimeError("\n".join([" ".join(command), *output_text[-40:]]))
    return completed.stdout


def python_version(python: Path) -> tuple[int, int]:
    """Return the major and minor version of a Python."""
    output_text = run([str(python), "-c", "import sys; print(*sys.version_info[:2])"])
    major, minor = map(int, output_text.split())
    return major, minor


def try_tutorial(
    python: Path, other_wheels: Sequence[Path], folder: Path, say: Callable[[str], None]
) -> None:
    """Run the first steps of the tutorial with anhyst alone, then all steps with all wheels."""
    page = TUTORIAL.read_text(encoding="utf-8")
    for name, steps in (("alone", page_up_to_step(page, LAST_STEP_WITH_ANHYST_ALONE)), ("all", page)):
        tutorial_folder = folder / name
        tutorial_folder.mkdir()
        count = run_page(steps, python, tutorial_folder)
        say(f"{count} blocks of {TUTORIAL.name} run there")
        if name == "alone":
            install(python, other_wheels)


def main() -> int:
    """Build wheels for each Python that the arguments name, then test them; return the exit code."""
    pythons = [Path(name) for name in sys.argv[1:]] or [Path(sys.executable)]
    start_time = time.monotonic()

    def say(text: str) -> None:
        print(f"wheel: {time.monotonic() - start_time:.0f} s: {text}", flush=True)

    wheels: dict[str, Path] = {}
    try:
        for python in pythons:
            for machine in MACHINES:
                tag_text = wheel_tag(python_version(python), machine)
                if tag_text not in wheels:
                    wheels[tag_text] = build_wheel(python, machine, DIST)
                    check_wheel(wheels[tag_text])
                    say(f"{wheels[tag_text].name}: built and checked")
        other_wheels = build_others(DIST)
        say(f"{', '.join(wheel.name for wheel in other_wheels)}: built")
        for python in pythons:
            wheel = wheels[wheel_tag(python_version(python), os.uname().machine)]
            with tempfile.TemporaryDirectory(prefix="anhyst-") as name:
                environment_python = empty_environment(python, wheel, Path(name) / "environment")
                say(f"{wheel.name}: is installed into a new environment of {python}")
                say(f"{installed_megabytes(environment_python):.0f} MB with what it depends on")
                try_tutorial(environment_python, other_wheels, Path(name), say)
    except RuntimeError as error:
        print(f"wheel: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
