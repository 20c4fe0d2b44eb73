"""The record of the proofs that held, proofs/proved.toml."""

from __future__ import annotations

import hashlib
import json
import tomllib
from dataclasses import asdict, dataclass
from pathlib import Path

from tools.prove.running import Evidence

HEAD = """\
# Proofs that held, their controls rejected; written by `make prove`, not by hand. The hash is over
# all that a proof depends on and over its entry here: if either changes, the proof is run again.
"""


@dataclass(frozen=True)
class Entry:
    """What is recorded of a proof.

    Parameters
    ----------
    real, control : str
        What the tool said of the proof and of its control.
    seconds : float
        Processor time of both.
    hash : str
        Over these and the contents that the proof depends on.
    """

    real: str
    control: str
    seconds: float
    hash: str


def entry_of(evidence: Evidence, content: str) -> Entry:
    """Return the entry of a proof that held.

    Parameters
    ----------
    evidence : Evidence
        Its two runs.
    content : str
        The hash of what they depended on.

    Raises
    ------
    ValueError
        If the proof or its control did not come out as it must.
    """
    if not evidence.holds:
        raise ValueError("only a proof that held is recorded")
    said = (evidence.real.verdict, evidence.control.verdict, round(evidence.seconds, 1))
    return Entry(*said, hash=sealed(*said, content))


def is_valid(entry: Entry, content: str) -> bool:
    """Whether an entry is what was written, and of these very contents."""
    return entry.hash == sealed(entry.real, entry.control, entry.seconds, content)


def sealed(real: str, control: str, seconds: float, content: str) -> str:
    """Return the hash of an entry."""
    return hashlib.sha256(json.dumps([real, control, seconds, content]).encode()).hexdigest()


def read_record(file: Path) -> dict[str, Entry]:
    """Read the record; one that is absent is empty."""
    if not file.exists():
        return {}
    table = tomllib.loads(file.read_text(encoding="utf-8"))
    return {name: Entry(**entry) for name, entry in table.items()}


def write_record(file: Path, record: dict[str, Entry]) -> None:
    """Write the record whole, in the order of the names."""
    blocks = [
        "\n".join([f'["{name}"]', *(f"{k} = {json.dumps(v)}" for k, v in asdict(entry).items())])
        for name, entry in sorted(record.items())
    ]
    part = file.with_suffix(".part")
    part.write_text("\n\n".join([HEAD.rstrip(), *blocks]) + "\n", encoding="utf-8")
    part.replace(file)
