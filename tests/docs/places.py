"""Folders in which the code of pages is run."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

from tests.docs.blocks import ROOT


def shell(code: str, place: Path) -> None:
    """Run lines of a shell as a reader would, with the anhyst of this environment."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    command = ["bash", "-e", "-o", "pipefail", "-c", code]
    done = subprocess.run(
        command,
        cwd=place,
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"PATH": path, "PYTHON": sys.executable},
    )
    assert done.returncode == 0, f"{code}\n{done.stdout[-2000:]}{done.stderr[-2000:]}"


def fill(place: Path) -> None:
    """Lay out what pages speak of: the examples, and loops, a model and its C of one of them."""
    for name in ("bearing", "electromagnet", "piezo", "solenoid", "stage"):
        shutil.copytree(ROOT / "examples" / name, place / "examples" / name)
    for name in ("loops.csv", "loops.toml"):
        shutil.copy(place / "examples" / "electromagnet" / name, place / name)
    (place / "drive.csv").write_text("I_A,gap_mm\n0,0.4\n1.5,0.4\n3,0.4\n1.5,0.4\n")
    (place / "demand.csv").write_text("F_N,gap_mm\n10,0.4\n80,0.4\n10,0.4\n")
    shell("anhyst identify loops.csv --law effective-field --out model.toml", place)
    shell("anhyst compile model.toml --rate 10000 --out controller", place)
