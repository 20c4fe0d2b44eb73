"""Build the package of docs/contributing.md and install it into an empty folder."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import pytest

from anhyst.data.formats import FORMATS
from anhyst.laws import LAWS
from anhyst.support import kinds, registry
from anhyst_rigs.rig.parts.magnet import ACTUATORS
from tests.once import made_once
from tests.repository import ROOT

PAGE = (ROOT / "docs" / "contributing.md").read_text(encoding="utf-8")


def page_file(name: str) -> str:
    """Return a file of the page, joined from its pieces."""
    pieces = re.findall(rf"<!-- file: {re.escape(name)} -->\n```\w+\n(.*?)^```$", PAGE, re.M | re.S)
    assert pieces, f"docs/contributing.md shows no {name}"
    return "\n\n".join(pieces)


@cache
def package_files() -> tuple[str, ...]:
    """Return the names of all files in the package of the page."""
    return tuple(dict.fromkeys(re.findall(r"<!-- file: my-lab/(.*?) -->", PAGE)))


def build_package(folder: Path) -> None:
    """Write the package into a folder, and install it into the subfolder ``site``."""
    for name in ("my_lab/__init__.py", "my_lab/verbs/__init__.py", *package_files()):
        path = folder / "my-lab" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(page_file(f"my-lab/{name}") if name in package_files() else "")
    pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check", "install"]
    options = ["--no-deps", "--no-build-isolation", "--target", str(folder / "site")]
    subprocess.run([*pip, *options, str(folder / "my-lab")], check=True)


def build_installed_package(factory: pytest.TempPathFactory) -> Path:
    """Return the folder in which the package is installed."""
    return made_once(factory, "my-lab", build_package) / "site"


def _unload_package() -> None:
    registry._all_entry_points.cache_clear()
    for plugin_table in (LAWS, FORMATS, ACTUATORS, kinds._RIG_KINDS):
        vars(plugin_table).pop("_plugins", None)


@contextmanager
def installed(site: Path) -> Iterator[None]:
    """Make an installed package available in this process."""
    sys.path.insert(0, str(site))
    _unload_package()
    try:
        yield
    finally:
        sys.path.remove(str(site))
        _unload_package()
