"""Open the bench of a rig file: compile its controller, build the firmware, switch on."""

from __future__ import annotations

import json
import tempfile
import tomllib
from pathlib import Path

from anhyst.data import LoopSet
from anhyst.link.xcp import XcpMaster
from anhyst.rig.bearing.file import read_bearing
from anhyst.rig.bench.bearing import BearingBench
from anhyst.rig.bench.force import ForceBench
from anhyst.rig.bench.hardware import HardwareBench
from anhyst.rig.force.file import read_rig
from anhyst.rig.force.modelling import find_model, loops_of_rig
from anhyst.rig.force.programs import prepare
from anhyst.rig.from_loops import complete_rig
from anhyst.study.bearing.on_board import build_firmware
from anhyst.study.bearing.ready import make_ready, read_files
from anhyst.study.prepared import Prepared, PreparedBearing, PreparedForce
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
        bench = prepare_bench(rig_path, controller_path, Path(place), progress).open()
    _report(progress, _WORK)
    return bench


def open_board(folder: PathLike, url: str) -> HardwareBench:
    """Open the bench of a controller that runs by itself.

    Parameters
    ----------
    folder : path-like
        That ``anhyst compile`` wrote and the controller's firmware is built around.
    url : str
        Where it offers XCP: ``socket://HOST:PORT``, or a serial port.

    Returns
    -------
    HardwareBench
        As it runs. To be closed.

    Raises
    ------
    InputError
        No such folder, nobody there, or the firmware is built around another folder.
    """
    place = Path(folder) / "manifest.json"
    try:
        manifest = json.loads(place.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        manifest = None
    if not isinstance(manifest, dict) or "signals" not in manifest:
        raise InputError(
            f"{place}: is not there or no manifest; name the folder that anhyst compile wrote and "
            "the firmware is built around"
        )
    line = XcpMaster(url)
    try:
        return HardwareBench(line, manifest)
    except BaseException:
        line.close()
        raise


def measured_loops(rig_path: PathLike) -> LoopSet:
    """Read the loops that the file of a bearing or a force rig names.

    Raises
    ------
    InputError
        A file that cannot be read.
    """
    rig = read_rig(rig_path) if is_force_rig(rig_path) else read_bearing(rig_path)
    return rig.measured.read()


def prepare_bench(
    rig_path: PathLike,
    controller_path: PathLike | None,
    place: Path,
    progress: Progress | None = None,
) -> Prepared:
    """Compile and build all that the virtual bench of a rig needs.

    Parameters
    ----------
    rig_path, controller_path : path-like
        As of :func:`open_bench`.
    place : Path
        Folder for what is made on the way, and for the firmware.
    progress : callable, optional
        Called with what is done and what there is in all.

    Returns
    -------
    Prepared
        What opens it.

    Raises
    ------
    InputError
        As of :func:`open_bench`.
    """
    if is_force_rig(rig_path):
        if controller_path is not None:
            raise InputError(f"{controller_path}: a force rig has no controller file")
        return _force(rig_path, place, progress)
    return _bearing(rig_path, controller_path, place, progress)


def _bearing(
    rig_path: PathLike, controller_path: PathLike | None, place: Path, progress: Progress | None
) -> PreparedBearing:
    rig, controller = read_files(rig_path, controller_path)
    ready = make_ready(rig, controller)
    _report(progress, 1.0)
    known = ready.knowledge()
    setup, firmware = build_firmware(ready.rig, controller, known, "host", place)
    _report(progress, 2.0)
    return PreparedBearing(setup, known.model, firmware)


def _force(rig_path: PathLike, place: Path, progress: Progress | None) -> PreparedForce:
    rig = read_rig(rig_path)
    loops = loops_of_rig(rig)
    rig = complete_rig(rig, loops)
    _report(progress, 1.0)
    program = prepare("full", find_model(rig, loops), rig.settings.rate_Hz, "host", place / "full")
    _report(progress, 2.0)
    return PreparedForce(rig, loops, program)


def is_force_rig(path: PathLike) -> bool:
    """Whether a file is that of a force rig; one that cannot be read is not."""
    try:
        with Path(path).open("rb") as file:
            return tomllib.load(file).get("format") == "anhyst-rig"
    except (OSError, ValueError):
        return False  # whoever reads it says what is wrong


def _report(progress: Progress | None, done: float) -> None:
    if progress is not None:
        progress(done, _WORK)
