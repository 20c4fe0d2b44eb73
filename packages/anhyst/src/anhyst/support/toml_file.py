"""Read a TOML file, check it against a schema, and report all faults with line and key."""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, ClassVar, NamedTuple, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, Discriminator, Field, GetCoreSchemaHandler, Tag, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import core_schema

from anhyst.support.atomic import PathLike, read_error
from anhyst.support.errors import InputError
from anhyst.support.kinds import (
    RIG_FORMAT,
    UNKNOWN_FILE,
    FileKind,
    accepted_kinds,
    content_kind,
    explain_unusable,
    require_kind,
)
from anhyst.support.toml_text import KeyPath, key_lines

Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Number = Annotated[float, Field(allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0.0, le=1.0)]
Bits = Annotated[int, Field(ge=4, le=24)]
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]+$")]
BRANCH_PREFIX = "|"
"""First character of the tags of alternative tables, which are not part of the path of a key."""


class FileFault(NamedTuple):
    """A fault of a file that its schema cannot find, such as contradicting keys."""

    key: KeyPath  # path of the key; list elements by index from 0
    text: str  # fault and remedy
    code: str  # code, as for an `InputError`


class Advice(NamedTuple):
    """The text of a problem (fault and remedy), and its code, as for `InputError`."""

    text: str
    code: str


