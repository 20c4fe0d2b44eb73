"""What is written as JSON, to a file or to a terminal."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

from anhyst.support.atomic import PathLike, atomic_writer


def json_text(content: Mapping[str, Any]) -> str:
    """Return the text of a JSON file; numbers that JSON does not have become null."""
    return json.dumps(plain(content), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def write_json(path: PathLike, content: Mapping[str, Any]) -> None:
    """Write a JSON file, whole or not at all."""
    with atomic_writer(path) as stream:
        stream.write(json_text(content))


def plain(value: Any) -> Any:
    """Return a value as JSON gives it back: names and lists, null for what is no finite number."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, str):
        return value
    if isinstance(value, Sequence):
        return [plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
