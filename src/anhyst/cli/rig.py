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
    Drop,
    Flip,
    LoopColumn,
    LoopHistory,
    Scale,
    Schedule,
    Sidecar,
    Verbose,
    of_its_kind,
    print_json,
    progress_bar,
    read_options,
    show,
    table,
)
from anhyst.support.errors import InputError
from anhyst.support.wording import count_of

if TYPE_CHECKING:
    from anhyst import CalibratingMove, Drafted, Excitation


_MOST_NAMED = 6
"""Files that are named one by one."""


def init(
    out: Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="Output folder.")],
    loops: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[LOOPS]", help="Measurement files, or folders of them.", callback=of_its_kind
        ),
    ] = None,
    mass: Annotated[
        float | None,
        typer.Option(
            metavar="KG", help="Moving mass. [default: the load is the weight of the mass]"
        ),
    ] = None,
    load: Annotated[
        float | None,
        typer.Option(
            metavar="N",
            help="Force that opens the gap. [default: the weight of the mass, or half the force "
            "at the largest gap]",
        ),
    ] = None,
    gap: Annotated[
        float | None,
        typer.Option(metavar="M", help="Operating gap. [default: the middle of the measured gaps]"),
    ] = None,
    force_control: Annotated[
        bool, typer.Option("--force-control", help="Create a rig for force control instead.")
    ] = False,
    stage: Annotated[
        bool,
        typer.Option(
            "--stage",
            help="Create a stage instead. It follows set-points between two such magnets.",
        ),
    ] = False,
    example: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Copy a bundled example instead: 'bearing', 'electromagnet', "
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
    scale: Scale = None,
    flip: Flip = None,
    drop: Drop = None,
    as_json: AsJson = False,
    _verbose: Verbose = False,
) -> None:
    """Create a rig from your measured loops, ready to run.

    The command writes a folder with rig.toml, controller.toml and a copy of the loops. The folder
    can be moved. Values that the loops show are taken from them. All other values are guessed by
    rules and marked as guesses in the files. Existing files are not overwritten. Loops of
    displacement over voltage give the rig.toml of a piezo stage.

    Example: anhyst init loops.csv --mass 0.8 --load 60 --gap 0.45e-3 --out my

    Example: anhyst init loops.csv --force-control --out my

    Example: anhyst init loops.csv --stage --mass 10 --out my

    Example: anhyst init --example bearing --out my
    """
    options = read_options(
        columns, sidecar, schedule, loop, constants, history, clean, scale, flip, drop
    )
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
        keys = "1 key is a guess" if count == 1 else f"{count} keys are guesses, each"
        show(f"{keys} marked 'guess' in its line; write your numbers there")
    named, others = drafted.files[:_MOST_NAMED], len(drafted.files[_MOST_NAMED:])
    more = f" and {others} more" if others else ""
    show(f"written to {drafted.out}: {', '.join(named)}{more}")
    show("next:", *(f"  {command}" for command in drafted.run))


def excite(
    rig: Annotated[
        Path,
        typer.Argument(
            metavar="RIG",
            help="Rig file of any kind; with --calibrate, the rig file of a stage.",
            callback=of_its_kind,
        ),
    ],
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            "-o",
            metavar="FILE",
            help="CSV file to write, with a sidecar .toml of the same name.",
        ),
    ],
    calibrate: Annotated[
        bool,
        typer.Option(
            "--calibrate",
            help="Instead, run the shortest motion of a stage that shows the errors of its "
            "magnets. FILE is the recording for anhyst calibrate.",
        ),
    ] = False,
    plot: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Plot the drive and the loops, or the motion (png, svg or pdf)."
        ),
    ] = None,
    folder: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="With --xcp or --port: the compiled folder of the firmware.",
        ),
    ] = None,
    xcp: Annotated[
        str | None,
        typer.Option(
            metavar="HOST:PORT",
            help="Measure through a force controller that runs independently and offers XCP at "
            "this address.",
        ),
    ] = None,
    port: Annotated[
        str | None, typer.Option(metavar="PORT", help="The same through a serial port with XCP.")
    ] = None,
    as_json: AsJson = False,
    _verbose: Verbose = False,
) -> None:
    """Measure loops on a rig: design a drive within its limits, apply it and record the loops.

    The armature is fixed at every gap. The drive consists of nested major loops, first-order
    reversal curves, and minor loops around the operating point. The operating point is approached
    from below, from above and with a decaying sine. Every record begins demagnetised, or
    conditioned if the amplifier has no negative current. Current, its rate, force and I^2 t of the
    winding stay within the limits of the rig file. The command reports where a limit reduced the
    drive. For a piezo stage, it records displacement over voltage in the same way, and two fast
    cycles. The rig is simulated. With --xcp or --port, it is a real rig whose armature is fixed at
    one gap. Its controller drives the current and is stopped afterwards.

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
    drawn = table(f"{count_of(figures['loops'], 'loop')}, {figures['samples']} samples", heads)
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
            help="Rig file of any kind. With --xcp or --port, the compiled folder of the firmware.",
            callback=of_its_kind,
        ),
    ],
    controller: ControllerPath = None,
    xcp: Annotated[
        str | None,
        typer.Option(
            metavar="HOST:PORT",
            help="Use a controller that runs independently and offers XCP at this address, "
            "instead of a simulated rig.",
        ),
    ] = None,
    port: Annotated[
        str | None,
        typer.Option(
            metavar="PORT", help="The same through a serial port with XCP, such as /dev/ttyACM0."
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
            help="Write every tick from the first one to a new .csv or .mf4 (MDF) file. The page "
            "writes its recordings to the same folder, or to the working folder.",
        ),
    ] = None,
    listen: Annotated[
        str,
        typer.Option(
            metavar="ADDRESS",
            help="HOST:PORT in digits, or PORT on this machine. Access from other machines "
            "requires --token.",
        ),
    ] = "127.0.0.1:8642",
    token: Annotated[
        bool,
        typer.Option(
            "--token",
            help="Accept only browsers that present a token. The command prints the token.",
        ),
    ] = False,
) -> None:
    """Show, operate and record a running rig in a browser.

    The controller is compiled and built into the firmware. The firmware levitates the simulated
    bearing, or drives the simulated magnet, in real time. With --xcp or --port, it already runs on
    a board. A stage follows its set-point and a piezo stage its triangle, without firmware. The
    page shows the signals and operates the rig. Ctrl-C stops the command.

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
        show(f"written: {recording.path}, {count_of(recording.rows, 'tick')}")
