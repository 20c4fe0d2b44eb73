"""List the recordings in the folder of a session, and serve them to its pages."""

from __future__ import annotations

import secrets
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import FileResponse
from starlette.routing import Route

MAX_LISTED_RECORDINGS = 50
"""Maximum number of recordings in the list; the newest are listed."""

_FIRST_BYTES = {".csv": b"tick,t_s,", ".mf4": b"MDF     4.10    anhyst  "}
"""First bytes of a recording, by the extension of its file."""


class ListedRecording(NamedTuple):
    """A recording in the folder."""

    name: str
    size_bytes: int
    modified_s: float  # time of the last change, s since 1970


class RecordingFolder:
    """The list of the recordings in a folder. Other files of the folder are not listed."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.recordings: tuple[ListedRecording, ...] = ()
        self.refresh()

    def refresh(self, unfinished: Path | None = None) -> None:
        """Read the folder again, except for a recording that is being written."""
        entries = [_describe_file(path) for path in self.folder.glob("*.*") if path != unfinished]
        found = [entry for entry in entries if entry is not None]
        newest_first = sorted(found, key=lambda one: one.modified_s, reverse=True)
        self.recordings = tuple(newest_first[:MAX_LISTED_RECORDINGS])


def _describe_file(path: Path) -> ListedRecording | None:
    """Return the entry of a file in the list; None if it is not a recording."""
    first_bytes = _FIRST_BYTES.get(path.suffix.lower())
    if first_bytes is None or not path.is_file():
        return None
    try:
        with path.open("rb") as file:
            is_recording = file.read(len(first_bytes)) == first_bytes
        state = path.stat()
    except OSError:
        return None
    return ListedRecording(path.name, state.st_size, state.st_mtime) if is_recording else None


class RecordingRoute:
    """The addresses of the recordings.

    They contain a secret key that the server sends only over a connection that it has accepted.
    Without the key, a program that does not know the token reads nothing.
    """

    def __init__(self, find_folder: Callable[[], RecordingFolder]) -> None:
        key = secrets.token_urlsafe(16)
        self.address = f"/recordings/{key}/"
        self.route = Route(self.address + "{name}", self._send_file)
        self._find_folder = find_folder

    async def _send_file(self, request: Request) -> FileResponse:
        """Send a listed recording."""
        name = request.path_params["name"]
        folder = self._find_folder()
        if name not in [one.name for one in folder.recordings]:
            raise HTTPException(404, "no such recording")
        return FileResponse(folder.folder / name, filename=name)
