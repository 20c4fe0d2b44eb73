"""From measured loops to a folder that runs: ``anhyst init``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from anhyst.data import Loops
from anhyst.data.clean import ReadOptions
from anhyst.data.input_files import list_input_files
from anhyst.data.speeds import describe_rate
from anhyst.support.atomic import PathLike, add_files, check_new
from anhyst.support.errors import InputError
from anhyst.support.jobs import Progress
from anhyst.support.wording import count_text
from anhyst_rigs.draft.bearing import BearingDesign, design_bearing
from anhyst_rigs.draft.force import draft_force_control
from anhyst_rigs.draft.magnet import (
    Machine,
    MachineRequest,
    MeasuredMagnet,
    complete_machine,
    evaluate_loops,
)
from anhyst_rigs.draft.piezo import draft_piezo, fit_stack
from anhyst_rigs.draft.stage import draft_stage
from anhyst_rigs.draft.text import Draft, render_draft

BEARING_COMMANDS = (
    "anhyst simulate {out}/rig.toml --out {out}/run.csv",
    "anhyst tune {out}/rig.toml --out {out}/tuned",
)
FORCE_COMMANDS = ("anhyst force-control {out}/rig.toml --out {out}/run",)
STAGE_COMMANDS = ("anhyst simulate {out}/rig.toml --out {out}/run.csv",)
PIEZO_COMMANDS = (
    "anhyst simulate {out}/rig.toml --out {out}/run.csv",
    "anhyst tune {out}/rig.toml --out {out}/tuned",
    "anhyst excite {out}/rig.toml --out {out}/own.csv",
)
"""What to run in a drafted rig of each kind."""

RIG_FILE, CONTROLLER_FILE, LOOPS_FOLDER = "rig.toml", "controller.toml", "loops"
"""What is written; loops are copied into a folder, so that no file of theirs meets ours."""


@dataclass(frozen=True)
class Drafted:
    """What was written.

    Parameters
    ----------
    out : Path
        The folder.
    files : tuple of str
        In it.
    run : tuple of str
        Commands to go on with.
    found : tuple of str, optional
        What the loops say, a line each.
    guessed : mapping of str to str, optional
        What could have been given and was not: option with its value, and from what.
    guesses : mapping of str to mapping, optional
        All that is guessed, by file: key with its value, and from what.
    """

    out: Path
    files: tuple[str, ...]
    run: tuple[str, ...]
    found: tuple[str, ...] = ()
    guessed: Mapping[str, str] = field(default_factory=dict)
    guesses: Mapping[str, Mapping[str, str]] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """Return it for JSON."""
        return {
            "out": str(self.out),
            "files": list(self.files),
            "found": list(self.found),
            "guesses": {name: dict(guess) for name, guess in self.guesses.items()},
            "run": list(self.run),
        }


def init_bearing(
    paths: Sequence[PathLike],
    out: PathLike,
    request: MachineRequest,
    options: ReadOptions | None = None,
    progress: Progress | None = None,
) -> Drafted:
    """Write rig and controller file of a bearing, with a copy of the loops beside them."""
    check_new(out, [RIG_FILE, CONTROLLER_FILE, LOOPS_FOLDER])
    options = options or ReadOptions()
    source = _LoopSource(paths, options)
    loops = options.read(paths, progress)
    if loops.input.name == "voltage":
        return _init_piezo(loops, source, out, request)
    try:
        magnet = evaluate_loops(loops)
        machine = complete_machine(request, magnet)
        design = design_bearing(machine, magnet)
    except InputError as error:
        raise error.with_location(source.text) from error
    values = {**source.values, "reach": magnet, "machine": machine, "numbers": design}
    files = {
        RIG_FILE: render_draft("bearing", **values),
        CONTROLLER_FILE: render_draft("controller", **values),
    }
    return _write_draft(
        out, files, source, BEARING_COMMANDS, _describe_bearing(magnet, machine, design), machine
    )


def _init_piezo(
    loops: Loops, source: _LoopSource, out: PathLike, request: MachineRequest
) -> Drafted:
    """Write the rig file of a piezo stage, with a copy of the loops that its stack is fitted to."""
    if request != MachineRequest():
        raise InputError(
            "--mass, --load and --gap belong to a bearing, and loops over a voltage to a piezo "
            "stage; leave them out",
            code="option-not-for-this",
            key="--mass",
        )
    try:
        if loops.output.name != "displacement":
            text = "a piezo stage needs columns of voltage and displacement, such as u_V and x_um"
            raise InputError(text, code="columns-missing")
        stack = fit_stack(loops)
    except InputError as error:
        raise error.with_location(source.text) from error
    files = {RIG_FILE: draft_piezo(source.name, loops, stack)}
    found = (
        f"stack of {1e6 * stack.stroke:.4g} um from {stack.low:.4g} to {stack.high:.4g} V",
        f"the law of Bouc and Wen misses the loops by {stack.fit_text}",
        f"creep: {stack.creep_text}",
    )
    return _write_draft(out, files, source, PIEZO_COMMANDS, found)


def init_rig(
    paths: Sequence[PathLike],
    out: PathLike,
    options: ReadOptions,
    progress: Progress | None,
    stage: MachineRequest | None = None,
) -> Drafted:
    """Write the rig file of a stage between two magnets, or of one whose force is controlled."""
    check_new(out, [RIG_FILE, LOOPS_FOLDER])
    source = _LoopSource(paths, options)
    loops = options.read(paths, progress)
    try:
        magnet = evaluate_loops(loops)
        arguments = magnet, source.values
        rig = draft_force_control(*arguments) if stage is None else draft_stage(*arguments, stage)
    except InputError as error:
        raise error.with_location(source.text) from error
    lines = [line] if (line := describe_rate(loops)) else []
    run = FORCE_COMMANDS if stage is None else STAGE_COMMANDS
    return _write_draft(out, {RIG_FILE: rig}, source, run, (_describe_magnet(magnet), *lines))


class _LoopSource:
    """The loops of a draft: how they are called, and their copies."""

    def __init__(self, paths: Sequence[PathLike], options: ReadOptions) -> None:
        self.name = Path(paths[0]).resolve().name
        self.text = f"{paths[0]}" + (f" and {len(paths) - 1} more" if len(paths) > 1 else "")
        self.copies: dict[str, Path] = {}
        for path in list_input_files(list(paths), options.sidecar):
            folder = path.parent.resolve()
            for other in self.copies.values():
                if other.stem == path.stem and other.parent.resolve() != folder:
                    raise InputError(
                        f"{path}: {other} has the same name; rename one of them", code="name-twice"
                    )
            self.copies[f"{LOOPS_FOLDER}/{path.name}"] = path
        tables = [name for name in self.copies if not name.endswith(".toml")]
        reading = {name.removeprefix("read_"): one for name, one in options.as_settings().items()}
        if options.sidecar is not None:
            reading["sidecar"] = f"{LOOPS_FOLDER}/{Path(options.sidecar).name}"
        files = tables[0] if len(tables) == 1 else tables
        self.values: dict[str, Any] = {"name": self.name, "files": files, "reading": reading}


def _write_draft(
    out: PathLike,
    files: Mapping[str, Draft],
    source: _LoopSource,
    run: Sequence[str],
    found: tuple[str, ...],
    machine: Machine | None = None,
) -> Drafted:
    add_files(out, {name: draft.text for name, draft in files.items()}, source.copies)
    return Drafted(
        Path(out),
        (*files, *source.copies),
        tuple(command.format(out=Path(out)) for command in run),
        found,
        {} if machine is None else machine.list_guesses(),
        {name: draft.guesses for name, draft in files.items()},
    )


def _describe_bearing(
    magnet: MeasuredMagnet, machine: Machine, design: BearingDesign
) -> tuple[str, ...]:
    return (
        _describe_magnet(magnet),
        f"{machine.mass.number:g} kg held against {machine.load.number:g} N at "
        f"{1e3 * machine.gap.number:g} mm: unstable pole {design.pole:.3g} Hz, controller "
        f"{design.bandwidth:g} Hz, {design.rate:g} ticks a second",
    )


def _describe_magnet(magnet: MeasuredMagnet) -> str:
    gaps, forces = 1e3 * magnet.gaps, magnet.forces
    gap_text = f"at {gaps[0]:.4g} mm" if gaps.size == 1 else f"{gaps[0]:.4g} to {gaps[-1]:.4g} mm"
    force_text = (
        f"{forces[0]:.4g} N" if gaps.size == 1 else f"{forces[0]:.4g} to {forces[-1]:.4g} N"
    )
    return f"{count_text(gaps.size, 'gap')}, {gap_text}: {force_text} at {magnet.current_high:.4g} A".replace(
        "1 gaps, at", "one gap of"
    )
