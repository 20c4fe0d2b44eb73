"""Which magnets a folder holds."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

from anhyst.data.formats import FORMATS
from anhyst.data.reading import files_read
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError


@dataclass(frozen=True)
class Member:
    """One magnet of a fleet."""

    name: str  # of its file without the ending, or of its folder
    source: Path  # A file of loops, or a folder of them

    def digest(self) -> str:
        """Return the SHA-256 of all that is read of it."""
        whole = hashlib.sha256()
        for path in files_read(self.source):
            whole.update(path.name.encode())
            try:
                whole.update(path.read_bytes())
            except OSError as error:
                raise InputError(
                    f"{path}: cannot be read: {error.strerror}; check the path",
                    code="cannot-be-read",
                ) from None
        return whole.hexdigest()


def find_members(folder: PathLike) -> list[Member]:
    """Return the magnets of a folder, by name: every file of loops, and every folder of them."""
    place = Path(folder)
    if not place.is_dir():
        raise InputError(
            f"{place}: is no folder; name one that holds a file or folder a magnet",
            code="no-such-folder",
        )
    found = [
        Member(path.stem if path.is_file() else path.name, path)
        for path in sorted(place.iterdir())
        if (path.is_file() and path.suffix.lower() in FORMATS) or _holds_loops(path)
    ]
    if not found:
        raise InputError(
            f"{place}: holds no {', '.join(FORMATS)} file and no folder of them", code="no-files"
        )
    names: set[str] = set()
    for member in found:
        if member.name in names:
            raise InputError(
                f"{member.source}: two magnets are called '{member.name}'; rename one",
                code="name-twice",
            )
        names.add(member.name)
    return found


def _holds_loops(path: Path) -> bool:
    return path.is_dir() and any(one.suffix.lower() in FORMATS for one in path.iterdir())
