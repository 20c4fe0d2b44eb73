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
    description = inspect.cleandoc(command.help)
    description = "\n".join(
        f"    {line.removeprefix('Example: ')}" if line.startswith("Example: ") else _escape_markdown(line)
        for line in description.splitlines()
    )
    rows = "\n".join(_parameter_row(parameter) for parameter in command.params if parameter.name != "help")
    return f"### anhyst {name}\n\n{description}\n\n| | |\n| --- | --- |\n{rows}\n"


def _parameter_row(parameter: Any) -> str:
    kinds = {"argument": parameter.metavar or parameter.name.upper()}
    name = kinds.get(parameter.param_type_name) or ", ".join(parameter.opts)
    metavar = f" {parameter.metavar}" if parameter.param_type_name == "option" and parameter.metavar else ""
    default_value = (
        parameter.default if parameter.show_default and parameter.default not in {None, False} else None
    )
    default = (
        ""
        if default_value is None or callable(default_value)
        else f" Default: `{getattr(default_value, 'value', default_value)}`."
    )
    return f"| `{name}{metavar}` | {_escape_markdown(parameter.help or '')}{default} |".replace("\n", " ")


def _escape_markdown(text: str) -> str:
    """Return text as Markdown with special characters escaped."""
    for mark in ("<", ">", "|", "*", "["):
        text = text.replace(mark, f"\\{mark}")
    return text
