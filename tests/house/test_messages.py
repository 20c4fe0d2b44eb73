"""Test that every error has a code and that its wording is listed in one file."""

from __future__ import annotations

import re

from tests.refusals import MESSAGES
from tools.messages import find_error_calls, format_messages


def test_every_error_has_a_code_and_is_in_the_file_of_messages() -> None:
    found = list(find_error_calls())
    assert [site.location for site in found if not site.has_code] == []
    assert {site.code for site in found if not re.fullmatch(r"[a-z0-9-]*", site.code)} == set()
    assert MESSAGES.read_text(encoding="utf-8") == format_messages(found), "run make messages"
