"""Read the list of proofs, proofs/proofs.toml."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PROOFS = ROOT / "proofs"


@dataclass(frozen=True)
class Proof:
    """One entry of proofs.toml.

    Parameters
    ----------
    name : str
        Name of the proof.
    tool : str
        ``esbmc``, ``frama-c`` or ``every``. With ``every``, the harness is compiled and run for every
        number, and it stops at undefined behaviour.
    harness : Path
        The file that the tool reads.
    unwind : int
        Maximum number of iterations of a loop. ESBMC proves that no loop exceeds it.
    defines : list of str
        Macros for the harness.
    contracts : list of str
        Functions, as ``file:function``, that the harness replaces by their proved contracts.
    facts : list of (file, text, facts)
        Annotations that are inserted before a text of the copy.
    functions : list of str
        The functions that Frama-C proves; all if empty.
    control : dict
        ``file``, ``right`` and ``wrong``: the seeded fault that must make the proof fail.
    """

    name: str
    tool: str
    harness: Path
    unwind: int
    defines: list[str]
    contracts: list[str]
    facts: list[list[str]]
    functions: list[str]
    control: dict[str, str]


def read_proofs() -> list[Proof]:
    """Read proofs.toml."""
    table = tomllib.loads((PROOFS / "proofs.toml").read_text(encoding="utf-8"))
    return [
        Proof(
            name=entry["name"],
            tool=entry["tool"],
            harness=PROOFS / entry["harness"],
            unwind=entry.get("unwind", 1),
            defines=entry.get("defines", []),
            contracts=entry.get("contracts", []),
            facts=entry.get("facts", []),
            functions=entry.get("functions", []),
            control=entry["control"],
        )
        for entry in table["proof"]
    ]
