"""Generate the reference of the command line from the commands themselves."""

from __future__ import annotations

import inspect
from typing import Any

import typer

from anhyst.cli.app import app


def command_line() -> str:
    """Return a page with every command: its purpose, arguments, options and examples."""
    group: Any = typer.main.get_command(app)
    parts = [
        "# Command line\n",
        f"{inspect.cleandoc(group.help)}\n",
        "Completion for bash, zsh and fish: `anhyst --install-completion`.\n",
    ]
    chapters: dict[str, list[str]] = {}
    for name, command in group.commands.items():
        chapters.setdefault(command.rich_help_panel, []).append(_command_section(name, command))
    for chapter, verbs in chapters.items():
        parts += [f"## {chapter}\n", *verbs]
    return "\n".join(parts)


def _command_section(name: str, command: Any) -> str:
    about = inspect.cleandoc(command.help)
    about = "\n".join(
        f"    {line.removeprefix('Example: ')}" if line.startswith("Example: ") else _escape_markdown(line)
        for line in about.splitlines()
    )
    rows = "\n".join(_parameter_row(one) for one in command.params if one.name != "help")
    return f"### anhyst {name}\n\n{about}\n\n| | |\n| --- | --- |\n{rows}\n"


def _parameter_row(one: Any) -> str:
    kinds = {"argument": one.metavar or one.name.upper()}
    name = kinds.get(one.param_type_name) or ", ".join(one.opts)
    metavar = f" {one.metavar}" if one.param_type_name == "option" and one.metavar else ""
    shown = one.default if one.show_default and one.default not in {None, False} else None
    default = "" if shown is None or callable(shown) else f" Default: `{getattr(shown, 'value', shown)}`."
    return f"| `{name}{metavar}` | {_escape_markdown(one.help or '')}{default} |".replace("\n", " ")


def _escape_markdown(text: str) -> str:
    """Return text as Markdown with special characters escaped."""
    for mark in ("<", ">", "|", "*", "["):
        text = text.replace(mark, f"\\{mark}")
    return text
