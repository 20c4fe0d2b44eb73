"""What a benchmark line holds."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


@dataclass(frozen=True)
class Row:
    """One line of the table: what was measured, what it must reach, what came out."""

    what: str
    reach: str
    measured: str
    met: bool | None
    """None where there is nothing to reach, only something to report."""


def measurements() -> Path | None:
    """Folder of real measurements, or None where it is absent."""
    folder = Path(os.environ.get("ANHYST_DATA", ROOT.parent / "shared" / "data"))
    return folder if folder.is_dir() else None
