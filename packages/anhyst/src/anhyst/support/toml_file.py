"""Reading a TOML file against a schema: all that is wrong with it, by line and key."""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, ClassVar, NamedTuple, TypeVar, get_args

from pydantic import (
    BaseModel,
    ConfigDict,
    Discriminator,
    Field,
    GetCoreSchemaHandler,
    Tag,
    ValidationError,
)
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
"""Tags of what a key may hold instead begin with it: they are no part of the key's path."""


class FileFault(NamedTuple):
    """Something wrong with a file that its schema cannot see, such as keys that contradict."""

    key: KeyPath  # where; list elements by index from 0
    text: str  # what is wrong and what to do
    code: str  # as that of an `InputError`


class Advice(NamedTuple):
    """The text of a problem (what is wrong, what to do) and its code, as of an `InputError`."""

    text: str
    code: str


class Table(BaseModel):
    """A table of a file: nothing unknown, nothing converted but whole numbers to floats."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class FileRecord:
    """A table of a file that is a plain record: pydantic reads it, and nobody else pays for that."""

    __slots__ = ()
    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")


class _TupleFromList:
    """Reads a tuple from a list, and calls it so where it is none."""

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
"""Beside a tuple in the annotation of a record's field: the file has a list."""

T = TypeVar("T", bound=Table)


MAX_NAMED_PROBLEMS = 5
"""Problems named after the first; the rest are counted."""


@dataclass(frozen=True, slots=True)
class FileProblem:
    """One thing wrong with a file."""

    line: int | None  # line of the key, or of the table that lacks it; None where there is neither
    key: str  # path of the key
    text: str  # what is wrong and what to do
    code: str  # what is wrong, as that of an `InputError`
    is_in_file: bool  # whether the key stands in the file


class TomlFileError(InputError):
    """A file that does not fit its schema: all problems; the message names the first in full."""

    def __init__(self, path: PathLike, problems: Iterable[FileProblem]) -> None:
        # Missing keys last: most are there, misspelt, and reported at their line.
        self.problems = tuple(sorted(problems, key=lambda p: (not p.is_in_file, p.line or 0)))
        first, *others = self.problems
        location = str(path) if first.line is None else f"{path}:{first.line}"
        text = f"{location}: {first.key}: {first.text}"
        if others:
            named = [
                f"{o.key} (line {o.line})" if o.line else o.key for o in others[:MAX_NAMED_PROBLEMS]
            ]
            more = (
                f" and {len(others) - MAX_NAMED_PROBLEMS} more"
                if len(others) > MAX_NAMED_PROBLEMS
                else ""
            )
            text += f"; wrong as well: {', '.join(named)}{more}"
        super().__init__(text, code=first.code, key=first.key)


class TomlFile:
    """A file as it was read, and what is found to be wrong with it."""

    def __init__(self, path: PathLike) -> None:
        self.path = path
        self.text = text = _read_text(path)
        try:
            self.content: dict[str, Any] = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            raise InputError(
                _describe_damage(path, text, str(error)), code="damaged-toml"
            ) from error
        except (ValueError, RecursionError) as error:  # numbers without end, brackets without end
            text = f"{path}: damaged TOML: {error}; mend it"
            raise InputError(text, code="damaged-toml") from error
        self.lines = key_lines(text)
        self.problems: list[FileProblem] = []

    def add_problem(self, key: KeyPath, text: str, code: str) -> None:
        """Note what is wrong at a key, and what to do; list elements by index from 0."""
        line = self.find_line(key)
        is_in_file = key in self.lines or (*key, 0) in self.lines
        self.problems.append(FileProblem(line, dotted_path(key) or "file", text, code, is_in_file))

    def find_line(self, key: KeyPath) -> int | None:
        """Return the line of a key, or of the table that lacks it; of a list its first table's."""
        while key and not {key, (*key, 0)} & self.lines.keys():
            key = key[:-1]
        return self.lines.get(key, self.lines.get((*key, 0)))

    def add_findings(
        self,
        error: ValidationError,
        advice: Callable[[KeyPath, Any], Advice],
        relocate: Callable[[KeyPath], KeyPath] = lambda location: location,
    ) -> None:
        """Note what a validation found, the first finding of each key."""
        reported = {problem.key for problem in self.problems}
        for finding in error.errors(include_url=False):
            path = (part for part in finding["loc"] if not str(part).startswith(BRANCH_PREFIX))
            key = relocate(tuple(path))
            if dotted_path(key) not in reported:
                reported.add(dotted_path(key))
                self.add_problem(key, *advice(key, finding))

    def to_error(self) -> TomlFileError:
        """Return all that is wrong, to be raised; at least one problem has been noted."""
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


def require_toml_kind(path: PathLike, accepted: Collection[FileKind]) -> FileKind:
    """Return which of several kinds a TOML file is; refuse what is none of them."""
    kind = require_kind(path, accepted)
    return check_kind(TomlFile(path), accepted) if kind is UNKNOWN_FILE else kind


def require_rig(path: PathLike, verb: str) -> FileKind:
    """Return the record of the kind of a rig file that a verb takes; refuse any other file."""
    return require_toml_kind(
        path, [kind for kind in accepted_kinds(verb) if kind.format == RIG_FORMAT]
    )


