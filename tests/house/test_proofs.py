"""Test that a recorded proof is valid only for unchanged inputs."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from tools.prove.inputs import content_hash
from tools.prove.listing import PROOFS, ROOT, Proof, read_proofs
from tools.prove.record import Entry, is_valid, make_entry, read_record, write_record
from tools.prove.running import Evidence, Outcome

LISTED_PROOFS = {proof.name: proof for proof in read_proofs()}
LOOKED_AT = ["operators", "full: quotient", "cells: turn", "cells: between entries and rows"]
EVIDENCE = Evidence(real=Outcome("proved", 41.26, ""), control=Outcome("refuted", 2.0, ""))


def proof_hashes(core: Path) -> dict[str, str]:
    return {name: content_hash(LISTED_PROOFS[name], "1", core) for name in LOOKED_AT}


@pytest.fixture(scope="module")
def before() -> dict[str, str]:
    return proof_hashes(ROOT / "core")


@pytest.mark.first(1)
@pytest.mark.needs("cc")
@pytest.mark.parametrize(
    ("file", "readers"),
    [
        ("include/anhyst/numeric/fixed.h", set(LOOKED_AT)),
        ("src/compensator/full.c", {"full: quotient"}),
        ("src/compensator/cells.c", {"cells: turn"}),
        ("src/compensator/cells_fixed.h", {"cells: turn", "cells: between entries and rows"}),
        ("src/compensator/cells_f64.c", set()),
        ("src/compensator/generic/cells.h", {"cells: turn"}),
    ],
)
def test_a_line_changes_the_hash_of_the_proofs_that_read_it_and_of_no_other(
    file: str, readers: set[str], before: dict[str, str], tmp_path: Path
) -> None:
    core = Path(shutil.copytree(ROOT / "core", tmp_path / "elsewhere"))
    with (core / file).open("a", encoding="utf-8") as source:
        source.write("typedef int one_more;\n")
    hashes_after = proof_hashes(core)  # the path of the folder does not count
    assert {name for name in LOOKED_AT if hashes_after[name] != before[name]} == readers


@pytest.mark.first(1)
@pytest.mark.needs("cc")
@pytest.mark.parametrize(
    "changed",
    [
        {"unwind": 7},
        {"defines": ["PART=prove_decayed_share"]},
        {"functions": ["quotient"], "tool": "frama-c"},
        {"harness": PROOFS / "esbmc" / "prove_closed.c"},
        {"contracts": ["src/compensator/full_fixed.h:decayed_fraction"]},
        {"facts": [["src/compensator/full_fixed.h", "static inline number quotient(", "/* more */ "]]},
        {"control": {"file": "src/compensator/full_fixed.h", "right": "ONE * 4 - 1", "wrong": "ONE"}},
    ],
)
def test_arguments_of_a_tool_change_the_hash(changed: dict[str, object], before: dict[str, str]) -> None:
    proof: Proof = replace(LISTED_PROOFS["full: quotient"], **changed)  # type: ignore[arg-type]
    assert content_hash(proof, "1") != before["full: quotient"]
    assert content_hash(LISTED_PROOFS["full: quotient"], "2") != before["full: quotient"]


def test_a_record_is_read_as_written_and_valid_only_for_its_contents(tmp_path: Path) -> None:
    entry = make_entry(EVIDENCE, "contents")
    write_record(tmp_path / "proved.toml", {"full: search": entry})
    read_entries = read_record(tmp_path / "proved.toml")
    assert read_entries == {"full: search": entry}
    assert entry == Entry("proved", "refuted", 43.3, entry.hash)
    assert is_valid(read_entries["full: search"], "contents")
    assert not is_valid(read_entries["full: search"], "other contents")


@pytest.mark.parametrize("words", [{"real": "refuted"}, {"control": "proved"}, {"seconds": 1.0}])
def test_an_entry_edited_by_hand_is_invalid(words: dict[str, object]) -> None:
    edited = replace(make_entry(EVIDENCE, "contents"), **words)  # type: ignore[arg-type]
    assert not is_valid(edited, "contents")


@pytest.mark.parametrize(
    "evidence",
    [
        replace(EVIDENCE, real=Outcome("timeout", 420.0, "")),
        replace(EVIDENCE, control=Outcome("proved", 2.0, "")),
        replace(EVIDENCE, control=Outcome("no answer", 2.0, "")),
    ],
)
def test_a_failed_proof_is_not_recorded(evidence: Evidence) -> None:
    with pytest.raises(ValueError, match="held"):
        make_entry(evidence, "contents")


def test_recorded_proofs_are_listed() -> None:
    record = read_record(PROOFS / "proved.toml")
    assert record
    assert set(record) <= set(LISTED_PROOFS)
