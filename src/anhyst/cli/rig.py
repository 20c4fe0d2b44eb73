"""The verbs of a rig: ``init``, ``excite``; and while it runs, ``live``, ``watch`` and ``xcp``."""

from __future__ import annotations

import importlib.util
import re
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import anhyst
from anhyst.cli.shared import (
    AsJson,
    Clean,
    Columns,
    Constants,
    ControllerPath,
    LoopColumn,
    LoopHistory,
    ModelPath,
    Schedule,
    Sidecar,
    of_its_kind,
    print_json,
    progress_bar,
    read_options,
    show,
    table,
)
from anhyst.support.errors import InputError, NegativeResult

if TYPE_CHECKING:
    from anhyst import CalibratingMove, Drafted, Excitation


_MOST_NAMED = 6
"""Files that are named one by one."""


def init(
    out: Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="Folder to write to.")],
    loops: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[LOOPS]", help="CSV files, or folders of them.", callback=of_its_kind
        ),
    ] = None,
    mass: Annotated[
        float | None,
        typer.Option(metavar="KG", help="What moves. [default: the load is its weight]"),
    ] = None,
    load: Annotated[
        float | None,
        typer.Option(
            metavar="N",
            help="Force that pulls the gap open. [default: the weight of the mass, or half the "
            "force at the largest gap]",
        ),
    ] = None,
    gap: Annotated[
        float | None,
        typer.Option(metavar="M", help="Where it works. [default: the middle of the loops' gaps]"),
    ] = None,
    force_control: Annotated[
        bool, typer.Option("--force-control", help="Instead, a rig whose force is controlled.")
    ] = False,
    stage: Annotated[
        bool,
        typer.Option(
            "--stage", help="Instead, a stage that follows set-points between two such magnets."
        ),
    ] = False,
    example: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Instead, copy an example that comes with anhyst: 'bearing', 'electromagnet', "
            "'magnetostrictive', 'piezo', 'solenoid', 'stage' or 'steels'.",
        ),
    ] = None,
    columns: Columns = None,
    sidecar: Sidecar = None,
    schedule: Schedule = None,
    loop: LoopColumn = None,
    constants: Constants = None,
    history: LoopHistory = None,
    clean: Clean = None,
    as_json: AsJson = False,
) -> None:
    """Begin: write a rig of your own from measured loops, ready to run.

    A folder with rig.toml, controller.toml and a copy of the loops comes out; it can be moved.
    What the loops say is taken from them, the rest is guessed by rules, and every guess is marked
    as one in the files. What is there already is not written over. Loops of displacement over
    voltage give the rig.toml of a piezo stage.

    Example: anhyst init loops.csv --mass 0.8 --load 60 --gap 0.45e-3 --out my

    Example: anhyst init loops.csv --force-control --out my

    Example: anhyst init loops.csv --stage --mass 10 --out my

    Example: anhyst init --example bearing --out my
    """
    options = read_options(columns, sidecar, schedule, loop, constants, history, clean)
    with progress_bar("reading") as progress:
        drafted = anhyst.init(
            out,
            loops,
            mass=mass,
            load=load,
            gap=gap,
            force_control=force_control,
            stage=stage,
            example=example,
            progress=progress,
            **asdict(options),
        )
    if as_json:
        print_json(drafted.as_dict())
    else:
        _show_draft(drafted)


def _show_draft(drafted: Drafted) -> None:
    show(*drafted.found)
    if drafted.guessed:
        show("guessed:", *(f"  {key}: {why}" for key, why in drafted.guessed.items()))
    count = sum(map(len, drafted.guesses.values()))
    if count:
        show(f"{count} keys are guesses, each marked 'guess' in its line; write your numbers there")
    named, others = drafted.files[:_MOST_NAMED], len(drafted.files[_MOST_NAMED:])
    more = f" and {others} more" if others else ""
    show(f"written to {drafted.out}: {', '.join(named)}{more}")
    show("next:", *(f"  {command}" for command in drafted.run))


