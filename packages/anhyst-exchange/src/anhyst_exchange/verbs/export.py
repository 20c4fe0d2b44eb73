"""The command ``export``: export a model or a rig for other tools."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from anhyst.model.actuator import Model
    from anhyst.support.atomic import PathLike
    from anhyst.support.jobs import Progress
    from anhyst_exchange.exporter import Exported

PLACE = 25, "Use a model"

ExportForm = Literal["fmu", "simulink", "lut"]
"""Forms of the export: FMU, S-function, or tables."""
ModelComponent = Literal["compensator", "actuator"]
"""Part of a model that is exported."""
CompensatorKind = Literal["full", "simplified"]
"""Kinds of compensator."""
FmiVersion = Literal["2.0", "3.0"]
"""Versions of the FMI standard."""


def export(
    model: Model | PathLike,
    out: PathLike,
    *,
    as_: ExportForm = "fmu",
    of: ModelComponent | None = None,
    rate: float | None = None,
    kind: CompensatorKind | None = None,
    fmi: FmiVersion = "2.0",
    platforms: Sequence[str] | None = None,
    progress: Progress | None = None,
) -> Exported:
    """Export a model or a rig for other tools, as FMU, S-function or tables.

    A compensator gives the same results as the compiled fixed-point C on a controller, and an
    actuator the same as the model. A rig file of any kind is exported as plant and controller in
    one FMU. An FMU contains the sources, and binaries for Linux, Windows and macOS (extra
    'verify'). Simulink, Amesim, Dymola, OpenModelica and fmpy can import an FMU. An S-function is C
    code that MATLAB compiles with the script in the same folder. For C without a wrapper, use
    anhyst compile.

    Parameters
    ----------
    model : Model or path-like
        A model.toml.
    out : path-like, ``FILE``
        '.fmu', a folder for Simulink, '.csv' or '.json'.
    as_ : str
        'fmu': for co-simulation; 'simulink': a C S-function; 'lut': steady-state loops over the gap
        as tables.
    of : str, optional
        What to export of a model: 'compensator' (demand to current) or 'actuator' (current to
        force). [default: compensator]
    rate : float, at least 1, ``HZ``, optional
        Control ticks per second of a compensator.
    kind : str, optional
        Kind of compensator. [default: full]
    fmi : str
        Version of the FMI standard.
    platforms : sequence of str, ``NAME,...``, optional
        Platforms of an FMU: x86_64-linux, aarch64-linux, x86_64-windows, x86_64-darwin,
        aarch64-darwin. [default: all]
    progress : callable, optional
        Called with the work done and the total work.

    Returns
    -------
    Exported

    Raises
    ------
    InputError
        The model cannot be read or exported in this form, or the output cannot be written.

    Examples
    --------
    anhyst export model.toml --as fmu --rate 20000 --out magnet.fmu

    anhyst export model.toml --as fmu --of actuator --out actuator.fmu

    anhyst export rig.toml --as fmu --out bearing.fmu

    anhyst export examples/stage/rig.toml --as fmu --out stage.fmu

    anhyst export examples/solenoid/rig.toml --as fmu --out valve.fmu

    anhyst export examples/piezo/rig.toml --as fmu --out piezo.fmu

    anhyst export model.toml --as simulink --rate 20000 --out simulink

    anhyst export model.toml --as lut --out magnet.csv
    """
    from anhyst.model.actuator import resolve_model
    from anhyst.support.atomic import check_path
    from anhyst_exchange.exporter import PLATFORM_NAMES, Exported, export_fmu, export_sfunction, export_tables

    check_path(out, "export: out")
    if as_ == "lut":
        path = export_tables(resolve_model(model, "export"), out)
    elif as_ == "simulink":
        path = export_sfunction(model, out, of=of, rate=rate, kind=kind)
    else:
        names = PLATFORM_NAMES if platforms is None else platforms
        path = export_fmu(
            model, out, of=of, rate=rate, kind=kind, fmi=fmi, platforms=names, progress=progress
        )
    return Exported(path, as_)
