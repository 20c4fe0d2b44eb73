"""The code blocks of README and docs: what each is, and why one is not run."""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass
from functools import cache
from typing import Any

import typer

from anhyst.cli.app import app
from tests.repository import ROOT

PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
RUN = {"sh", "python"}
SHOWN = {"c", "text", "toml"}
"""Languages of blocks that are run, and of those that show a file or what comes out."""

_FENCE = re.compile(r"^( *)```(\S*)\n(.*?)^ *```$", re.M | re.S)
_MARKER = re.compile(r"<!-- (not run|slow): (\S[^>]*) -->\s*\Z")


@dataclass(frozen=True)
class Block:
    """A fenced block: its line, its language, its code, and what a comment before it says."""

    line: int
    language: str
    code: str
    marker: str
    reason: str


def blocks(text: str) -> list[Block]:
    """Return the fenced blocks of a page in their order."""
    found = []
    for match in _FENCE.finditer(text):
        indent, language, code = match.groups()
        code = re.sub(rf"^{indent}", "", code, flags=re.M)
        marked = _MARKER.search(text[: match.start()])
        marker, reason = marked.groups() if marked else ("", "")
        line = text.count("\n", 0, match.start()) + 1
        found.append(Block(line, language, code, marker, reason))
    return found


def indented(text: str) -> list[str]:
    """Return lines that Markdown would take for code without a language."""
    plain = _FENCE.sub("", text)
    return re.findall(r"(?<=\n\n)    \S.*", plain)


def commands(text: str) -> list[list[str]]:
    """Return the words of every ``anhyst VERB ...`` of a page, wherever it stands."""
    fenced = "".join(f"{match[3]}\n" for match in _FENCE.finditer(text))
    quoted = "\n".join(re.findall(r"`([^`\n]+)`", _FENCE.sub("", text)))
    lines = re.findall(r"^\s*(?:\.venv/bin/)?anhyst +([a-z].*)", f"{fenced}\n{quoted}", re.M)
    return [shlex.split(line, comments=True) for line in lines]


@cache
def _verbs() -> dict[str, Any]:
    group: Any = typer.main.get_command(app)
    return dict(group.commands)


def refusal(words: list[str]) -> str:
    """Return why the command line would refuse these words; empty where it would not."""
    verb, *rest = words
    if verb not in _verbs():
        return f"no verb '{verb}'"
    if verb.startswith("--"):
        return ""
    command = _verbs()[verb]
    known = {name for one in command.params for name in one.opts} | {"--help"}
    unknown = [word for word in rest if word.startswith("--") and word not in known]
    return f"anhyst {verb} has no {', '.join(unknown)}" if unknown else ""
