"""Options that several verbs share, and what their texts mean."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from anhyst.data.read_options import ReadOptions


class BoardChoice(StrEnum):
    """Boards without hardware."""

    LIBRARY = "library"
    HOST = "host"
    QEMU = "qemu-mps2"


def of_its_kind(context: typer.Context, value: Any) -> Any:
    """Refuse a first argument of another kind than the verb takes, and name the verbs that do."""
    from anhyst.support.kinds import TAKES, refuse_other

    verb = str(context.info_name)
    for path in value if isinstance(value, list) else [value] if value else []:
        refuse_other(path, TAKES[verb], verb)
    return value


LoopFiles = Annotated[
    list[Path],
    typer.Argument(metavar="LOOPS", help="CSV files, recordings or folders.", callback=of_its_kind),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]
Scheduler = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS",
        help="Let the workers of a dask scheduler do the work, such as tcp://host:8786 (extra "
        "'cluster'); they see the same files. [default: processes of this machine]",
        show_default=False,
    ),
]

Columns = Annotated[
    str | None,
    typer.Option(
        metavar="FILE=OURS,...",
        help="What columns of the file are, where their headers do not say, such as "
        "'I_A_scaled=I_A,U_M_V=psi_Wb'. An empty right side leaves a column out.",
    ),
]
Sidecar = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="TOML that says what the headers do not (columns, history, ...). Without it, a .toml "
        "of the same name beside each file is used.",
    ),
]
Schedule = Annotated[
    str | None,
    typer.Option(metavar="NAME", help="The quantity or column that parameters run over."),
]
LoopColumn = Annotated[
    str | None,
    typer.Option("--loop", metavar="COLUMN", help="The column that distinguishes loops."),
]
Constants = Annotated[
    str | None,
    typer.Option(
        metavar="OURS=VALUE,...",
        help="What is the same throughout the file and in no column, such as 'gap_mm=0.4'.",
    ),
]
Clean = Annotated[
    str | None,
    typer.Option(
        metavar="STEP,...",
        help="Cleaning steps: dedupe, spikes, steady, drift, offset, skew, thin; or 'none'. "
        "[default: dedupe,thin]",
        show_default=False,
    ),
]
LoopHistory = Annotated[
    str | None,
    typer.Option(
        metavar="HISTORY",
        help="What happened before the first sample: 'demagnetised', 'settled' (a cycle that has "
        "been repeated), or 'conditioned:0,2,0' (turning points of the input in SI units). "
        "[default: as the sidecar says, or proposed from each record]",
        show_default=False,
    ),
]
RunHistory = Annotated[
    str | None,
    typer.Option(
        metavar="HISTORY",
        help="What happened before the first sample: 'demagnetised', 'settled' (the file is a "
        "cycle, repeated until it closes), or 'conditioned:0,2,0' (turning points of the input in "
        "SI units). [default: as the model says]",
        show_default=False,
    ),
]
ModelPath = Annotated[
    Path, typer.Argument(metavar="MODEL", help="A model.toml.", callback=of_its_kind)
]


def read_options(
    columns: str | None = None,
    sidecar: Path | None = None,
    schedule: str | None = None,
    loop: str | None = None,
    constants: str | None = None,
    history: str | None = None,
    clean: str | None = None,
) -> ReadOptions:
    """Collect what the options say about reading measurements."""
    from anhyst.data.read_options import ReadOptions

    return ReadOptions.from_text(
        columns=columns,
        sidecar=None if sidecar is None else str(sidecar),
        schedule=schedule,
        loop=loop,
        constants=constants,
        history=history,
        clean=clean,
    )
