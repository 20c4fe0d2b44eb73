"""Read the irons of ``examples/irons`` for benchmarks with irons of other families."""

from __future__ import annotations

import tomllib

from anhyst_rigs.rig.parts.iron import DuhemSteel, PreisachSteel
from rows import ROOT

FILE = ROOT / "examples" / "irons" / "irons.toml"


def irons() -> dict[str, PreisachSteel | DuhemSteel]:
    """Return the irons by name, as a rig file defines them."""
    families = {"preisach": PreisachSteel, "duhem": DuhemSteel}
    tables = tomllib.loads(FILE.read_text(encoding="utf-8"))
    return {name: families[table["family"]](**table) for name, table in tables.items()}
