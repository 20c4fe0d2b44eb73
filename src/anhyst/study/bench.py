"""Open the bench of a rig file: compile its controller, build the firmware, switch on."""

from __future__ import annotations

import tempfile
import tomllib
from pathlib import Path

from anhyst.compensate.baselines import fit_ratio
from anhyst.rig.bench.bearing import BearingBench
from anhyst.rig.bench.force import ForceBench
from anhyst.rig.force.file import read_rig
from anhyst.rig.force.modelling import find_model, loops_at, loops_of_rig
from anhyst.rig.force.programs import prepare
from anhyst.rig.from_loops import complete_rig
from anhyst.study.bearing.on_board import build_firmware
from anhyst.study.bearing.ready import make_ready, read_files
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError
from anhyst.support.progress import Progress

_WORK = 3.0
"""Parts of the work: reading, model and code, the firmware's start."""


def open_bench(
    rig_path: PathLike, controller_path: PathLike | None = None, progress: Progress | None = None
) -> BearingBench | ForceBench:
    """Open the virtual bench of a rig.

    Parameters
    ----------
    rig_path : path-like
        Rig file of a bearing, or of a force rig.
    controller_path : path-like, optional
        Controller file of a bearing; ``controller.toml`` beside the rig file if left out.
    progress : callable, optional
        Called with what is done and what there is in all.

    Returns
    -------
    BearingBench or ForceBench
        At rest, before its first tick. To be closed.

    Raises
    ------
    InputError
        A file that cannot be read or does not fit the others; a controller that is not compiled;
        no compiler.
    """
    with tempfile.TemporaryDirectory(prefix="anhyst-") as place:  # a firmware runs on without it
        if _is_force_rig(rig_path):
            if controller_path is not None:
                raise InputError(f"{controller_path}: a force rig has no controller file")
            return _force(rig_path, Path(place), progress)
        return _bearing(rig_path, controller_path, Path(place), progress)


def _bearing(
    rig_path: PathLike, controller_path: PathLike | None, place: Path, progress: Progress | None
) -> BearingBench:
    rig, controller = read_files(rig_path, controller_path)
    ready = make_ready(rig, controller)
    _report(progress, 1.0)
    setup, firmware = build_firmware(ready.rig, controller, ready.knowledge(), "host", place)
    _report(progress, 2.0)
    bench = BearingBench(setup, firmware)
    _report(progress, _WORK)
    return bench


def _force(rig_path: PathLike, place: Path, progress: Progress | None) -> ForceBench:
    rig = read_rig(rig_path)
    loops = loops_of_rig(rig)
    rig = complete_rig(rig, loops)
    _report(progress, 1.0)
    program = prepare("full", find_model(rig, loops), rig.settings.rate_Hz, "host", place / "full")
    _report(progress, 2.0)
    bench = ForceBench(rig, program)
    settings = rig.settings.force_control
    ratio = fit_ratio(loops_at(loops, settings.end_m), settings.force_max_N)
    bench.apply({"ratio": 1.0 / float(ratio.ratio[0])})
    _report(progress, _WORK)
    return bench


def _is_force_rig(path: PathLike) -> bool:
    try:
        with Path(path).open("rb") as file:
            return tomllib.load(file).get("format") == "anhyst-rig"
    except (OSError, ValueError):
        return False  # whoever reads it says what is wrong


def _report(progress: Progress | None, done: float) -> None:
    if progress is not None:
        progress(done, _WORK)