def check_kind(file: TomlFile, accepted: Collection[FileKind]) -> FileKind:
    """Return which of several kinds a file says that it is; refuse what says none of them."""
    kind = require_kind(file.path, accepted, known_kind=content_kind(file.content))
    if kind is UNKNOWN_FILE:
        names = " or ".join(kind.title for kind in accepted)
        control = file.content.get("control")
        is_rig = file.content.get("format") == RIG_FORMAT
        reason = explain_unusable(control.get("kind")) if isinstance(control, dict) else ""
        if is_rig and reason:
            file.add_problem(("control", "kind"), reason, code="not-installed")
        elif is_rig and (
            rigs := [rig_kind for rig_kind in accepted if rig_kind.format == RIG_FORMAT]
        ):
            controls = " or ".join(f'"{kind.word}"' for kind in rigs)
            text = f"must be {controls}; is this {names}, or a kind whose package is not installed?"
            file.add_problem(("control", "kind"), text, "wrong-format")
        else:
            formats = " or ".join(sorted({f'"{kind.format}"' for kind in accepted}))
            file.add_problem(
                ("format",), f"must be {formats}; is this {names}?", code="wrong-format"
            )
        raise file.to_error()
    return kind


def check_order(low_key: str, low: float, high_key: str, high: float) -> None:
    """Refuse a range that does not rise."""
    if not low < high:
        raise InputError(f"{low_key} must be below {high_key}; correct them", code="range-reversed")


def discriminate_by(key: str, *choices: str, default: str = "", **aliases: str) -> Discriminator:
    """Return what tells tables of a list apart by a key: its value, or that of a like one."""

    def tag(value: Any) -> str:
        named = value.get(key) if isinstance(value, dict) else getattr(value, key, None)
        word = default if named is None else str(named)
        return f"{BRANCH_PREFIX}{aliases.get(word, word)}"

    *others, last = (f'"{word}"' for word in choices)
    text = f"{key} must be {', '.join(others)} or {last}; correct it"
    return Discriminator(tag, custom_error_type="unknown_choice", custom_error_message=text)


def faults_error(path: PathLike, faults: Iterable[FileFault]) -> TomlFileError:
    """Return the error for faults that the schema of a file cannot see, with their lines."""
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
        raise InputError(f"{path}: is no UTF-8 text; name a TOML file", code="not-utf8") from error


def _describe_damage(path: PathLike, text: str, message: str) -> str:
    fault, _, position = message.rpartition(" (at ")
    if position.startswith("line "):
        line = position.removeprefix("line ").partition(",")[0]
    else:
        fault, line = (fault or message), str(len(text.splitlines()))
    return f"{path}:{line}: damaged TOML: {fault[0].lower()}{fault[1:]}; mend this line"


def _find_advice(schema: type[Table], path: KeyPath, finding: Any) -> Advice:
    if finding["type"] == "extra_forbidden":
        key, known_keys = str(path[-1]), _known_keys(schema, finding["loc"][:-1])
        with_unit = [name for name in known_keys if name.startswith(f"{key}_")]
        similar = with_unit or difflib.get_close_matches(key, known_keys, n=1)
        if len(with_unit) == 1:
            return Advice(f"lacks its unit; write {with_unit[0]}", code="unit-missing")
        if similar:
            return Advice(f"is unknown; did you mean {similar[0]}?", code="extra-forbidden")
    return explain_finding(finding)


def _known_keys(schema: type[Table], path: KeyPath) -> list[str]:
    """Keys of the table that a path through the schema leads to, its tags included."""
    tables: list[type[BaseModel]] = [schema]
    annotation: Any = None
    for part in path:
        if isinstance(part, str) and part.startswith(BRANCH_PREFIX):
            tables = _table_types(_find_tagged(annotation, part)) or tables
        elif isinstance(part, str):
            annotation = _fields_by_key(tables[0])[part].annotation
            tables = _table_types(annotation)
            if not tables:
                return []
    return list(_fields_by_key(tables[0]))


def _fields_by_key(table: type[BaseModel]) -> dict[str, FieldInfo]:
    """Fields of a table by their keys in a file."""
    return {field.alias or name: field for name, field in table.model_fields.items()}


def _find_tagged(annotation: Any, tag: str) -> Any:
    """Return what bears a tag inside an annotation, or None."""
    inner = get_args(annotation)
    if any(isinstance(branch, Tag) and branch.tag == tag for branch in inner):
        return annotation
    return next(
        (value for branch in inner if (value := _find_tagged(branch, tag)) is not None), None
    )


def _table_types(annotation: Any) -> list[type[BaseModel]]:
    """Tables inside an annotation such as ``list[Table]`` or ``Table | None``."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    if isinstance(annotation, UnionType) or get_args(annotation):
        return [table for inner in get_args(annotation) for table in _table_types(inner)]
    return []


def dotted_path(path: KeyPath) -> str:
    """Write the path of a key as a person reads it: ``lift_off.speed``, ``loop[2].label``."""
    text = ""
    for part in path:
        text += f"[{part + 1}]" if isinstance(part, int) else f".{part}" if text else part
    return text


def explain_finding(error: dict[str, Any]) -> Advice:
    """Turn one finding of the validation into a clause that says what to do.

    Its code is that of a check of this package, or the kind that pydantic calls it.
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
    return Advice(
        f"{text}, is {value_text}" if len(value_text) <= 40 else text, kind.replace("_", "-")
    )