class Table(BaseModel):
    """A table of a file. Unknown keys are errors; only integers are converted, to floats."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class FileRecord:
    """Base of tables that are plain classes. pydantic checks them only when it reads a file."""

    __slots__ = ()
    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")


class _TupleFromList:
    """Reads a tuple from a list, and calls it a list in errors."""

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        item, *others = get_args(source)
        size = None if others == [Ellipsis] else 1 + len(others)
        items = core_schema.list_schema(
            handler.generate_schema(item), strict=True, min_length=size, max_length=size
        )
        return core_schema.no_info_after_validator_function(tuple, items)


TUPLE_FROM_LIST = _TupleFromList()
"""Annotation of a tuple field of a record: the file contains a list."""

FiniteNumber = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Numbers = Annotated[tuple[FiniteNumber, ...], TUPLE_FROM_LIST]
Texts = Annotated[tuple[str, ...], TUPLE_FROM_LIST]

T = TypeVar("T", bound=Table)


MAX_NAMED_PROBLEMS = 5
"""Number of problems that a message lists after the first problem; it only counts the others."""


@dataclass(frozen=True, slots=True)
class FileProblem:
    """A problem of a file."""

    line: int | None  # line of the key, or of the table that lacks it; None without either
    key: str  # path of the key
    text: str  # fault and remedy
    code: str  # code, as for an `InputError`
    is_in_file: bool  # whether the file contains the key


class TomlFileError(InputError):
    """A file does not fit its schema. `problems` has all faults; the text states the first."""

    def __init__(self, path: PathLike, problems: Iterable[FileProblem]) -> None:
        # Missing keys come last: most of them are misspelt, and reported at their line as unknown.
        self.problems = tuple(sorted(problems, key=lambda p: (not p.is_in_file, p.line or 0)))
        first_problem, *other_problems = self.problems
        location = str(path) if first_problem.line is None else f"{path}:{first_problem.line}"
        text = f"{location}: {first_problem.key}: {first_problem.text}"
        if other_problems:
            other_keys = [
                f"{problem.key} (line {problem.line})" if problem.line else problem.key
                for problem in other_problems[:MAX_NAMED_PROBLEMS]
            ]
            more_text = (
                f" and {len(other_problems) - MAX_NAMED_PROBLEMS} more"
                if len(other_problems) > MAX_NAMED_PROBLEMS
                else ""
            )
            text += f"; also wrong: {', '.join(other_keys)}{more_text}"
        super().__init__(text, code=first_problem.code, key=first_problem.key)


class TomlFile:
    """A TOML file and the problems that were found in it."""

    def __init__(self, path: PathLike) -> None:
        self.path = path
        self.text = text = _read_text(path)
        try:
            self.content: dict[str, Any] = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            raise InputError(_describe_damage(path, text, str(error)), code="damaged-toml") from error
        except (ValueError, RecursionError) as error:  # number too long, or nesting too deep
            text = f"{path}: damaged TOML: {error}; correct it"
            raise InputError(text, code="damaged-toml") from error
        self.lines = key_lines(text)
        self.problems: list[FileProblem] = []

    def add_problem(self, key: KeyPath, text: str, code: str) -> None:
        """Add a problem of a key, with its remedy. List elements are counted from 0."""
        line = self.find_line(key)
        is_in_file = key in self.lines or (*key, 0) in self.lines
        self.problems.append(FileProblem(line, dotted_path(key) or "file", text, code, is_in_file))

    def find_line(self, key: KeyPath) -> int | None:
        """Return the line of a key, or of the table that lacks it (of a list: the first table)."""
        while key and not {key, (*key, 0)} & self.lines.keys():
            key = key[:-1]
        return self.lines.get(key, self.lines.get((*key, 0)))

    def add_findings(
        self,
        error: ValidationError,
        advice: Callable[[KeyPath, Any], Advice],
        relocate_key: Callable[[KeyPath], KeyPath] = lambda location: location,
    ) -> None:
        """Add the findings of a validation: the first one of each key."""
        reported_keys = {problem.key for problem in self.problems}
        for finding in error.errors(include_url=False):
            path = (step for step in finding["loc"] if not str(step).startswith(BRANCH_PREFIX))
            key = relocate_key(tuple(path))
            if dotted_path(key) not in reported_keys:
                reported_keys.add(dotted_path(key))
                self.add_problem(key, *advice(key, finding))

    def to_error(self) -> TomlFileError:
        """Return the error with all problems; at least one is required."""
        return TomlFileError(self.path, self.problems)


def read_toml(path: PathLike, schema: type[T], kinds: Collection[FileKind] = ()) -> T:
    """Read a TOML file of one of the given kinds."""
    file = TomlFile(path)
    if kinds:
        check_kind(file, kinds)
    try:
        return schema.model_validate(file.content)
    except ValidationError as error:
        file.add_findings(error, lambda location, finding: _find_advice(schema, location, finding))
        raise file.to_error() from error


def require_toml_kind(path: PathLike, accepted_kinds: Collection[FileKind]) -> FileKind:
    """Return the kind of a TOML file, or raise an error if it is not an accepted kind."""
    kind = require_kind(path, accepted_kinds)
    return check_kind(TomlFile(path), accepted_kinds) if kind is UNKNOWN_FILE else kind


def require_rig(path: PathLike, verb: str) -> FileKind:
    """Return the kind of a rig file that a command accepts; raise an error for any other file."""
    return require_toml_kind(path, [kind for kind in accepted_kinds(verb) if kind.format == RIG_FORMAT])


def check_kind(file: TomlFile, accepted_kinds: Collection[FileKind]) -> FileKind:
    """Return the kind that a TOML file states; raise an error if it is not an accepted kind."""
    kind = require_kind(file.path, accepted_kinds, known_kind=content_kind(file.content))
    if kind is UNKNOWN_FILE:
        names = " or ".join(kind.title for kind in accepted_kinds)
        control = file.content.get("control")
        is_rig = file.content.get("format") == RIG_FORMAT
        reason = explain_unusable(control.get("kind")) if isinstance(control, dict) else ""
        if is_rig and reason:
            file.add_problem(("control", "kind"), reason, code="not-installed")
        elif is_rig and (
            rig_kinds := [rig_kind for rig_kind in accepted_kinds if rig_kind.format == RIG_FORMAT]
        ):
            control_words = " or ".join(f'"{kind.word}"' for kind in rig_kinds)
            text = f"must be {control_words}; is this {names}, or a kind whose package is not installed?"
            file.add_problem(("control", "kind"), text, "wrong-format")
        else:
            format_texts = " or ".join(sorted({f'"{kind.format}"' for kind in accepted_kinds}))
            file.add_problem(("format",), f"must be {format_texts}; is this {names}?", code="wrong-format")
        raise file.to_error()
    return kind


def check_order(low_key: str, low: float, high_key: str, high: float) -> None:
    """Raise an error if the lower end of a range is not below the upper end."""
    if not low < high:
        raise InputError(f"{low_key} must be below {high_key}; correct them", code="range-reversed")


def discriminate_by(key: str, *choices: str, default: str = "", **aliases: str) -> Discriminator:
    """Return a discriminator of tables in a list: the value of a key, or its alias."""

    def tag(value: Any) -> str:
        key_value = value.get(key) if isinstance(value, dict) else getattr(value, key, None)
        word = default if key_value is None else str(key_value)
        return f"{BRANCH_PREFIX}{aliases.get(word, word)}"

    *first_words, last_word = (f'"{word}"' for word in choices)
    text = f"{key} must be {', '.join(first_words)} or {last_word}; correct it"
    return Discriminator(tag, custom_error_type="unknown_choice", custom_error_message=text)


def faults_error(path: PathLike, faults: Iterable[FileFault]) -> TomlFileError:
    """Return the error for faults that the schema of a file cannot find, with their lines."""
    file = TomlFile(path)
    for fault in faults:
        file.add_problem(*fault)
    return file.to_error()


def _read_text(path: PathLike) -> str:
    try:
        return Path(path).read_bytes().decode("utf-8")
    except OSError as error:
        raise read_error(path, error) from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is not UTF-8 text; name a TOML file", code="not-utf8") from error


def _describe_damage(path: PathLike, text: str, message: str) -> str:
    fault, _, position = message.rpartition(" (at ")
    if position.startswith("line "):
        line = position.removeprefix("line ").partition(",")[0]
    else:
        fault, line = (fault or message), str(len(text.splitlines()))
    return f"{path}:{line}: damaged TOML: {fault[0].lower()}{fault[1:]}; correct this line"


def _find_advice(schema: type[Table], path: KeyPath, finding: Any) -> Advice:
    if finding["type"] == "extra_forbidden":
        key, known_keys = str(path[-1]), _known_keys(schema, finding["loc"][:-1])
        with_unit = [name for name in known_keys if name.startswith(f"{key}_")]
        similar_keys = with_unit or difflib.get_close_matches(key, known_keys, n=1)
        if len(with_unit) == 1:
            return Advice(f"lacks its unit; write {with_unit[0]}", code="unit-missing")
        if similar_keys:
            return Advice(f"is unknown; did you mean {similar_keys[0]}?", code="extra-forbidden")
    return explain_finding(finding)


def _known_keys(schema: type[Table], path: KeyPath) -> list[str]:
    """Return the keys of the table at a path of the schema, which includes tags."""
    tables: list[type[BaseModel]] = [schema]
    annotation: Any = None
    for key in path:
        if isinstance(key, str) and key.startswith(BRANCH_PREFIX):
            tables = _table_types(_find_tagged(annotation, key)) or tables
        elif isinstance(key, str):
            annotation = _fields_by_key(tables[0])[key].annotation
            tables = _table_types(annotation)
            if not tables:
                return []
    return list(_fields_by_key(tables[0]))


def _fields_by_key(table: type[BaseModel]) -> dict[str, FieldInfo]:
    """Return the fields of a table by their keys in a file."""
    return {field.alias or name: field for name, field in table.model_fields.items()}


def _find_tagged(annotation: Any, tag: str) -> Any:
    """Return the part of an annotation that has a tag; None if no part has it."""
    union_members = get_args(annotation)
    if any(isinstance(member, Tag) and member.tag == tag for member in union_members):
        return annotation
    return next((value for member in union_members if (value := _find_tagged(member, tag)) is not None), None)


def _table_types(annotation: Any) -> list[type[BaseModel]]:
    """Return the tables inside an annotation such as ``list[Table]`` or ``Table | None``."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    if isinstance(annotation, UnionType) or get_args(annotation):
        return [table for argument in get_args(annotation) for table in _table_types(argument)]
    return []


def dotted_path(path: KeyPath) -> str:
    """Return the path of a key in readable form: ``lift_off.speed``, ``loop[2].label``."""
    text = ""
    for path_part in path:
        text += f"[{path_part + 1}]" if isinstance(path_part, int) else f".{path_part}" if text else path_part
    return text


def explain_finding(error: dict[str, Any]) -> Advice:
    """Convert a finding of the validation to a text with the remedy.

    The code is that of the `InputError` if a check of this package failed, otherwise the type of
    pydantic.
    """
    kind, value = error["type"], error.get("input")
    package_error = error.get("ctx", {}).get("error")
    if isinstance(package_error, InputError):
        return Advice(str(package_error), package_error.code)
    if kind == "missing":
        return Advice("is missing; add it", code="missing")
    if kind in {"extra_forbidden", "unexpected_keyword_argument"}:
        return Advice("is unknown; remove it or correct its name", code="extra-forbidden")
    text = str(error["msg"]).replace("Input should be", "must be", 1)
    text = text[0].lower() + text[1:]
    value_text = repr(value)
    return Advice(f"{text}, is {value_text}" if len(value_text) <= 40 else text, kind.replace("_", "-"))
