"""Test that no folder has more hard sentences or vague names than its recorded limit."""

import json

import pytest

from tools import plain_english
from tools.plain_english import Item


def test_no_folder_exceeds_its_limits() -> None:
    limits = json.loads(plain_english.RECORD.read_text("utf-8"))
    shares = plain_english.count_percentages(plain_english.find_items())
    exceeded = plain_english.find_exceeded(shares, limits)
    assert not exceeded, "rewrite the new sentences and names (python -m tools.plain_english)"


@pytest.mark.parametrize(
    ("sentence", "rule"),
    [
        ("Of the force, root mean square.", "opens with a preposition"),
        ("What the fit leaves is noise.", "opens with a relative word"),
        ("The two laws are told apart.", "told"),
        ("The residual is so many times the noise.", "so many"),
        ("It returns None where it does not.", "where as if"),
        ("A start is no candidate.", "is no"),
        ("The search takes the curve of which the slope is largest.", "of which"),
        (" ".join(["word"] * 31), "long"),
    ],
)
def test_checker_finds_a_construction(sentence: str, rule: str) -> None:
    assert rule in Item("a.py", 1, "comment", sentence).broken_rules


@pytest.mark.parametrize(
    "sentence",
    [
        "The search tries many starts for a short time each.",
        "Returns None if the stage does not calibrate itself.",
        "Maximum rate of the applied corrections, in prior standard deviations per second.",
    ],
)
def test_the_checker_accepts_plain_sentences(sentence: str) -> None:
    assert Item("a.py", 1, "comment", sentence).broken_rules == []


def test_checker_reads_each_kind_of_text() -> None:
    source = '"""Return the force."""\n\n# The gap is in metres.\nfar = f"the gap {1} is too large"\n'
    items = plain_english.READERS[".py"]("a.py", source)
    assert {(item.kind, item.line) for item in items} == {
        ("docstring", 1),
        ("comment", 3),
        ("message", 4),
        ("name", 4),
    }
