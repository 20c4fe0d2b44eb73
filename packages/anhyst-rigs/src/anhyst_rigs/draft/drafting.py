"""Write a folder with a rig that is ready to run, from measured loops: the command ``anhyst init``."""

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
    evaluate_loops,
    guess_missing_machine_data,
)
from anhyst_rigs.draft.piezo import draft_piezo, fit_stack
from anhyst_rigs.draft.stage import draft_stage
from anhyst_rigs.draft.text import Draft, render_draft

BEARING_COMMANDS = (
    "anhyst simulate {out}/rig.toml --out {out}/run.csv",
    "anhyst tune {out}/rig.toml --out {out}/tuned",
)
"""Commands that can be run next with a drafted bearing."""
FORCE_COMMANDS = ("anhyst force-control {out}/rig.toml --out {out}/run",)
"""Commands that can be run next with a drafted force rig."""
STAGE_COMMANDS = ("anhyst simulate {out}/rig.toml --out {out}/run.csv",)
"""Commands that can be run next with a drafted stage."""
PIEZO_COMMANDS = (
    "anhyst simulate {out}/rig.toml --out {out}/run.csv",
    "anhyst tune {out}/rig.toml --out {out}/tuned",
    "anhyst excite {out}/rig.toml --out {out}/own.csv",
)
"""Commands that can be run next with a drafted piezo stage."""

RIG_FILE = "rig.toml"
"""Name of the rig file."""
CONTROLLER_FILE = "controller.toml"
"""Name of the controller file."""
LOOPS_FOLDER = "loops"
"""Folder for copies of the loops, so that their names cannot collide with names of other files."""


@dataclass(frozen=True)
class Drafted:
    """The files of a draft.

    Parameters
    ----------
    out : Path
        The folder.
    files : tuple of str
        Names of the files in the folder.
    run : tuple of str
        Commands that can be run next.
    found : tuple of str, optional
        Properties of the loops, one for each line.
    guessed : mapping of str to str, optional
        Options that were not given: option with its value, and the source of the guess.
    guesses : mapping of str to mapping, optional
        All guesses by file: key with its value, and the source of the guess.
    """

    out: Path
    files: tuple[str, ...]
    run: tuple[str, ...]
    found: tuple[str, ...] = ()
    guessed: Mapping[str, str] = field(default_factory=dict)
    guesses: Mapping[str, Mapping[str, str]] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """Return the content of the JSON output."""
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
    """Write the rig file and the controller file of a bearing, and a copy of the loops."""
    check_new(out, [RIG_FILE, CONTROLLER_FILE, LOOPS_FOLDER])
    options = options or ReadOptions()
    source = _LoopSource(paths, options)
    loops = options.read(paths, progress)
    if loops.input.name == "voltage":
        return _init_piezo(loops, source, out, request)
    try:
        magnet = evaluate_loops(loops)
        machine = guess_missing_machine_data(request, magnet)
        design = design_bearing(machine, magnet)
    except InputError as error:
        raise error.with_location(source.text) from error
    values = {**source.values, "reach": magnet, "machine": machine, "numbers": design}
    drafts = {
        RIG_FILE: render_draft("bearing", **values),
        CONTROLLER_FILE: render_draft("controller", **values),
    }
    return _write_draft(
        out, drafts, source, BEARING_COMMANDS, _describe_bearing(magnet, machine, design), machine
    )


def _init_piezo(loops: Loops, loop_source: _LoopSource, out: PathLike, request: MachineRequest) -> Drafted:
    """Write the rig file of a piezo stage, and a copy of the fitted loops."""
    if request != MachineRequest():
        raise InputError(
            "--mass, --load and --gap are for magnets, but loops over a voltage belong to a piezo "
            "stage; omit them",
            code="option-not-for-this",
            key="--mass",
        )
    try:
        if loops.output.name != "displacement":
            text = "a piezo stage needs columns of voltage and displacement, such as u_V and x_um"
            raise InputError(text, code="columns-missing")
        stack = fit_stack(loops)
    except InputError as error:
        raise error.with_location(loop_source.text) from error
    drafts = {RIG_FILE: draft_piezo(loop_source.name, loops, stack)}
    found_texts = (
        f"stack of {1e6 * stack.stroke:.4g} um from {stack.low:.4g} to {stack.high:.4g} V",
        f"residual of the Bouc-Wen model: {stack.fit_text}",
        f"creep: {stack.creep_text}",
    )
    return _write_draft(out, drafts, loop_source, PIEZO_COMMANDS, found_texts)


