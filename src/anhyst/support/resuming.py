"""Results of long work in a file that grows line by line, so that a stopped run goes on later."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import IO, Any, Self

from anhyst.support.atomic import PathLike, atomic_writer, write_error
from anhyst.support.errors import InputError


class ResultsFile:
    """A file of JSON lines: a header that says what it belongs to, then one result a line.

    A last line that was cut off, by a full disk or a lost process, is dropped. Use it as a context.
    """

    def __init__(
        self,
        path: PathLike,
        header: Mapping[str, Any],
        key: str,
        fault: Callable[[Mapping[str, Any]], str | None],
    ) -> None:
        self.path = Path(path)
        self._key, self._fault = key, fault
        self.done: dict[int, dict[str, Any]] = {}
        if not self.path.exists():
            with atomic_writer(self.path) as stream:
                stream.write(_line(header))
        try:
            content = self.path.read_bytes()
            whole = content.rfind(b"\n") + 1
            self._read(content[:whole], header)
            if whole < len(content):
                os.truncate(self.path, whole)
            self._stream: IO[str] = self.path.open("a", encoding="utf-8", newline="")
        except OSError as error:
            raise write_error(self.path, error) from error

    def _read(self, content: bytes, header: Mapping[str, Any]) -> None:
        rows = content.splitlines()
        self._check(self._parse(rows[0], 1) if rows else {}, header)
        for number, row in enumerate(rows[1:], start=2):
            result = self._parse(row, number)
            wrong = self._fault(result)
            if wrong is not None:
                raise InputError(
                    f"{self.path}: line {number}: {wrong}; {_AGAIN}", code="damaged-results"
                )
            self.done[result[self._key]] = result

    def _parse(self, row: bytes, number: int) -> dict[str, Any]:
        try:
            found = json.loads(row)
        except ValueError:
            found = None
        if not isinstance(found, dict):
            raise InputError(
                f"{self.path}: line {number}: cannot be read; {_OTHER}", code="damaged-results"
            )
        return found

    def _check(self, found: Mapping[str, Any], wanted: Mapping[str, Any]) -> None:
        for name, value in wanted.items():
            there = found.get(name)
            if there != json.loads(json.dumps(value)):
                text = f"is {_short(there)} in the file and {_short(value)} now"
                raise InputError(
                    f"{self.path}: line 1: {name}: {text}, its results belong to something else; "
                    f"{_OTHER}",
                    code="other-results",
                    key=name,
                )

    def add(self, result: Mapping[str, Any]) -> None:
        """Append a result; it is on its way to the disk when this returns."""
        self.done[result[self._key]] = dict(result)
        try:
            self._stream.write(_line(result))
            self._stream.flush()
        except OSError as error:
            raise write_error(self.path, error) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stream.close()


_OTHER = "name another file or remove this one"
_AGAIN = "remove this line, so that its work is done again, or name another file"


def _line(row: Mapping[str, Any]) -> str:
    return json.dumps(row, ensure_ascii=False, allow_nan=False) + "\n"


def _short(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 24 else f"{text[:12]}..."
