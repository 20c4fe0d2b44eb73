"""Models of the independent test magnets, identified with default options once for each test run."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.command import quick
from tests.foreign.magnets import MAGNETS
from tests.once import made_once


def identified_once(factory: pytest.TempPathFactory, name: str) -> Path:
    """Return the read-only folder of one magnet: ``loops.csv``, ``model.toml``, ``said.json``."""

    def make(folder: Path) -> None:
        MAGNETS[name].write_loops(folder / "loops.csv")
        completed = quick("identify", "loops.csv", "--out", "model.toml", "--json", cwd=folder)
        assert completed.returncode == 0, completed.stderr
        (folder / "said.json").write_text(completed.stdout, encoding="utf-8")

    return made_once(factory, f"identified-{name}", make)
