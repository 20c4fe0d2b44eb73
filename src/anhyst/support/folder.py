"""Folders: written whole or not at all, that of what is kept, those of the C sources."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from anhyst.support.atomic import PathLike, write_error
from anhyst.support.errors import InputError


def cache_folder(kind: str) -> Path:
    """Return where things of a kind are kept; ``XDG_CACHE_HOME`` says where caches are.

    A user without a home has none: below the null device nothing is found or made.
    """
    try:
        caches = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    except RuntimeError:
        caches = Path(os.devnull)
    return caches / "anhyst" / kind


def seen_from(folder: Path, place: Path) -> str:
    """Return how a file is named in another folder; past a link to a folder ".." leads elsewhere."""
    whole = os.path.join(os.path.realpath(place.parent), place.name)
    return Path(os.path.relpath(whole, os.path.realpath(folder))).as_posix()


def core_folder() -> Path:
    """Return the folder with ``include/``, ``src/`` and ``port/`` of the core.

    In a source tree it is the one that is edited, otherwise the copy inside the package.
    """
    package = Path(__file__).resolve().parents[1]
    for place in (package.parents[1] / "core", package / "_core" / "c"):
        if (place / "include" / "anhyst" / "compensator" / "compensator.h").is_file():
            return place
    raise InputError(
        f"{package}: the C sources of the core are missing; install anhyst again",
        code="installation-incomplete",
    )


def plant_folder() -> Path:
    """Return the folder with ``include/`` and ``src/`` of the virtual plant; see :func:`core_folder`."""
    package = Path(__file__).resolve().parents[1]
    for place in (package.parents[1] / "plant", package / "_core" / "plant"):
        if (place / "include" / "anhyst_plant" / "body.h").is_file():
            return place
    raise InputError(
        f"{package}: the C sources of the plant are missing; install anhyst again",
        code="installation-incomplete",
    )


@contextmanager
def whole_folder(out: PathLike, *, replace: bool = False) -> Iterator[Path]:
    """Give a folder to work in; what is in it appears in its place when all is done, else nothing."""
    target = Path(os.path.realpath(out))
    if target.exists() and not target.is_dir():
        raise InputError(f"{out}: is a file; name a folder", code="is-a-file")
    as_whole = replace or not target.exists()
    draft = (target.parent if as_whole else target) / f".{target.name}.{os.getpid()}.part"
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        draft.mkdir()
        yield draft
        if as_whole:
            _exchange(draft, target)
        else:
            _move_files(draft, target)
    except OSError as error:
        if error.filename is None or str(error.filename).startswith(str(target.parent)):
            raise write_error(out, error) from error
        raise
    finally:
        shutil.rmtree(draft, ignore_errors=True)


def write_texts(folder: Path, texts: Mapping[str, str]) -> None:
    """Write files into a folder, by their paths below it."""
    for name, text in texts.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8", newline="\n")


def _exchange(draft: Path, target: Path) -> None:
    """Put a draft where its folder stood."""
    old = target.with_name(draft.name.removesuffix(".part") + ".old")
    if target.exists():
        target.rename(old)
    try:
        draft.rename(target)
    except OSError:
        if old.exists():
            old.rename(target)
        raise
    shutil.rmtree(old, ignore_errors=True)


def _move_files(draft: Path, target: Path) -> None:
    """Put the files of a draft beside others."""
    made: list[Path] = []
    try:
        for file in sorted(path for path in draft.rglob("*") if path.is_file()):
            place = target / file.relative_to(draft)
            for above in reversed(place.relative_to(target).parents[:-1]):
                if not (target / above).exists():
                    (target / above).mkdir()
                    made.append(target / above)
            if not place.exists():
                made.append(place)
            file.replace(place)
    except OSError:
        for place in reversed(made):
            if place.is_dir():
                place.rmdir()
            else:
                place.unlink(missing_ok=True)
        raise
