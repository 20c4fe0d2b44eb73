"""The output folder: written beside its place as a whole, then renamed."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from pathlib import Path

from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError
from anhyst.support.folder import whole_folder, write_texts
from anhyst.support.json_text import json_text

MANIFEST = "manifest.json"
FORMAT = "anhyst-compiled"
REPORTS = ("verify.json", "verify.md")
"""What ``anhyst verify`` adds; it goes with the C that it is about."""


def check_folder(out: PathLike) -> None:
    """Find out before the work whether a folder may be written."""
    target = Path(os.path.realpath(out))
    if target.exists() and not target.is_dir():
        raise InputError(f"{out}: is a file; name a folder", code="is-a-file")
    if target.is_dir() and any(target.iterdir()) and not _is_ours(target):
        raise InputError(
            f"{out}: holds files that anhyst compile has not written; name another folder",
            code="folder-holds-other-files",
        )
    if not target.parent.is_dir():
        raise InputError(f"{target.parent}: no such folder; create it first", code="no-such-folder")
    if not os.access(target.parent, os.W_OK):
        raise InputError(
            f"{target.parent}: cannot be written; name another folder", code="cannot-be-written"
        )


def _is_ours(folder: Path) -> bool:
    """Whether every file there is in the manifest there, or a report on the C that stood there."""
    try:
        manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
        ours = {MANIFEST, *REPORTS, *manifest["files"]}
        found = {path for path in folder.rglob("*") if not path.is_dir()}
        return manifest["product"] == FORMAT and found <= {folder / name for name in ours}
    except (OSError, ValueError, KeyError, TypeError):
        return False


def write_folder(out: PathLike, files: Mapping[str, str], manifest: Mapping[str, object]) -> None:
    """Write all files of a folder, or none."""
    check_folder(out)
    hashes = {name: hashlib.sha256(text.encode()).hexdigest() for name, text in files.items()}
    complete = {"product": FORMAT, **manifest, "files": dict(sorted(hashes.items()))}
    with whole_folder(out, replace=True) as draft:
        write_texts(draft, {**files, MANIFEST: json_text(complete)})
