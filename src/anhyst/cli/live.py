"""The verbs ``live``, ``watch`` and ``xcp``: what goes on while a rig runs."""

from __future__ import annotations

import importlib.util
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

import anhyst
from anhyst.cli.console import print_json, progress_bar, show
from anhyst.cli.options import AsJson, ModelPath, of_its_kind
from anhyst.support.errors import InputError, NegativeResult

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


def watch(
    model: ModelPath,
    recording: Annotated[
        Path,
        typer.Argument(
            metavar="RECORDING", help="CSV of one run: t_s, I_A, F_N and gap_m, which may move."
        ),
    ],
    least: Annotated[
        float | None,
        typer.Option(
            metavar="N",
            help="Smallest drift worth an alarm. [default: a thousandth of the model's largest "
            "force]",
            show_default=False,
        ),
    ] = None,
    run_length: Annotated[
        float, typer.Option(metavar="CYCLES", min=100, help="Mean run to a false alarm.")
    ] = 1e5,
    as_json: AsJson = False,
) -> None:
    """Say whether a model still fits its magnet, or since when it has drifted and by how much.

    The first cycles of the current in the recording show what the model leaves while it fits; every
    later cycle is held against them. Exit code 1 where the model has drifted.

    Example: anhyst watch model.toml monday.csv
    """
    result = anhyst.watch(model, recording, least=least, run_length=run_length)
    if as_json:
        print_json(result.as_dict())
    if result.finding.drifted is not None:
        raise NegativeResult(str(result), code="drifted")
    if result.finding.learning:
        raise InputError(f"{recording}: too short to say: {result}; record more", code="too-short")
    if not as_json:
        show(str(result))


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
