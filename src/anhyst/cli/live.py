"""The verb ``live``."""

from __future__ import annotations

import importlib.util
import secrets
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import typer

from anhyst.cli.console import show
from anhyst.cli.progress import progress_bar
from anhyst.support.errors import InputError

_PACKAGES = ("starlette", "uvicorn", "websockets")


def live(
    rig: Annotated[
        Path, typer.Argument(metavar="RIG", help="Rig file: a bearing, or a force rig.")
    ],
    controller: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Controller file; 'controller.toml' beside the rig file if left out.",
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
    drives the virtual magnet, in real time; the page shows its signals and operates it. Ctrl-C ends it.

    Example: anhyst live examples/bearing/rig.toml
    """
    for name in _PACKAGES:
        if importlib.util.find_spec(name) is None:
            raise InputError(f"live: {name} is not installed: pip install 'anhyst[live]'")
    from anhyst.live.curves import make_curves
    from anhyst.live.guard import read_address
    from anhyst.live.improver import Improver
    from anhyst.live.recorder import start_recording
    from anhyst.live.run import listen_on, serve
    from anhyst.live.session import LiveSession
    from anhyst.study.bench import measured_loops, prepare_bench

    taken = listen_on(*read_address(listen, token))
    with progress_bar("live") as progress, TemporaryDirectory(prefix="anhyst-") as place:
        prepared = prepare_bench(rig, controller, Path(place), progress)
        bench = prepared.open()  # runs on without the folder
    try:
        recording = None if record is None else start_recording(record, bench.signals, bench.rate)
    except BaseException:
        bench.close()
        raise
    shown = secrets.token_urlsafe(16) if token else ""

    def started(address: str) -> None:
        show(*([f"token: {shown}"] if shown else []), f"{address}  ctrl-C ends it")

    folder = Path() if record is None else record.parent
    curves = make_curves(measured_loops(rig), prepared.model)
    session = LiveSession(bench, recording, folder, Improver(prepared, bench), curves)
    serve(session, rig.resolve().parent.name, taken, shown, started)
    if recording is not None:
        show(f"written: {recording.path}, {recording.rows} ticks")
