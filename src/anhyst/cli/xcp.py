"""The verb ``xcp``."""

from __future__ import annotations

from typing import Annotated

import typer

import anhyst
from anhyst.cli.console import show
from anhyst.cli.options import of_its_kind


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
