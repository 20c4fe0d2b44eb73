"""Every error says by a code what it is; how it is worded stands in one file."""

from __future__ import annotations

import re

from tests.refusals import MESSAGES
from tools.messages import golden, sites


def test_every_error_has_a_code_and_stands_in_the_file_of_messages() -> None:
    found = list(sites())
    assert [site.place for site in found if not site.named] == []
    assert {site.code for site in found if not re.fullmatch(r"[a-z0-9-]*", site.code)} == set()
    assert MESSAGES.read_text(encoding="utf-8") == golden(found), "run make messages"
