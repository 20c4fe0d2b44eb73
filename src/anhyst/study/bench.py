"""Open the bench of a rig file: compile its controller, build the firmware, switch on."""

from __future__ import annotations

import tempfile
from pathlib import Path

from anhyst.rig.bench.bearing import BearingBench
from anhyst.study.bearing.on_board import build_firmware
from anhyst.study.bearing.ready import make_ready, read_files
from anhyst.support.atomic import PathLike
from anhyst.support.progress import Progress

_WORK = 3.0
"""Parts of the work: reading, model and code, the firmware's start."""


def open_bench(
    rig_path: PathLike, controller_path: PathLike | None = None, progress: Progress | None = None
) -> BearingBench:
    """Open the virtual bench of a rig.

    Parameters
    ----------
    rig_path : path-like
        Rig file of a bearing.
    controller_path : path-like, optional
        Controller file; ``controller.toml`` beside the rig file if left out.
    progress : callable, optional
        Called with what is done and what there is in all.

    Returns
    -------
    BearingBench
        At rest, before its first tick. To be closed.

    Raises
    ------
    InputError
        A file that cannot be read or does not fit the others; a controller that is not compiled;
        no compiler.
    """
    rig, controller = read_files(rig_path, controller_path)
    ready = make_ready(rig, controller)
    _report(progress, 1.0)
    with tempfile.TemporaryDirectory(prefix="anhyst-") as place:
        setup, firmware = build_firmware(
            ready.rig, controller, ready.knowledge(), "host", Path(place)
        )
        _report(progress, 2.0)
        bench = BearingBench(setup, firmware)  # it runs on without its file
    _report(progress, _WORK)
    return bench


def _report(progress: Progress | None, done: float) -> None:
    if progress is not None:
        progress(done, _WORK)
