"""The command ``init``: create a rig from measured loops."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from anhyst.support.atomic import PathLike
    from anhyst.support.jobs import Progress
    from anhyst_rigs.draft.drafting import Drafted

PLACE = 31, "Rigs, simulated and real"
PROGRESS = "reading"


def init(
    out: PathLike,
    loops: PathLike | Sequence[PathLike] | None = None,
    *,
    mass: float | None = None,
    load: float | None = None,
    gap: float | None = None,
    force_control: bool = False,
    stage: bool = False,
    progress: Progress | None = None,
    **reading: Any,
) -> Drafted:
    """Create a rig from your measured loops, ready to run.

    The command writes a folder with rig.toml, controller.toml and a copy of the loops. The folder
    can be moved. Values that the loops determine follow from them. All other values are guessed by
    rules and marked as guesses in the files. Existing files are not overwritten. From loops of
    displacement against voltage, it creates the rig.toml of a piezo stage.

    Parameters
    ----------
    out : path-like, ``DIR``
        Output folder.
    loops : path-like or sequence of path-like, argument ``[LOOPS]``, optional
        Measurement files, or folders of them.
    mass : float, ``KG``, optional
        Moving mass. [default: the mass whose weight is the load]
    load : float, ``N``, optional
        Force that opens the gap. [default: the weight of the mass, or half the force at the largest
        gap]
    gap : float, ``M``, optional
        Operating gap. [default: the middle of the measured gaps]
    force_control : bool
        Create a rig for force control instead.
    stage : bool
        Create a stage instead, which follows set-points between two such magnets.
    progress : callable, optional
        Called with the bytes read and the file size.
    **reading
        How the loops are read: the keywords of `read_loops`, and the cleaning steps ``clean``. The
        rig file will contain these options.

    Returns
    -------
    Drafted
        The folder and its files, with the values that were found or guessed.

    Raises
    ------
    InputError
        The loops cannot be read or are unsuitable, options exclude each other, or one of the files
        exists already.

    Examples
    --------
    anhyst init loops.csv --mass 0.8 --load 60 --gap 0.45e-3 --out my

    anhyst init loops.csv --force-control --out my

    anhyst init loops.csv --stage --mass 10 --out my
    """
    import os

    from anhyst.data.source import collect_read_options
    from anhyst.data.table import check_source, is_data_frame
    from anhyst.support.atomic import check_path
    from anhyst.support.errors import InputError, wrong_type
    from anhyst_rigs.draft.drafting import init_bearing, init_rig
    from anhyst_rigs.draft.magnet import MachineRequest

    check_path(out, "init: out")
    machine_request, options = MachineRequest(mass, load, gap), collect_read_options("init", **reading)
    if force_control and machine_request != MachineRequest():
        text = "--mass, --load and --gap are for a bearing; leave out --force-control"
        raise InputError(text, code="option-not-for-this", key="--mass")
    if stage and (force_control or load is not None):
        text = "--stage: accepts only --mass and --gap; leave out --force-control and --load"
        raise InputError(text, code="option-not-for-this", key="--stage")
    if loops is not None and is_data_frame(loops):
        raise wrong_type("init: loops", "a file, a folder or a list of files", loops)
    if loops is None or (isinstance(loops, Sequence) and not loops):
        text = "no loops are given: name files with loops; anhyst example provides some"
        raise InputError(text, code="no-loops")
    check_source(loops, "init: loops", "a file, a folder or a list of files")
    paths = [loops] if isinstance(loops, str | os.PathLike) else list(loops)
    if force_control or stage:
        return init_rig(paths, out, options, progress, machine_request if stage else None)
    return init_bearing(paths, out, machine_request, options, progress)


def show(result: Drafted, _: Mapping[str, Any]) -> Iterator[str]:
    """Return the terminal output: the values found and guessed, and the commands to run next."""
    from anhyst.support.wording import written_files_text

    yield from result.found
    if result.guessed:
        yield "guessed:"
        yield from (f"  {key}: {why}" for key, why in result.guessed.items())
    count = sum(map(len, result.guesses.values()))
    if count:
        keys = "1 key is a guess" if count == 1 else f"{count} keys are guesses, each"
        yield f"{keys} marked 'guess' in its line; write your values there"
    yield written_files_text(result.out, result.files)
    yield "next:"
    yield from (f"  {command}" for command in result.run)
