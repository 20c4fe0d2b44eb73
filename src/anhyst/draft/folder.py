"""A folder that can be moved: drafts beside a copy of the loops that they are of."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path

from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError
from anhyst.support.folder import whole_folder, write_texts


def check_new(out: PathLike, names: Sequence[str]) -> None:
    """Find out before the work whether files can be put into a folder."""
    target = Path(out)
    if target.exists() and not target.is_dir():
        raise InputError(f"{out}: is a file; name a folder", code="is-a-file")
    for name in names:
        if (target / name).exists():
            raise InputError(
                f"{target / name}: is there already; remove it or name another folder",
                code="exists-already",
            )


def put(out: PathLike, texts: Mapping[str, str], copies: Mapping[str, Path]) -> None:
    """Write texts and copies of files into a folder, all of them or none."""
    check_new(out, [*texts, *{Path(name).parts[0] for name in copies}])
    with whole_folder(out) as draft:
        write_texts(draft, texts)
        for name, source in copies.items():
            (draft / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source, draft / name)
