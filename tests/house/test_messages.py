"""Every error says by a code what it is; how it is worded stands in one file."""

from __future__ import annotations

import re

from tools.messages import golden, sites

from tests.refusals import MESSAGES

SITES = list(sites())


def test_every_error_has_a_code() -> None:
    assert [site.place for site in SITES if not site.named] == []
    assert {site.code for site in SITES if not re.fullmatch(r"[a-z0-9-]*", site.code)} == set()


def test_the_file_of_messages_is_what_the_sources_say() -> None:
    assert MESSAGES.read_text(encoding="utf-8") == golden(SITES), "run make messages"
