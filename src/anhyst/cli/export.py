"""The verbs ``export``, ``convert`` and ``xcp``: what goes to other tools."""

from __future__ import annotations

from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

import anhyst
from anhyst.cli.console import print_json, progress_bar, show, warn
from anhyst.cli.options import AsJson, ModelPath, of_its_kind


class ExportChoice(StrEnum):
    """What a model is exported as."""

    FMU = "fmu"
    SIMULINK = "simulink"
    LUT = "lut"


class FmiChoice(StrEnum):
    """Versions of the standard."""

    SECOND = "2.0"
    THIRD = "3.0"


class OfChoice(StrEnum):
    """What of a model is exported."""

    COMPENSATOR = "compensator"
    ACTUATOR = "actuator"


class ExportKind(StrEnum):
    """Kinds of compensator."""

    FULL = "full"
    SIMPLIFIED = "simplified"


def export(
    model: ModelPath,
    out: Annotated[
        Path,
        typer.Option(
            "--out", "-o", metavar="FILE", help="'.fmu', a folder for Simulink, '.csv' or '.json'."
        ),
    ],
    as_: Annotated[
        ExportChoice,
        typer.Option(
            "--as",
            help="'fmu': for co-simulation; 'simulink': a C S-function; 'lut': settled loops over "
            "the gap as tables.",
        ),
    ] = ExportChoice.FMU,
    of: Annotated[
        OfChoice | None,
        typer.Option(
            help="Of a model: 'compensator', demand in, current out; 'actuator', current in, force "
            "out. [default: compensator]",
            show_default=False,
        ),
    ] = None,
    rate: Annotated[
        float | None,
        typer.Option(
            metavar="HZ", min=1.0, help="Of a compensator: ticks a second.", show_default=False
        ),
    ] = None,
    kind: Annotated[
        ExportKind | None,
        typer.Option(help="Of a compensator. [default: full]", show_default=False),
    ] = None,
    fmi: Annotated[FmiChoice, typer.Option(help="Version of the standard.")] = FmiChoice.SECOND,
    platforms: Annotated[
        str | None,
        typer.Option(
            metavar="NAME,...",
            help="Of an FMU: x86_64-linux, aarch64-linux, x86_64-windows, x86_64-darwin, "
            "aarch64-darwin. [default: all]",
            show_default=False,
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Export a model for other tools: its compensator or the actuator as FMU or S-function; tables.

    A compensator computes what the compiled fixed-point C computes on a controller, an actuator
    what the model does; the rig file of a bearing or a stage gives plant and controller in one. An
    FMU holds the sources, and binaries for Linux, Windows and macOS (extra 'verify'). Simulink, Amesim,
    Dymola, OpenModelica and fmpy read it. An S-function is C that MATLAB compiles with the script
    beside it. For C alone: anhyst compile.

    Example: anhyst export model.toml --as fmu --rate 20000 --out magnet.fmu

    Example: anhyst export model.toml --as fmu --of actuator --out actuator.fmu

    Example: anhyst export rig.toml --as fmu --out bearing.fmu

    Example: anhyst export examples/stage/rig.toml --as fmu --out stage.fmu

    Example: anhyst export model.toml --as simulink --rate 20000 --out simulink

    Example: anhyst export model.toml --as lut --out magnet.csv
    """
    with progress_bar(as_.value) as progress:
        done = anhyst.export(
            model,
            out,
            as_=as_.value,
            of=of.value if of else None,
            rate=rate,
            kind=kind.value if kind else None,
            fmi=fmi.value,
            platforms=None if platforms is None else platforms.split(","),
            progress=progress,
        )
    if as_json:
        print_json(done.as_dict())
    else:
        show(f"written: {out}")


def convert(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="FILE",
            help="A measurement in any format that is read, or a rig file.",
            callback=of_its_kind,
        ),
    ],
    out: Annotated[
        Path,
        typer.Argument(
            metavar="OUT",
            help="To write: .csv, .mat, .mf4, .tdms, .h5 or .parquet; .toml for a rig.",
        ),
    ],
    as_json: AsJson = False,
) -> None:
    """Write a measurement in another file format, or a rig file in the format of today.

    Values stay bit for bit. Where a format cannot hold something, such as groups in a CSV, it is
    said; channels on several clocks are interpolated onto the finest for a CSV or Parquet file.

    Example: anhyst convert recording.mf4 recording.csv
    """
    with progress_bar(f"reading {source.name}") as progress:
        done = anhyst.convert(source, out, progress=progress)
    for text in done.notes:
        warn(text)
    if as_json:
        print_json(asdict(done))
    elif not done.channels:
        show(f"written: {done.out}")
    else:
        channels = "one channel" if done.channels == 1 else f"{done.channels} channels"
        show(f"{done.out}: {channels}, {done.samples} samples")


def xcp(
    port: Annotated[
        str,
        typer.Argument(
            metavar="PORT",
            help="Link of a controller: /dev/ttyACM0, COM3 or socket://HOST:PORT.",
            callback=of_its_kind,
        ),
    ],
    listen: Annotated[
        int,
        typer.Option(
            metavar="NUMBER",
            min=0,
            max=65535,
            help="Port of this machine for the tool; 0 takes a free one.",
        ),
    ] = 5555,
) -> None:
    """Offer XCP on TCP for a controller on a serial port, to CANape, INCA or pyxcp.

    XCP goes through the controller's own link, so that one cable is enough. One tool at a time; its
    limits, its key and its heartbeat are the firmware's. Ctrl-C ends it.

    Example: anhyst xcp /dev/ttyACM0
    """
    anhyst.xcp(
        port, listen, started=lambda taken: show(f"XCP on TCP: 127.0.0.1:{taken}  ctrl-C ends it")
    )
