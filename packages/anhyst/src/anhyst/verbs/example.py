"""The command ``example``: copy a bundled example."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from anhyst.data.examples import CopiedExample
    from anhyst.support.atomic import PathLike

PLACE = 10, "From measurements to a model"

ExampleName = Literal["bearing", "electromagnet", "magnetostrictive", "piezo", "solenoid", "stage", "steels"]
"""Names of the bundled examples."""


def example(name: ExampleName, out: PathLike) -> CopiedExample:
    """Copy a bundled example: measured loops, and the files of a rig.

    Existing files are not overwritten.

    Parameters
    ----------
    name : str, argument ``NAME``
        'electromagnet', 'steels', 'magnetostrictive': loops. 'bearing', 'stage', 'solenoid',
        'piezo': loops, and the files of a rig for the package anhyst-rigs.
    out : path-like, ``DIR``
        Output folder.

    Returns
    -------
    CopiedExample
        The folder, its files, and the commands to run next.

    Raises
    ------
    InputError
        There is no such example, or one of the files exists already.

    Examples
    --------
    anhyst example electromagnet --out magnet
    """
    from anhyst.data.examples import copy_example
    from anhyst.support.atomic import check_path

    check_path(out, "example: out")
    return copy_example(name, out)


def show(result: CopiedExample, _: Mapping[str, Any]) -> Iterator[str]:
    """Return the terminal output: the files that were written, and the commands to run next."""
    from anhyst.support.wording import written_files_text

    yield written_files_text(result.out, result.files)
    yield "next:"
    yield from (f"  {command}" for command in result.run)
