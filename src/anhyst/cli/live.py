"""The verb ``live``."""

from __future__ import annotations

import importlib.util
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

import anhyst
from anhyst.cli.console import progress_bar, show
from anhyst.cli.options import of_its_kind
from anhyst.support.errors import InputError

_PACKAGES = ("orjson", "starlette", "uvicorn", "websockets")


def live(
    rig: Annotated[
        Path,
        typer.Argument(
            metavar="RIG",
            help="Rig file: a bearing, a stage, or a force rig. With --xcp or --port the compiled folder "
            "around which the firmware is built.",
            callback=of_its_kind,
        ),
    ],
    controller: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Controller file; 'controller.toml' beside the rig file if left out.",
        ),
    ] = None,
    xcp: Annotated[
        str | None,
        typer.Option(
            metavar="HOST:PORT",
            help="A controller that runs by itself and offers XCP there, in place of a virtual rig.",
        ),
    ] = None,
    port: Annotated[
        str | None,
        typer.Option(
            metavar="PORT", help="The same on a serial port that carries XCP, such as /dev/ttyACM0."
        ),
    ] = None,
    known: Annotated[
        Path | None,
        typer.Option(
            "--rig",
            metavar="FILE",
            help="With --xcp or --port: rig file of the actuator, to measure and improve its model "
            "through the controller.",
        ),
    ] = None,
    record: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Write every tick to a new .csv or .mf4 (MDF), from the first on. The page writes "
            "its recordings beside it, or to the working folder.",
        ),
    ] = None,
    listen: Annotated[
        str,
        typer.Option(
            metavar="ADDRESS",
            help="HOST:PORT in digits, or PORT on this machine. Beyond this machine with --token "
            "only.",
        ),
    ] = "127.0.0.1:8642",
    token: Annotated[
        bool,
        typer.Option("--token", help="Let in only browsers that show a token, which is printed."),
    ] = False,
) -> None:
    """See, touch and record a rig in a browser while it runs.

    The controller is compiled and built into the firmware, which levitates the virtual bearing, or
    drives the virtual magnet, in real time; or it runs on a board already. A stage follows its
    set-point without a firmware. The page shows its signals and operates it. Ctrl-C ends it.

    Example: anhyst live examples/bearing/rig.toml
    """
    for name in _PACKAGES:
        if importlib.util.find_spec(name) is None:
            raise InputError(
                f"live: {name} is not installed: pip install 'anhyst[live]'",
                code="not-installed",
                key=name,
            )
    with ExitStack() as opening:

        def started(address: str, token: str) -> None:
            opening.close()  # ends the bar
            show(*([f"token: {token}"] if token else []), f"{address}  ctrl-C ends it")

        recording = anhyst.live(
            rig,
            controller,
            xcp=xcp,
            port=port,
            known=known,
            record=record,
            listen=listen,
            token=token,
            progress=opening.enter_context(progress_bar("live")),
            started=started,
        )
    if recording is not None:
        show(f"written: {recording.path}, {recording.rows} ticks")
