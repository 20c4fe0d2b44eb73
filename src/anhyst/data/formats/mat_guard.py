"""What a MAT file of version 5 says of its own sizes, checked before anything is made of it."""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from anhyst.data.formats.channels import MOST_BYTES
from anhyst.support.errors import InputError

_HEADER = 128
_MATRIX, _COMPRESSED = 14, 15
_CELL, _STRUCT, _OBJECT, _CHAR, _OPAQUE = 1, 2, 3, 4, 17
_NUMBERS = range(5, 16)
_DEEPEST = 40
_MOST_PARTS = 500_000
"""Each part becomes an object of Python."""


@dataclass
class MatGuard:
    """Walks through the parts of a MAT file without building any.

    ``objects`` are the variables that are objects of a class of MATLAB: name and class.
    """

    path: Path
    objects: list[tuple[str, str]] = field(default_factory=list)
    _parts: int = 0
    _order: str = "<"

    def check(self, content: bytes) -> None:
        """Check a whole file."""
        self._order = "<" if content[126:128] == b"IM" else ">"
        offset, expanded = _HEADER, 0
        view = memoryview(content)
        while offset + 8 <= len(view):
            kind, size = struct.unpack_from(f"{self._order}2I", view, offset)
            offset += 8
            if size > len(view) - offset:
                raise self._fault(f"is cut off after {len(view)} bytes")
            body = view[offset : offset + size]
            offset += size
            if kind == _COMPRESSED:
                body = memoryview(self._expand(body, MOST_BYTES - expanded))
                expanded += len(body)
                kind, inner = self._tag(body)
                body = body[8 : 8 + inner]
            if kind == _MATRIX:
                self._matrix(body, 0, is_variable=True)

    def _expand(self, body: memoryview, most: int) -> bytes:
        engine = zlib.decompressobj()
        try:
            content = engine.decompress(body, most + 1)
        except zlib.error as error:
            raise self._fault(f"has a damaged compressed variable ({error})") from None
        if len(content) > most:
            raise InputError(
                f"{self.path}: expands to more than {MOST_BYTES >> 30} GiB; cut the recording into "
                "parts",
                code="too-large",
            )
        return content

    def _tag(self, body: memoryview) -> tuple[int, int]:
        if len(body) < 8:
            raise self._fault("ends within a variable")
        kind, size = struct.unpack_from(f"{self._order}2I", body)
        if size > len(body) - 8:
            raise self._fault("has a variable that is larger than what holds it")
        return kind, size

    def _elements(self, body: memoryview) -> Iterator[tuple[int, memoryview]]:
        """Yield the parts of a variable, one after the other: type and content."""
        offset = 0
        while offset < len(body):
            if len(body) - offset < 8:
                raise self._fault("ends within a variable")
            kind, size = struct.unpack_from(f"{self._order}2I", body, offset)
            if kind >> 16:  # a small one, all in 8 bytes
                kind, size, begin, step = kind & 0xFFFF, kind >> 16, offset + 4, 8
                if size > 4:
                    raise self._fault("has a small part of more than 4 bytes")
            else:
                begin, step = offset + 8, 8 + size + (-size % 8)
            if begin + size > len(body):
                raise self._fault("has a part that is larger than what holds it")
            self._parts += 1
            if self._parts > _MOST_PARTS:
                raise self._fault(f"holds more than {_MOST_PARTS} parts")
            yield kind, body[begin : begin + size]
            offset += step

    def _matrix(self, body: memoryview, depth: int, *, is_variable: bool = False) -> None:
        if not len(body):
            return
        if depth > _DEEPEST:
            raise self._fault(f"is nested more than {_DEEPEST} deep")
        parts = self._elements(body)
        flags = self._numbers(parts, "I")
        kind = flags[0] & 0xFF if flags else 0
        if kind == _OPAQUE:
            if is_variable:
                texts = [
                    bytes(content).decode("latin-1")
                    for _, (_, content) in zip("abc", parts, strict=False)
                ]
                self.objects.append((texts[0], texts[-1]) if len(texts) == 3 else ("", "?"))
            return
        shape = self._numbers(parts, "i")
        if any(side < 0 for side in shape):
            raise self._fault("has a variable of negative size")
        count = math.prod(shape)
        self._next(parts)  # the name
        if kind in {_CELL, _STRUCT, _OBJECT}:
            self._members(parts, kind, count, depth)
        elif kind == _CHAR:
            if count > len(body):
                raise self._fault("has a text that is longer than what is there")
        elif kind in _NUMBERS and kind != 5 and count > len(body):
            raise self._fault("has an array that is larger than what is there")

    def _members(
        self, parts: Iterator[tuple[int, memoryview]], kind: int, count: int, depth: int
    ) -> None:
        if kind == _OBJECT:
            self._next(parts)  # the name of the class
        fields = 1
        if kind != _CELL:
            (width,) = self._numbers(parts, "i") or (0,)
            names = self._next(parts)
            if width < 1 and len(names):
                raise self._fault("has a structure without names of fields")
            fields = len(names) // width if width > 0 else 0
            if count > _MOST_PARTS:
                raise self._fault(f"holds more than {_MOST_PARTS} parts")
        found = 0
        for number, content in parts:
            found += 1
            if number == _MATRIX:
                self._matrix(content, depth + 1)
        if found < count * fields:
            raise self._fault("has a structure with fewer parts than it says")

    def _numbers(self, parts: Iterator[tuple[int, memoryview]], code: str) -> tuple[int, ...]:
        content = self._next(parts)
        return struct.unpack_from(f"{self._order}{len(content) // 4}{code}", content)

    def _next(self, parts: Iterator[tuple[int, memoryview]]) -> memoryview:
        part = next(parts, None)
        if part is None:
            raise self._fault("ends within a variable")
        return part[1]

    def _fault(self, what: str) -> InputError:
        return InputError(
            f"{self.path}: {what}: the MAT file is damaged; export it again", code="damaged-file"
        )
