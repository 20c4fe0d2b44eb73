"""Test that each note of docs/decisions is short, has the common form, and is in the index."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.repository import ROOT

FOLDER = ROOT / "docs" / "decisions"
NOTES = sorted(FOLDER.glob("[0-9]*.md"))


def test_notes_are_numbered_without_a_hole() -> None:
    assert [note.name[:3] for note in NOTES] == [f"{n:02}-" for n in range(1, len(NOTES) + 1)]


def test_the_index_names_each_note_once_in_order() -> None:
    named_notes = re.findall(r"^\| \[\d\d\]\(([^)]+)\) \|", (FOLDER / "index.md").read_text("utf-8"), re.M)
    assert named_notes == [note.name for note in NOTES]


@pytest.mark.parametrize("note", NOTES, ids=lambda note: note.name[:2])
def test_a_note_has_context_decision_and_consequence_on_a_page(note: Path) -> None:
    text = note.read_text(encoding="utf-8")
    labels = re.findall(r"^\*\*(\w+)\.\*\* ", text, re.M)
    assert labels == ["Context", "Decision", "Consequence"]
    assert 120 <= len(text.split()) <= 250
