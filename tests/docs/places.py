"""Prepare folders for the code of the documentation pages."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
from contextlib import chdir, redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path

from anhyst.cli.app import main
from tests.repository import ROOT
from tests.truths import path_of


def shell(lines: str, place: Path) -> None:
    """Run lines of a shell script as a reader would.

    Lines that call anhyst run in this process. Tests in tests/cli show that a new process does the
    same.
    """
    with chdir(place):
        for line in re.sub(r"\\\n", " ", lines).splitlines():
            words = shlex.split(line, comments=True)
            if words[:1] == ["anhyst"]:
                message = StringIO()
                with redirect_stdout(message), redirect_stderr(message):
                    code = main(words[1:])
                assert code == 0, f"{line}\n{message.getvalue()[-2000:]}"
            elif words:
                _bash(line)


def _bash(line: str) -> None:
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-e", "-o", "pipefail", "-c", line],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"PATH": path},
    )
    assert done.returncode == 0, f"{line}\n{done.stdout[-2000:]}{done.stderr[-2000:]}"


def fill(place: Path) -> None:
    """Write the files that pages mention: examples, and loops, model and C code of one example."""
    for name in ("bearing", "electromagnet", "piezo", "planar", "solenoid", "stage"):
        shutil.copytree(ROOT / "examples" / name, place / "examples" / name)
    for name in ("loops.csv", "loops.toml"):
        shutil.copy(place / "examples" / "electromagnet" / name, place / name)
    (place / "drive.csv").write_text("I_A,gap_mm\n0,0.4\n1.5,0.4\n3,0.4\n1.5,0.4\n")
    (place / "demand.csv").write_text("F_N,gap_mm\n10,0.4\n80,0.4\n10,0.4\n")
    shutil.copy(path_of("electromagnet-effective-field-reluctance"), place / "model.toml")
    shell("anhyst compile model.toml --rate 10000 --out controller", place)
