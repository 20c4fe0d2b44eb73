"""Detect the encoding of a text file, and refuse binary files.

UTF-16 is recoded to UTF-8 in memory, so that all readers get bytes that contain ASCII.
"""

from __future__ import annotations

import codecs
import os
import re
import stat
from pathlib import Path

from anhyst.data.formats.channels import MAX_BYTES
from anhyst.support.errors import InputError

HEADER_ADVICE = "name the columns in the first line, such as 'I_A,F_N,gap_m'"
_UNREADABLE_FORMATS = (
    (rb"PK", "is a zip archive", "unpack it, or export the table as CSV"),
    (rb"\x1f\x8b", "is a gzip archive", "unpack it"),
    (rb"\xd0\xcf\x11\xe0", "is an Excel workbook of the old kind (.xls)", "save it as .xlsx or CSV"),
    (rb"TDSh", "is the index of a TDMS file", "name the .tdms file next to it"),
    (rb"\|CF,", "is a binary imc FAMOS file", "export it from FAMOS as ASCII, MAT or MDF 4"),
    (rb"[\s\S]{0,64}WAVEDESC", "is a binary LeCroy trace", "save it as ASCII or MAT"),
    (rb"[\s\S]{0,1500}:CURV", "is a binary Tektronix waveform", "save it as CSV or MAT"),
    (rb"[\s\S]{0,4}:WFM#", "is a binary Tektronix waveform", "save it as CSV or MAT"),
    (rb"AG(01|03|10|30)", "is a binary Keysight waveform", "save it as CSV"),
    (rb"", "is a binary file of an unsupported format", "export it as CSV, MAT or MDF 4"),
)
"""First bytes of unsupported files, the fault and the remedy; the last entry matches every file."""


def _detect_utf16(head: bytes) -> str | None:
    """Return the encoding of UTF-16 text, with or without a byte order mark; otherwise ``None``."""
    sample = head[:4096]
    if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    even_zeros, odd_zeros = sample[::2].count(0), sample[1::2].count(0)
    if even_zeros + odd_zeros > len(sample) // 4 and min(even_zeros, odd_zeros) <= len(sample) // 100:
        return "utf-16-be" if even_zeros > odd_zeros else "utf-16-le"
    return None


def is_text(head: bytes) -> bool:
    """Whether the first bytes of a file are text."""
    sample = head[:4096]
    if head.startswith((b"PK\x03\x04", b"\x1f\x8b", b"\xd0\xcf\x11\xe0")):
        return False
    control_count = sum(sample.count(code) for code in range(32) if code not in {9, 10, 12, 13, 26})
    return _detect_utf16(head) is not None or control_count <= len(sample) // 200


def refuse_binary(path: Path, head: bytes) -> None:
    """Raise an error with the kind of the file if it is not text."""
    if is_text(head):
        return
    _, fault, remedy = next(
        known_format for known_format in _UNREADABLE_FORMATS if re.match(known_format[0], head)
    )
    raise InputError(f"{path}: {fault}; {remedy}", code="not-a-text")


def detect_encoding(head: bytes) -> str:
    """Return UTF-8 if the text can be decoded (its last character may be cut), else Latin-1."""
    if head.startswith(codecs.BOM_UTF8):
        return "utf-8-sig"
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)
    except UnicodeDecodeError:
        return "latin-1"
    return "utf-8"


def read_head(path: Path, max_bytes: int) -> tuple[bytes, int]:
    """Return the first bytes of a file and its size."""
    try:
        file_mode = path.stat().st_mode
        if not stat.S_ISREG(file_mode) and not stat.S_ISDIR(file_mode):
            raise InputError(
                f"{path}: is a pipe or a device, and a table is read more than once; save it as a file first",
                code="not-a-file",
            )
        with path.open("rb") as file:
            head = file.read(max_bytes)
            size = os.fstat(file.fileno()).st_size
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; check the path", code="no-such-file") from None
    except IsADirectoryError:
        raise InputError(
            f"{path}: is a folder, not a file; name the file in it", code="is-a-folder"
        ) from None
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read: {error.strerror}; check the path and its permissions",
            code="cannot-be-read",
        ) from None
    if not head.strip():
        if size > len(head):
            raise InputError(
                f"{path}: begins with {len(head)} blanks: no table; {HEADER_ADVICE}", code="no-table"
            )
        raise InputError(f"{path}: is empty; {HEADER_ADVICE}", code="empty-file")
    return head, size


def recode_utf16(path: Path, head: bytes) -> bytes | None:
    """Return a UTF-16 file as UTF-8; ``None`` if it has another encoding."""
    encoding = _detect_utf16(head)
    if encoding is None:
        return None
    if path.stat().st_size > MAX_BYTES:
        raise InputError(
            f"{path}: is UTF-16 text of more than {MAX_BYTES >> 30} GiB; save it as UTF-8", code="too-large"
        )
    return path.read_bytes().decode(encoding, "replace").encode()
