"""The bundled examples: data and rig files that come with the package."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from anhyst.support.errors import InputError

NEXT: Mapping[str, tuple[str, ...]] = {
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
}
"""The examples, and what to run in a copy of one."""

KINDS = (".csv", ".md", ".toml")
"""What is copied: no scripts, which make what is there."""


def example_files(name: str) -> dict[str, Path]:
    """Return the files of an example by their names in its folder.

    In a source tree they are those that are edited, otherwise the copies inside the package.

    Parameters
    ----------
    name : str
        Of the example, as ``anhyst init --example`` takes it.

    Returns
    -------
    dict of str to Path

    Raises
    ------
    InputError
        There is no such example, or the installation is not complete.
    """
    if name not in NEXT:
        raise InputError(
            f"example: '{name}' is not known; there are: {', '.join(NEXT)}",
            code="unknown-example",
            key="example",
        )
    package = Path(__file__).resolve().parents[1]
    for place in (package.parents[1] / "examples", package / "_examples"):
        folder = place / name
        if (folder / "loops.csv").is_file():
            files = sorted(path for path in folder.rglob("*") if path.suffix in KINDS)
            return {path.relative_to(folder).as_posix(): path for path in files}
    raise InputError(
        f"{package}: the examples are missing; install anhyst again", code="installation-incomplete"
    )
