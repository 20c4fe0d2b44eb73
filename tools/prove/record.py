"""Read and write the record of the proofs that held, proofs/proved.toml."""

from __future__ import annotations

import hashlib
import json
import tomllib
from dataclasses import asdict, dataclass
from pathlib import Path

from tools.prove.running import Evidence

FILE_HEADER = """\
# Proofs that held, their controls rejected; written by `make prove`, not by hand. The hash is over
# all that a proof depends on and over its entry here: if either changes, the proof is run again.
"""


@dataclass(frozen=True)
class Entry:
    """The record of one proof.

    Parameters
    ----------
    real, control : str
        Verdicts of the tool about the proof and about its control.
    seconds : float
        Processor time of both runs, s.
    hash : str
        Hash over these fields and over the contents that the proof depends on.
    """

    real: str
    control: str
    seconds: float
    hash: str


def make_entry(evidence: Evidence, content: str) -> Entry:
    """Return the entry of a proof that held.

    Parameters
    ----------
    evidence : Evidence
        The runs of the proof and of its control.
    content : str
        The hash of the contents that they depended on.

    Raises
    ------
    ValueError
        If the proof failed or its control passed.
    """
    if not evidence.holds:
        raise ValueError("only a proof that held is recorded")
    results = (evidence.real.verdict, evidence.control.verdict, round(evidence.seconds, 1))
    return Entry(*results, hash=entry_hash(*results, content))


def is_valid(entry: Entry, content: str) -> bool:
    """Whether an entry is unchanged and belongs to these contents."""
    return entry.hash == entry_hash(entry.real, entry.control, entry.seconds, content)


def entry_hash(real: str, control: str, seconds: float, content: str) -> str:
    """Return the hash of an entry and of the contents that it belongs to."""
    return hashlib.sha256(json.dumps([real, control, seconds, content]).encode()).hexdigest()


def read_record(file: Path) -> dict[str, Entry]:
    """Return the record; it is empty if the file does not exist."""
    if not file.exists():
        return {}
    table = tomllib.loads(file.read_text(encoding="utf-8"))
    return {name: Entry(**entry) for name, entry in table.items()}


def write_record(file: Path, record: dict[str, Entry]) -> None:
    """Write the complete record, sorted by name."""
    blocks = [
        "\n".join(
            [
                f'["{name}"]',
                *(f"{key} = {json.dumps(field_value)}" for key, field_value in asdict(entry).items()),
            ]
        )
        for name, entry in sorted(record.items())
    ]
    part = file.with_suffix(".part")
    part.write_text("\n\n".join([FILE_HEADER.rstrip(), *blocks]) + "\n", encoding="utf-8")
    part.replace(file)
