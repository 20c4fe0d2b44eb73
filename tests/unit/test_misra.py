"""The list of MISRA deviations in docs/proofs.md is what the checker finds."""

from __future__ import annotations

import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FILES = (
    "pidd2",
    "block",
    "closed",
    "compensator",
    "euler",
    "full",
    "simplified",
    "map",
    "drive",
    "levitation",
)


def listed() -> dict[str, int]:
    """Return the most deviations of each rule; rules that share a line share its number."""
    text = (ROOT / "docs" / "proofs.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| ([\d., ]+) \| (\d+) \|", text, re.MULTILINE)
    return {rule: int(most) for rules, most in rows for rule in rules.split(", ")}


def test_deviations_are_those_listed() -> None:
    cppcheck = Path(sys.executable).parent / "cppcheck"
    command = [str(cppcheck), "--addon=misra", "--enable=style", "--quiet", "--std=c99", "-j2"]
    command += ["-D__STDC__=1"]  # one configuration: the portable one, without a port header
    command += [f"-I{ROOT / 'core' / folder}" for folder in ("include", "src")]
    sources = [str(ROOT / "core" / "src" / f"{name}.c") for name in FILES]
    done = subprocess.run(
        [*command, "--template={id}", *sources], capture_output=True, text=True, check=True
    )
    found = Counter(re.findall(r"misra-c2012-([\d.]+)", done.stdout + done.stderr))
    assert found.keys() == listed().keys()
    assert {rule: n for rule, n in found.items() if n > listed()[rule]} == {}
