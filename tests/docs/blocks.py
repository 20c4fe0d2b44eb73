"""Read the code blocks of README and docs: language, marker, and the reason not to run a block."""

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
"""Languages of blocks that are run, and languages of blocks that show a file or an output."""

_FENCE = re.compile(r"^( *)```(\S*)\n(.*?)^ *```$", re.M | re.S)
_MARKER = re.compile(r"<!-- (not run|slow): (\S[^>]*) -->\s*\Z")


@dataclass(frozen=True)
class Block:
    """Fenced block: line, language, code, and the marker and reason of the comment before it."""

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
    """Return the lines that Markdown would render as code without a language."""
    plain = _FENCE.sub("", text)
    return re.findall(r"(?<=\n\n)    \S.*", plain)


def commands(text: str) -> list[list[str]]:
    """Return the words of every ``anhyst VERB ...`` anywhere on a page."""
    fenced = "".join(f"{match[3]}\n" for match in _FENCE.finditer(text))
    quoted = "\n".join(re.findall(r"`([^`\n]+)`", _FENCE.sub("", text)))
    lines = re.findall(r"^\s*(?:\.venv/bin/)?anhyst +([a-z].*)", f"{fenced}\n{quoted}", re.M)
    return [shlex.split(line, comments=True) for line in lines]


@cache
def _verbs() -> dict[str, Any]:
    group: Any = typer.main.get_command(app)
    return dict(group.commands)


def refusal(words: list[str]) -> str:
    """Return the reason why the command line would reject these words, or an empty string."""
    verb, *verb_arguments = words
    if verb not in _verbs():
        return f"no verb '{verb}'"
    if verb.startswith("--"):
        return ""
    command = _verbs()[verb]
    known_options = {name for param in command.params for name in param.opts} | {"--help"}
    unknown = [word for word in verb_arguments if word.startswith("--") and word not in known_options]
    return f"anhyst {verb} has no {', '.join(unknown)}" if unknown else ""
