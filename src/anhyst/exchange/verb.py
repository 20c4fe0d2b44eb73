"""The verb ``export``: a model or the rig file of a bearing, in any form that other tools read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from anhyst.exchange.binaries import PLATFORMS_ALL
from anhyst.exchange.compensator_part import Kind
from anhyst.exchange.description import FmiVersion
from anhyst.exchange.fmu_file import Of, export_fmu
from anhyst.exchange.sfunction import export_sfunction
from anhyst.exchange.tables import export_tables
from anhyst.model.actuator import Model
from anhyst.model.file import read_model
from anhyst.support.atomic import PathLike
from anhyst.support.progress import Progress

As = Literal["fmu", "simulink", "lut"]


@dataclass(frozen=True)
class Exported:
    """A file or a folder that was written."""

    out: Path
    form: As

    def as_dict(self) -> dict[str, Any]:
        """Return it for JSON, with its size in bytes."""
        files = [self.out] if self.out.is_file() else [*self.out.rglob("*")]
        size = sum(path.stat().st_size for path in files if path.is_file())
        return {"out": str(self.out), "as": self.form, "bytes": size}


def export(
    model: Model | PathLike,
    out: PathLike,
    *,
    as_: As = "fmu",
    of: Of | None = None,
    rate: float | None = None,
    kind: Kind | None = None,
    fmi: FmiVersion = "2.0",
    platforms: Sequence[str] | None = None,
    progress: Progress | None = None,
) -> Exported:
    """Export a model for other tools: its compensator or the actuator; or its loops as tables.

    Parameters
    ----------
    model : Model or path-like
        The model, its file, or the rig file of a bearing, for plant and controller in one.
    out : path-like
        ``.fmu``, a folder for Simulink, ``.csv`` or ``.json``.
    as_ : str
        ``"fmu"``: for co-simulation; ``"simulink"``: a C S-function; ``"lut"``: settled loops over
        the gap as tables.
    of : str, optional
        Of a model: ``"compensator"`` (if left out), demand in, current out; ``"actuator"``,
        current in, force out.
    rate : float, optional
        Ticks a second of a compensator.
    kind : str, optional
        Of a compensator, ``"full"`` (if left out) or ``"simplified"``.
    fmi : str
        Version of the standard, ``"2.0"`` or ``"3.0"``.
    platforms : sequence of str, optional
        Of an FMU, such as ``"x86_64-linux"``; all if left out.
    progress : callable, optional
        Called with what is done and what there is in all.

    Returns
    -------
    Exported

    Raises
    ------
    InputError
        The model cannot be read or exported so, or the place cannot be written.
    """
    if as_ == "lut":
        path = export_tables(model if isinstance(model, Model) else read_model(model), out)
    elif as_ == "simulink":
        path = export_sfunction(model, out, of=of, rate=rate, kind=kind)
    else:
        names = PLATFORMS_ALL if platforms is None else platforms
        path = export_fmu(
            model, out, of=of, rate=rate, kind=kind, fmi=fmi, platforms=names, progress=progress
        )
    return Exported(path, as_)
