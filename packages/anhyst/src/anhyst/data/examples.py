"""The bundled examples: measured loops and rig files, ready to run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from anhyst.support.atomic import PathLike, add_files, shipped_folder
from anhyst.support.errors import InputError

EXAMPLES: Mapping[str, tuple[str, ...]] = {
    "bearing": (
        "anhyst simulate {out}/rig.toml --out {out}/run.csv",
        "anhyst tune {out}/rig.toml --out {out}/tuned",
    ),
    "electromagnet": (
        "anhyst inspect {out}/loops.csv",
        "anhyst identify {out}/loops.csv --out {out}/model.toml",
    ),
    "magnetostrictive": (
        "anhyst inspect {out}/loops.csv",
        "anhyst identify {out}/loops.csv --out {out}/model.toml",
    ),
    "piezo": (
        "anhyst identify {out}/loops.csv --out {out}/model.toml",
        "anhyst simulate {out}/rig.toml --out {out}/run.csv",
    ),
    "solenoid": ("anhyst force-control {out}/rig.toml --out {out}/run",),
    "stage": ("anhyst simulate {out}/rig.toml --out {out}/run.csv",),
    "steels": (
        "anhyst inspect {out}/m270_50a.csv",
        "anhyst identify {out}/m270_50a.csv --out {out}/model.toml",
    ),
}
"""The examples, and what to run in a copy of one."""

_COPIED_SUFFIXES = (".csv", ".md", ".toml")
"""Suffixes of the files that are copied, and the licence of data of others: no scripts."""


def example_files(name: str) -> dict[str, Path]:
    """Return the files of an example by their names in its folder.

    In a source tree they are those that are edited, otherwise the copies inside the package.

    Parameters
    ----------
    name : str
        Of the example, as ``anhyst example`` takes it.

    Returns
    -------
    dict of str to Path

    Raises
    ------
    InputError
        There is no such example, or the installation is not complete.
    """
    if name not in EXAMPLES:
        raise InputError(
            f"example: '{name}' is not known; there are: {', '.join(EXAMPLES)}",
            code="unknown-example",
            key="example",
        )
    folder = shipped_folder("anhyst", "examples", "_examples", "bearing") / name
    files = (path for path in sorted(folder.rglob("*")) if path.is_file())
    copied = (path for path in files if path.suffix in _COPIED_SUFFIXES or path.name == "LICENSE")
    return {path.relative_to(folder).as_posix(): path for path in copied}


@dataclass(frozen=True)
class CopiedExample:
    """The copy of an example.

    Parameters
    ----------
    out : Path
        The folder.
    files : tuple of str
        Paths of the files in it.
    run : tuple of str
        Commands to go on with.
    """

    out: Path
    files: tuple[str, ...]
    run: tuple[str, ...]


def copy_example(name: str, out: PathLike) -> CopiedExample:
    """Copy a bundled example into a folder; replace nothing there."""
    files = example_files(name)
    add_files(out, {}, files)
    run = tuple(command.format(out=Path(out)) for command in EXAMPLES[name])
    return CopiedExample(Path(out), tuple(files), run)
