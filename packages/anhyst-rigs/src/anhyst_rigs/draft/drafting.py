"""From measured loops, or from a bundled example, to a folder that runs: ``anhyst init``."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from anhyst.data import Loops
from anhyst.data.clean import ReadOptions
from anhyst.data.reading import files_read
from anhyst.data.speeds import rate_line
from anhyst_rigs.draft.bearing import Numbers, draft_bearing, numbers_of
from anhyst_rigs.draft.force import draft_force_control
from anhyst_rigs.draft.magnet import Machine, MeasuredMagnet, Wanted, machine_of, reach_of
from anhyst_rigs.draft.piezo import draft_piezo, fit_stack, found_lines
from anhyst_rigs.draft.stage import draft_stage
from anhyst_rigs.draft.text import Draft
from anhyst.support.atomic import PathLike, whole_folder, write_files
from anhyst.support.errors import InputError
from anhyst.support.jobs import Progress
from anhyst.support.wording import count_of

NEXT: Mapping[str, tuple[str, ...]] = {
    "bearing": (
        "anhyst simulate {out}/rig.toml --out {out}/run.csv",
        "anhyst tune {out}/rig.toml --out {out}/tuned",
    ),
    "electromagnet": (
        "anhyst inspect {out}/loops.csv",
        "anhyst identify {out}/loops.csv --out {out}/model.toml",
    ),
    "magnetostrictive": (
        "anhyst inspect {out}/loops.csv",
        "anhyst identify {out}/loops.csv --out {out}/model.toml",
    ),
    "piezo": (
        "anhyst identify {out}/loops.csv --out {out}/model.toml",
        "anhyst simulate {out}/rig.toml --out {out}/run.csv",
    ),
    "solenoid": ("anhyst force-control {out}/rig.toml --out {out}/run",),
    "stage": ("anhyst simulate {out}/rig.toml --out {out}/run.csv",),
    "steels": (
        "anhyst inspect {out}/m270_50a.csv",
        "anhyst identify {out}/m270_50a.csv --out {out}/model.toml",
    ),
}
"""The examples, and what to run in a copy of one."""

RUN_PIEZO = (
    "anhyst simulate {out}/rig.toml --out {out}/run.csv",
    "anhyst tune {out}/rig.toml --out {out}/tuned",
    "anhyst excite {out}/rig.toml --out {out}/own.csv",
)
"""The same in a drafted piezo stage."""

KINDS = (".csv", ".md", ".toml")
"""Suffixes of the files that are copied, and the licence of data of others: no scripts."""


def example_files(name: str) -> dict[str, Path]:
    """Return the files of an example by their names in its folder.

    In a source tree they are those that are edited, otherwise the copies inside the package.

    Parameters
    ----------
    name : str
        Of the example, as ``anhyst init --example`` takes it.

    Returns
    -------
    dict of str to Path

    Raises
    ------
    InputError
        There is no such example, or the installation is not complete.
    """
    if name not in NEXT:
        raise InputError(
            f"example: '{name}' is not known; there are: {', '.join(NEXT)}",
            code="unknown-example",
            key="example",
        )
    package = Path(__file__).resolve().parents[1]
    for root in (package.parents[1] / "examples", package / "_examples"):
        folder = root / name
        every = (path for path in folder.rglob("*") if path.is_file())
        files = sorted(path for path in every if path.suffix in KINDS or path.name == "LICENSE")
        if files:
            return {path.relative_to(folder).as_posix(): path for path in files}
    raise InputError(
        f"{package}: the examples are missing; install anhyst again", code="installation-incomplete"
    )


def check_new(out: PathLike, names: Sequence[str]) -> None:
    """Find out before the work whether files can be put into a folder."""
    target = Path(out)
    if target.exists() and not target.is_dir():
        raise InputError(f"{out}: is a file; name a folder", code="is-a-file")
    for name in names:
        if (target / name).exists():
            raise InputError(
                f"{target / name}: is there already; remove it or name another folder",
                code="exists-already",
            )


def put(out: PathLike, texts: Mapping[str, str], copies: Mapping[str, Path]) -> None:
    """Write texts and copies of files into a folder, all of them or none."""
    check_new(out, [*texts, *{Path(name).parts[0] for name in copies}])
    with whole_folder(out) as draft:
        write_files(draft, texts)
        for name, source in copies.items():
            (draft / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source, draft / name)


RIG, CONTROLLER, LOOPS = "rig.toml", "controller.toml", "loops"
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
    wanted: Wanted,
    options: ReadOptions | None = None,
    progress: Progress | None = None,
) -> Drafted:
    """Write rig and controller file of a bearing, with a copy of the loops beside them."""
    check_new(out, [RIG, CONTROLLER, LOOPS])
    options = options or ReadOptions()
    source = _Source(paths, options)
    loops = options.read(paths, progress)
    if loops.input.name == "voltage":
        return _init_piezo(loops, source, out, wanted)
    try:
        reach = reach_of(loops)
        machine = machine_of(wanted, reach)
        numbers = numbers_of(machine, reach)
    except InputError as error:
        raise error.at(source.text) from error
    drafts = draft_bearing(source.name, source.key, source.reading, reach, machine, numbers)
    files = {RIG: drafts.rig, CONTROLLER: drafts.controller}
    return _put(out, files, source, NEXT["bearing"], _found(reach, machine, numbers), machine)


def _init_piezo(loops: Loops, source: _Source, out: PathLike, wanted: Wanted) -> Drafted:
    """Write the rig file of a piezo stage, with a copy of the loops that its stack is fitted to."""
    if wanted != Wanted():
        raise InputError(
            "--mass, --load and --gap belong to a bearing, and loops over a voltage to a piezo "
            "stage; leave them out",
            code="option-not-for-this",
            key="--mass",
        )
    try:
        if loops.output.name != "displacement":
            raise InputError(
                "a piezo stage needs columns of voltage and displacement, such as u_V and x_um",
                code="columns-missing",
            )
        stack = fit_stack(loops)
    except InputError as error:
        raise error.at(source.text) from error
    files = {RIG: draft_piezo(source.name, loops, stack)}
    return _put(out, files, source, RUN_PIEZO, found_lines(stack))


def init_rig(
    paths: Sequence[PathLike],
    out: PathLike,
    options: ReadOptions,
    progress: Progress | None,
    stage: Wanted | None = None,
) -> Drafted:
    """Write the rig file of a stage between two magnets, or of one whose force is controlled."""
    check_new(out, [RIG, LOOPS])
    source = _Source(paths, options)
    loops = options.read(paths, progress)
    try:
        reach = reach_of(loops)
        of = source.name, source.key, source.reading, reach
        draft = draft_force_control(*of) if stage is None else draft_stage(*of, stage)
    except InputError as error:
        raise error.at(source.text) from error
    lines = [line] if (line := rate_line(loops)) else []
    run = NEXT["solenoid" if stage is None else "stage"]
    return _put(out, {RIG: draft}, source, run, (_magnet(reach), *lines))


def init_example(name: str, out: PathLike) -> Drafted:
    """Copy a bundled example."""
    files = example_files(name)
    put(out, {}, files)
    return Drafted(Path(out), tuple(files), _commands(NEXT[name], out))


class _Source:
    """The loops of a draft: how they are called, and their copies."""

    def __init__(self, paths: Sequence[PathLike], options: ReadOptions) -> None:
        self.name = Path(paths[0]).resolve().name
        self.text = f"{paths[0]}" + (f" and {len(paths) - 1} more" if len(paths) > 1 else "")
        self.copies: dict[str, Path] = {}
        for path in files_read(list(paths), options.sidecar):
            folder = path.parent.resolve()
            for other in self.copies.values():
                if other.stem == path.stem and other.parent.resolve() != folder:
                    raise InputError(
                        f"{path}: {other} has the same name; rename one of them", code="name-twice"
                    )
            self.copies[f"{LOOPS}/{path.name}"] = path
        tables = [name for name in self.copies if not name.endswith(".toml")]
        self.key: str | list[str] = tables[0] if len(tables) == 1 else tables
        self.reading = {
            name.removeprefix("read_"): value for name, value in options.as_settings().items()
        }
        if options.sidecar is not None:
            self.reading["sidecar"] = f"{LOOPS}/{Path(options.sidecar).name}"


def _put(
    out: PathLike,
    files: Mapping[str, Draft],
    source: _Source,
    run: Sequence[str],
    found: tuple[str, ...],
    machine: Machine | None = None,
) -> Drafted:
    put(out, {name: draft.text() for name, draft in files.items()}, source.copies)
    return Drafted(
        Path(out),
        (*files, *source.copies),
        _commands(run, out),
        found,
        {} if machine is None else machine.guessed(),
        {name: draft.guesses() for name, draft in files.items()},
    )


def _commands(run: Sequence[str], out: PathLike) -> tuple[str, ...]:
    return tuple(command.format(out=Path(out)) for command in run)


def _found(reach: MeasuredMagnet, machine: Machine, numbers: Numbers) -> tuple[str, ...]:
    return (
        _magnet(reach),
        f"{machine.mass.number:g} kg held against {machine.load.number:g} N at "
        f"{1e3 * machine.gap.number:g} mm: unstable pole {numbers.pole:.3g} Hz, controller "
        f"{numbers.bandwidth:g} Hz, {numbers.rate:g} ticks a second",
    )


def _magnet(reach: MeasuredMagnet) -> str:
    gaps, forces = 1e3 * reach.gaps, reach.forces
    where = f"at {gaps[0]:.4g} mm" if gaps.size == 1 else f"{gaps[0]:.4g} to {gaps[-1]:.4g} mm"
    pull = f"{forces[0]:.4g} N" if gaps.size == 1 else f"{forces[0]:.4g} to {forces[-1]:.4g} N"
    return f"{count_of(gaps.size, 'gap')}, {where}: {pull} at {reach.current_high:.4g} A".replace(
        "1 gaps, at", "one gap of"
    )
