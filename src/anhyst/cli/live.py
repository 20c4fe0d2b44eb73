"""The verb ``live``."""

from __future__ import annotations

import importlib.util
import secrets
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from anhyst.cli.console import show
from anhyst.cli.progress import progress_bar
from anhyst.support.errors import InputError

if TYPE_CHECKING:
    from anhyst.live.improver import Improver
    from anhyst.rig.bench.protocol import Bench

_PACKAGES = ("orjson", "starlette", "uvicorn", "websockets")


def live(
    rig: Annotated[
        Path,
        typer.Argument(
            metavar="RIG",
            help="Rig file: a bearing, or a force rig. With --xcp or --port the compiled folder "
            "around which the firmware is built.",
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
            metavar="PORT",
            help="The same on a serial port that carries XCP, such as /dev/ttyACM0.",
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
    drives the virtual magnet, in real time; or it runs on a board already. The page shows its
    signals and operates it. Ctrl-C ends it.

    Example: anhyst live examples/bearing/rig.toml
    """
    for name in _PACKAGES:
        if importlib.util.find_spec(name) is None:
            raise InputError(
                f"live: {name} is not installed: pip install 'anhyst[live]'",
                code="not-installed",
                key=name,
            )
    from anhyst.live.guard import read_address
    from anhyst.live.recorder import start_recording
    from anhyst.live.run import listen_on, serve
    from anhyst.live.session import LiveSession

    if xcp is not None and port is not None:
        raise InputError(
            "--port: one controller at a time; leave it or --xcp out",
            code="options-together",
            key="--port",
        )
    url = port if xcp is None else f"socket://{xcp}"
    if url is None and known is not None:
        raise InputError(
            "--rig: the rig file of a virtual rig is the argument; leave --rig out",
            code="option-not-for-this",
            key="--rig",
        )
    if url is not None and controller is not None:
        raise InputError(
            "--controller: a controller that runs has one already; leave it out",
            code="option-not-for-this",
            key="--controller",
        )
    shown = secrets.token_urlsafe(16) if token else ""

    def started(address: str) -> None:
        show(*([f"token: {shown}"] if shown else []), f"{address}  ctrl-C ends it")

    with listen_on(*read_address(listen, token)) as taken:
        bench, improver = _open(rig, controller, url, known)
        try:
            recording = (
                None if record is None else start_recording(record, bench.signals, bench.rate)
            )
        except BaseException:
            bench.close()
            raise
        folder = Path() if record is None else record.parent
        session = LiveSession(
            bench, recording, folder, improver, improver.curves if improver else ()
        )
        title = rig.resolve().parent.name if url is None else f"{rig.resolve().name} at {url}"
        serve(session, title, taken, shown, started)
    if recording is not None:
        show(f"written: {recording.path}, {recording.rows} ticks")


def _open(
    rig: Path, controller: Path | None, url: str | None, known: Path | None
) -> tuple[Bench, Improver | None]:
    """Open a virtual rig, whose model can be improved, or a controller that runs."""
    from anhyst.live.improver import Improver
    from anhyst.study.bench import open_board, prepare_board
    from anhyst.study.kept import prepared_once

    if url is not None:
        on_board = None if known is None else prepare_board(known, rig)
        board = open_board(rig, url)
        return board, None if on_board is None else Improver(on_board, board)
    with progress_bar("live") as progress, prepared_once(rig, controller, progress) as prepared:
        bench = prepared.open()  # runs on without the folder
        return bench, Improver(prepared, bench)
