"""Which tools a target needs, which of them are missing, and what brings them."""

from __future__ import annotations

import importlib.util
import shutil
from collections.abc import Iterable, Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Missing:
    """A tool that a target would need and that is not there."""

    target: str  # who needs it
    tool: str  # what it is: a program, a Python package, a library
    install: str  # the command that brings it

    def text(self) -> str:
        """Say it in a few words."""
        return f"{self.target}: {self.tool} ({self.install})"


def missing_programs(target: str, packages: Mapping[str, str]) -> tuple[Missing, ...]:
    """Return the programs that are not installed."""
    return tuple(
        Missing(target, name, f"apt install {package}")
        for name, package in packages.items()
        if shutil.which(name) is None
    )


def missing_modules(
    target: str, names: Iterable[str], extra: str = "verify"
) -> tuple[Missing, ...]:
    """Return the Python packages of an extra that are not installed."""
    return tuple(
        Missing(target, name, f"pip install 'anhyst[{extra}]'")
        for name in names
        if importlib.util.find_spec(name) is None
    )