def excite(
    rig: Annotated[
        Path,
        typer.Argument(
            metavar="RIG",
            help="Rig file of any kind; with --calibrate of a stage.",
            callback=of_its_kind,
        ),
    ],
    out: Annotated[
        Path,
        typer.Option(
            "--out", "-o", metavar="FILE", help="CSV to write; its sidecar is the .toml beside it."
        ),
    ],
    calibrate: Annotated[
        bool,
        typer.Option(
            "--calibrate",
            help="Instead, let a stage fly the shortest move that shows what its magnets are off "
            "by; FILE is the recording that anhyst calibrate takes.",
        ),
    ] = False,
    plot: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Draw drive and loops, or the move (png, svg or pdf)."),
    ] = None,
    folder: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="With --xcp or --port: the compiled folder around which the firmware is built.",
        ),
    ] = None,
    xcp: Annotated[
        str | None,
        typer.Option(
            metavar="HOST:PORT",
            help="Measure through a controller of force that runs by itself and offers XCP there.",
        ),
    ] = None,
    port: Annotated[
        str | None, typer.Option(metavar="PORT", help="The same on a serial port that carries XCP.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Measure loops: design a drive within the limits of a rig, run it, write what was read.

    At every gap, armature held: nested major loops, first-order reversal curves, and inner loops
    about the operating point, come to from below, from above and by a decaying sine. Every record
    begins demagnetised, or conditioned where the amplifier does not drive below zero. Current, its
    rate, force and I^2 t of the winding keep to the rig file; what had to be designed down is
    said. Of a piezo stage the same records of displacement over voltage, and two fast cycles. The
    rig is the virtual one, or with --xcp or --port a real one at the gap where its armature is
    held: its controller drives the current, and is stopped again.

    Example: anhyst excite rig.toml --out loops.csv; anhyst identify loops.csv --out model.toml

    Example: anhyst excite --calibrate examples/stage/rig.toml --out run.csv
    """
    if calibrate:
        if folder or xcp or port:
            raise anhyst.InputError(
                "--calibrate: flies the virtual stage; leave --folder, --xcp and --port out",
                code="option-not-for-this",
                key="--calibrate",
            )
        move = anhyst.excite_to_calibrate(rig, out, plot=plot)
        if as_json:
            print_json(move.as_dict())
        else:
            _show_move(move, out, plot)
        return
    with progress_bar("measuring") as progress:
        result = anhyst.excite(
            rig, out, plot=plot, folder=folder, xcp=xcp, port=port, progress=progress
        )
    if as_json:
        print_json(result.as_dict())
    else:
        _show_excitation(result, out, plot)


def _show_excitation(excitation: Excitation, out: Path, plot: Path | None) -> None:
    figures = excitation.as_dict()
    specimen, unit = excitation.specimen, excitation.specimen.units[0]
    gap = ["gap mm"] if specimen.gaps else []
    reached, factor = ("force N", 1.0) if specimen.gaps else ("stroke µm", 1e6)
    heads = [*gap, f"largest {unit}", reached, f"about {unit}", "limited by"]
    drawn = table(f"{figures['loops']} loops, {figures['samples']} samples", heads)
    for place in excitation.places:
        drawn.add_row(
            *([f"{1e3 * place.gap:g}"] if gap else []),
            f"{place.peak.value:.4g}",
            f"{factor * place.force:.4g}",
            f"{place.operating:.4g}",
            place.peak.key,
        )
    minutes = figures["duration_s"] / 60.0
    warmth = figures["warmth"]
    warm = "" if warmth is None else f", I^2 t at most {100.0 * warmth:.0f} % of what trips"
    written = [out, out.with_suffix(".toml"), *([] if plot is None else [plot])]
    show(
        drawn,
        f"{minutes:.1f} min of measuring, {figures[f'rate_{unit}_per_s']:.4g} {unit}/s{warm}",
        *(f"note: {note}" for note in excitation.notes),
        *(f"written: {place}" for place in written),
    )


def _show_move(result: CalibratingMove, out: Path, plot: Path | None) -> None:
    move, work = result.move, result.work
    kinds: dict[str, list[str]] = {}
    for name in move.left:
        kinds.setdefault(re.sub(r"_(\d+|[xyz](?=_m))", "", name), []).append(name)
    heads = ["left of what is stated", "after the move", "after its own set-point"]
    drawn = table(f"{move.duration_s:.2f} s", heads)
    for kind, names in kinds.items():
        lefts = [[f"{one.left[name]:.2f}" for name in names] for one in (move, work)]
        drawn.add_row(kind, *(" to ".join(dict.fromkeys((min(one), max(one)))) for one in lefts))
    drawn.add_row("duration, s", *(f"{one.duration_s:.2f}" for one in (move, work)))
    drawn.add_row("condition number", *(f"{one.condition:.2g}" for one in (move, work)))
    missed = ", ".join(name for name in work.hidden if name not in move.hidden)
    show(
        drawn,
        *(
            f"{axis}: {', '.join(f'{one:.3g}' for one in leg.peaks)} m/s2 at {leg.speed:.3g} m/s"
            for axis, leg in result.legs.items()
        ),
        f"stays hidden: {', '.join(move.hidden) or 'nothing'}",
        f"its own set-point hides {missed}" if missed else "its own set-point shows as much",
        *(f"written: {path}" for path in (out, plot) if path is not None),
    )


_PACKAGES = ("orjson", "starlette", "uvicorn", "websockets")


def live(
    rig: Annotated[
        Path,
        typer.Argument(
            metavar="RIG",
            help="Rig file, of any kind. With --xcp or --port the compiled folder around which the firmware is built.",
            callback=of_its_kind,
        ),
    ],
    controller: ControllerPath = None,
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
    set-point, a piezo stage its triangle, without a firmware. The page shows its signals and
    operates it. Ctrl-C ends it.

    Example: anhyst live examples/bearing/rig.toml

    Example: anhyst live examples/piezo/rig.toml
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