def init_rig(
    paths: Sequence[PathLike],
    out: PathLike,
    options: ReadOptions,
    progress: Progress | None,
    stage: MachineRequest | None = None,
) -> Drafted:
    """Write the rig file of a stage between two magnets, or of a magnet with force control."""
    check_new(out, [RIG_FILE, LOOPS_FOLDER])
    loop_source = _LoopSource(paths, options)
    loops = options.read(paths, progress)
    try:
        magnet = evaluate_loops(loops)
        arguments = magnet, loop_source.values
        rig = draft_force_control(*arguments) if stage is None else draft_stage(*arguments, stage)
    except InputError as error:
        raise error.with_location(loop_source.text) from error
    lines = [line] if (line := describe_rate(loops)) else []
    run = FORCE_COMMANDS if stage is None else STAGE_COMMANDS
    return _write_draft(out, {RIG_FILE: rig}, loop_source, run, (_describe_magnet(magnet), *lines))


class _LoopSource:
    """The loops of a draft, their names, and the copies of their files."""

    def __init__(self, paths: Sequence[PathLike], options: ReadOptions) -> None:
        self.name = Path(paths[0]).resolve().name
        self.text = f"{paths[0]}" + (f" and {len(paths) - 1} more" if len(paths) > 1 else "")
        self.copies: dict[str, Path] = {}
        for path in list_input_files(list(paths), options.sidecar):
            folder = path.parent.resolve()
            for copied in self.copies.values():
                if copied.stem == path.stem and copied.parent.resolve() != folder:
                    raise InputError(
                        f"{path}: {copied} has the same name; rename one of them", code="name-twice"
                    )
            self.copies[f"{LOOPS_FOLDER}/{path.name}"] = path
        table_names = [name for name in self.copies if not name.endswith(".toml")]
        read_options = {name.removeprefix("read_"): value for name, value in options.as_settings().items()}
        if options.sidecar is not None:
            read_options["sidecar"] = f"{LOOPS_FOLDER}/{Path(options.sidecar).name}"
        file_names = table_names[0] if len(table_names) == 1 else table_names
        self.values: dict[str, Any] = {"name": self.name, "files": file_names, "reading": read_options}


def _write_draft(
    out: PathLike,
    drafts: Mapping[str, Draft],
    loop_source: _LoopSource,
    run: Sequence[str],
    found_texts: tuple[str, ...],
    machine: Machine | None = None,
) -> Drafted:
    """Write the files, and return a description of the draft."""
    add_files(out, {name: draft.text for name, draft in drafts.items()}, loop_source.copies)
    return Drafted(
        Path(out),
        (*drafts, *loop_source.copies),
        tuple(command.format(out=Path(out)) for command in run),
        found_texts,
        {} if machine is None else machine.list_guesses(),
        {name: draft.guesses for name, draft in drafts.items()},
    )


def _describe_bearing(magnet: MeasuredMagnet, machine: Machine, design: BearingDesign) -> tuple[str, ...]:
    return (
        _describe_magnet(magnet),
        f"{machine.mass.number:g} kg against {machine.load.number:g} N at "
        f"{1e3 * machine.gap.number:g} mm: unstable pole {design.pole:.3g} Hz, controller "
        f"{design.bandwidth:g} Hz, {design.rate:g} ticks per second",
    )


def _describe_magnet(magnet: MeasuredMagnet) -> str:
    gaps, forces = 1e3 * magnet.gaps, magnet.forces
    gap_text = f"at {gaps[0]:.4g} mm" if gaps.size == 1 else f"{gaps[0]:.4g} to {gaps[-1]:.4g} mm"
    force_text = f"{forces[0]:.4g} N" if gaps.size == 1 else f"{forces[0]:.4g} to {forces[-1]:.4g} N"
    return f"{count_text(gaps.size, 'gap')}, {gap_text}: {force_text} at {magnet.current_high:.4g} A".replace(
        "1 gaps, at", "one gap of"
    )
