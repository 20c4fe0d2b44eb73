"""List and copy the bundled examples: measured loops and rig files."""

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
"""Names of the examples, and commands to run in a copy of each."""

_COPIED_SUFFIXES = (".csv", ".md", ".toml")
"""Suffixes of the files that are copied, in addition to third-party licences; no scripts."""


def example_files(name: str) -> dict[str, Path]:
    """Return the files of an example by their relative path.

    In a source tree, the files are those of the repository, otherwise the copies in the package.

    Parameters
    ----------
    name : str
        Name of the example, as ``anhyst example`` accepts it.

    Returns
    -------
    dict of str to Path
        Path in the example's folder to the file.

    Raises
    ------
    InputError
        If the example does not exist, or the installation is incomplete.
    """
    if name not in EXAMPLES:
        raise InputError(
            f"example: '{name}' is not known; there are: {', '.join(EXAMPLES)}",
            code="unknown-example",
            key="example",
        )
    folder = shipped_folder("anhyst", "examples", "_examples", "bearing") / name
    files = (path for path in sorted(folder.rglob("*")) if path.is_file())
    copied_files = (path for path in files if path.suffix in _COPIED_SUFFIXES or path.name == "LICENSE")
    return {path.relative_to(folder).as_posix(): path for path in copied_files}


@dataclass(frozen=True)
class CopiedExample:
    """The copy of an example.

    Parameters
    ----------
    out : Path
        Output folder.
    files : tuple of str
        Relative paths of the files in it.
    run : tuple of str
        Commands to run next.
    """

    out: Path
    files: tuple[str, ...]
    run: tuple[str, ...]


def copy_example(name: str, out: PathLike) -> CopiedExample:
    """Copy a bundled example into a folder without replacing any file."""
    files = example_files(name)
    add_files(out, {}, files)
    run = tuple(command.format(out=Path(out)) for command in EXAMPLES[name])
    return CopiedExample(Path(out), tuple(files), run)
