"""TOML as text: exact values, and the right line for each key."""

from __future__ import annotations

import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from anhyst.support.toml_text import key_lines, toml_key, toml_value

TEXTS = st.text(st.characters(exclude_categories=["Cs"]))
SCALARS = st.one_of(st.booleans(), st.integers(-(2**63), 2**63 - 1), TEXTS, st.floats(allow_nan=False))


@given(st.recursive(SCALARS, lambda s: st.lists(s, max_size=4) | st.dictionaries(TEXTS, s, max_size=4)))
def test_a_value_reads_back_exactly(value: object) -> None:
    read = tomllib.loads(f"key = {toml_value(value)}")["key"]
    assert read == value
    assert repr(read) == repr(value)


@given(TEXTS)
def test_a_key_reads_back_exactly(key: str) -> None:
    assert tomllib.loads(f"{toml_key(key)} = 1") == {key: 1}


def test_a_file_name_that_is_no_text_is_still_written() -> None:
    assert tomllib.loads(f"path = {toml_value(chr(0xDC80) + '.csv')}") == {"path": "?.csv"}


def test_none_cannot_be_written_to_toml() -> None:
    with pytest.raises(TypeError, match="NoneType"):
        toml_value(None)


DOCUMENT = '''\
# comment = "no key"
first = 1 # second = 2
"quoted key"."b.c" = "a # b"
list = [
    1, # [not.a.table]
    2,
]
text = """
inside = 1
[inside]
\\""" still """""
literal = \'\'\'
x = 1\'\'\'
[table]
key = { inner = "}", other = [1] }
dotted . key = 'it # is'
[[array]]
key = 1
[array.sub]
key = 2
[[array]]
[[array.deep]]
key = 3
[[array.deep]]
  key = 4
last = true'''


def test_every_key_has_its_line() -> None:
    tomllib.loads(DOCUMENT)  # the document must be valid
    lines = key_lines(DOCUMENT)
    rows = DOCUMENT.splitlines()
    found = {path: rows[line - 1].strip() for path, line in lines.items()}
    assert found == {
        ("first",): "first = 1 # second = 2",
        ("quoted key", "b.c"): '"quoted key"."b.c" = "a # b"',
        ("list",): "list = [",
        ("text",): 'text = """',
        ("literal",): "literal = '''",
        ("table",): "[table]",
        ("table", "key"): 'key = { inner = "}", other = [1] }',
        ("table", "dotted", "key"): "dotted . key = 'it # is'",
        ("array", 0): "[[array]]",
        ("array", 0, "key"): "key = 1",
        ("array", 0, "sub"): "[array.sub]",
        ("array", 0, "sub", "key"): "key = 2",
        ("array", 1): "[[array]]",
        ("array", 1, "deep", 0): "[[array.deep]]",
        ("array", 1, "deep", 0, "key"): "key = 3",
        ("array", 1, "deep", 1): "[[array.deep]]",
        ("array", 1, "deep", 1, "key"): "key = 4",
        ("array", 1, "deep", 1, "last"): "last = true",
    }
