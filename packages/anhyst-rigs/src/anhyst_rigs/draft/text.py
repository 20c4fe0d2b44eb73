"""Render drafts as TOML with comments and rounded numbers, and collect the guesses."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from anhyst.support.toml_text import toml_key, toml_value, with_comment

MAX_PREFIXED_VALUE = 1e-2
"""Limit below which values are written with exponents of milli, micro or nano."""


class Draft(NamedTuple):
    """The text of a drafted file, and its guesses."""

    text: str
    guesses: dict[str, str]  # guesses: key with table and value, and the source of the guess


_TABLE_NAMES = {("sensor", "of"): "{}_sensor.", ("case", "kind"): "{}."}
"""Name of a table of a list in :attr:`Draft.guesses`, by the key that distinguishes the tables."""
_COMMENT_MARK = "  # "
_GUESS_MARK = "; guess: "


def render_draft(template: str, **values: Any) -> Draft:
    """Render a template; align its comments, and collect the comments with a guess."""
    rendered_text = _templates().get_template(f"{template}.toml.j2").render(values)
    lines, guesses, section, table = [], {}, "", ""
    for line in rendered_text.removesuffix("\n").split("\n"):
        text, mark, comment = ("", "", line) if line.startswith("#") else line.rpartition(_COMMENT_MARK)
        lines.append(with_comment(text, comment) if mark else line)
        key, _, value = text.partition(" = ")
        if text.startswith("["):
            section = text.strip("[]")
            table = f"{section}."
        elif (section, key) in _TABLE_NAMES:
            table = _TABLE_NAMES[section, key].format(tomllib.loads(text)[key])
        if _GUESS_MARK in comment and mark:
            rows = format_toml(tomllib.loads(rendered_text)[section][key]) if value == "[" else value
            guesses[f"{table}{key} = {rows}"] = comment.rpartition(_GUESS_MARK)[2]
    return Draft("\n".join(lines) + "\n", guesses)


@cache
def _templates() -> Environment:
    """Return the environment for templates: numbers are written as TOML, texts unchanged."""
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent / "templates"),
        undefined=StrictUndefined,
        trim_blocks=True,
        keep_trailing_newline=True,
        finalize=lambda value: value if isinstance(value, str) else format_toml(value),
    )
    environment.globals |= {
        function.__name__: function for function in (round_nearest, round_up, round_down, step_up, step_down)
    }
    environment.filters |= {
        "toml": format_toml,
        "round_nearest": round_nearest,
        "comment": lambda text: "\n# ".join(text.splitlines()),
    }
    return environment


def format_toml(value: object) -> str:
    """Write a value as TOML; small numbers get exponents of milli, micro or nano, without loss.

    >>> format_toml([0.45e-3, 50e-9, 20.0])
    '[0.45e-3, 50e-9, 20.0]'
    """
    match value:
        case float() if 0.0 < abs(value) < MAX_PREFIXED_VALUE:
            exponent = next((power for power in (-3, -6, -9) if abs(value) >= 10.0 ** (power - 1)), -12)
            text = f"{value * 10.0**-exponent:.12g}e{exponent}"
            return text if float(text) == value else toml_value(value)
        case list():
            return f"[{', '.join(map(format_toml, value))}]"
        case Mapping():
            table_text = ", ".join(f"{toml_key(key)} = {format_toml(entry)}" for key, entry in value.items())
            return f"{{ {table_text} }}"
    return toml_value(value)


ONE_TWO_FIVE = (1.0, 2.0, 5.0, 10.0)
_ROUNDING_TOLERANCE = 1e-9


def round_nearest(value: float, digits: int = 2) -> float:
    """Round a value to a number of significant digits."""
    return float(f"{value:.{digits - 1}e}")


def round_up(value: float, digits: int = 2) -> float:
    """Round a positive value up to a number of significant digits."""
    return _round_in_decade(value, digits, math.ceil, -_ROUNDING_TOLERANCE)


def round_down(value: float, digits: int = 2) -> float:
    """Round a positive value down to a number of significant digits."""
    return _round_in_decade(value, digits, math.floor, _ROUNDING_TOLERANCE)


def step_up(value: float, steps: Sequence[float] = ONE_TWO_FIVE) -> float:
    """Round a positive value up to 1, 2, 5, 10, 20, ..."""
    decade = math.floor(math.log10(value) + _ROUNDING_TOLERANCE)
    step_value = next(step for step in steps if step * (1.0 + _ROUNDING_TOLERANCE) >= value / 10.0**decade)
    return float(f"{step_value:g}e{decade}")


def step_down(value: float) -> float:
    """Round a positive value down to 1, 2, 5, 10, 20, ..."""
    decade = math.floor(math.log10(value) + _ROUNDING_TOLERANCE)
    mantissa = value / 10.0**decade * (1.0 + _ROUNDING_TOLERANCE)
    return float(f"{max(step for step in ONE_TWO_FIVE if step <= mantissa):g}e{decade}")


def _round_in_decade(
    value: float, digits: int, round_whole: Callable[[float], int], tolerance: float
) -> float:
    decade = math.floor(math.log10(value)) - digits + 1
    return float(f"{round_whole(value / 10.0**decade * (1.0 + tolerance))}e{decade}")
