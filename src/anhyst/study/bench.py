"""Open the bench of a rig file: compile its controller, build the firmware, switch on."""

from __future__ import annotations

import hashlib
import json
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

from anhyst.compensate.block import DemandLimits, Kind, Scales
from anhyst.compensate.interface import MethodName
from anhyst.compensate.plan import CompileRequest
from anhyst.link.xcp import XcpMaster
from anhyst.model.actuator import Model
from anhyst.model.file import read_model
from anhyst.rig.bench.bearing import BearingBench
from anhyst.rig.bench.force import ForceBench
from anhyst.rig.bench.hardware import HardwareBench
from anhyst.rig.bench.stage import StageBench, StageVariant
from anhyst.rig.force.file import read_rig
from anhyst.rig.force.modelling import find_model, loops_of_rig
from anhyst.rig.force.programs import prepare
from anhyst.rig.from_loops import complete_rig
from anhyst.rig.stage.file import read_stage
from anhyst.rig.stage.loop import identify_stage, make_stage
from anhyst.rig.stage.setpoint import motion_of
from anhyst.study.bearing.on_board import build_firmware
from anhyst.study.bearing.ready import make_ready, read_files
from anhyst.study.excite.excite import Excitation, Measuring
from anhyst.study.excite.limits import Specimen
from anhyst.study.excite.on_board import measure_on_board
from anhyst.study.prepared import (
    Prepared,
    PreparedBearing,
    PreparedBoard,
    PreparedForce,
    PreparedStage,
)
from anhyst.study.tracking.simulate import OWN, check_calibration, find_gains
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError
from anhyst.support.jobs import all_of
from anhyst.support.kinds import NAMES, FileKind, refuse_other
from anhyst.support.progress import Progress, in_parts
from anhyst.support.toml_file import take_kind


def open_bench(
    rig_path: PathLike, controller_path: PathLike | None = None, progress: Progress | None = None
) -> BearingBench | ForceBench | StageBench:
    """Open the virtual bench of a rig."""
    with tempfile.TemporaryDirectory(prefix="anhyst-") as place:  # a firmware runs on without it
        parts = in_parts(progress, (2.0, 1.0))
        bench = prepare_bench(rig_path, controller_path, Path(place), next(parts)).open()
    next(parts)(1, 1)
    return bench


def open_board(folder: PathLike, url: str) -> HardwareBench:
    """Open the bench of a controller that runs by itself."""
    manifest = _manifest(folder)
    return HardwareBench(lambda: XcpMaster(url), manifest)


def address_of(xcp: str | None, port: str | None) -> str | None:
    """Return where a controller offers XCP, by TCP or on a serial port; None where neither is given."""
    if xcp is not None and port is not None:
        raise InputError(
            "--port: one controller at a time; leave it or --xcp out",
            code="options-together",
            key="--port",
        )
    return port if xcp is None else f"socket://{xcp}"


def through(folder: PathLike, url: str) -> Measuring:
    """Return what measures loops through a controller that runs by itself."""

    def measure(specimen: Specimen, progress: Progress | None) -> Excitation:
        with closing(open_board(folder, url)) as bench:
            return measure_on_board(specimen, bench, progress)

    return measure


def prepare_board(rig_path: PathLike, folder: PathLike) -> PreparedBoard:
    """Read what a better model for a controller that runs by itself is found with."""
    manifest = _manifest(folder)
    rig = read_rig(rig_path)
    if manifest["controller"] is not None or manifest["io"] not in ("q15", "q31"):
        raise InputError(
            f"{folder}: is no fixed-point controller of force; compile one",
            code="not-a-compiled-folder",
        )
    loops = loops_of_rig(rig)
    signals, limits = manifest["signals"], manifest["limits"]
    gap = signals["gap"] or {"low": 0.0, "high": 0.0}
    kind: Kind = "simplified" if manifest["kind"] == "simplified" else "full"
    return PreparedBoard(
        complete_rig(rig, loops),
        loops,
        _model_of(manifest, [Path(folder).resolve().parent, rig.path.resolve().parent]),
        CompileRequest(kind, manifest["io"], float(manifest["rate_Hz"])),
        Scales(signals["demand"]["scale"], signals["current"]["scale"], gap["low"], gap["high"]),
        DemandLimits(tuple(limits["demand"]), tuple(limits["current"])),
    )


def _manifest(folder: PathLike) -> dict[str, Any]:
    """Read the manifest of a compiled folder."""
    refuse_other(folder, [FileKind.COMPILED])
    place = Path(folder) / "manifest.json"
    try:
        manifest = json.loads(place.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        manifest = None
    if not isinstance(manifest, dict) or "signals" not in manifest:
        raise InputError(
            f"{place}: is not there or no manifest; name the folder that anhyst compile wrote and "
            "the firmware is built around",
            code="not-a-compiled-folder",
        )
    return manifest


def _model_of(manifest: Mapping[str, Any], folders: Sequence[Path]) -> Model:
    """Find the model file that a folder was compiled from, by its checksum."""
    wanted = manifest["model"]["sha256"]
    for place in (one for folder in folders for one in sorted(folder.glob("*.toml"))):
        if hashlib.sha256(place.read_bytes()).hexdigest() == wanted:
            return read_model(place)
    places = " or ".join(str(folder) for folder in folders)
    raise InputError(
        f"model '{manifest['model']['name']}': the file that the folder was compiled from is not in "
        f"{places}; put it there, unchanged",
        code="model-file-missing",
    )


def prepare_bench(
    rig_path: PathLike,
    controller_path: PathLike | None,
    place: Path,
    progress: Progress | None = None,
) -> Prepared:
    """Compile and build all that the virtual bench of a rig needs."""
    kind = kind_of_bench(rig_path)
    if kind is FileKind.BEARING:
        return _bearing(rig_path, controller_path, place, progress)
    if controller_path is not None:
        what = NAMES[kind][0]
        raise InputError(
            f"{controller_path}: {what} has no controller file", code="option-not-for-this"
        )
    if kind is FileKind.STAGE:
        return _stage(rig_path, progress)
    return _force(rig_path, place, progress)


def _bearing(
    rig_path: PathLike, controller_path: PathLike | None, place: Path, progress: Progress | None
) -> PreparedBearing:
    parts = in_parts(progress, (1.0, 1.0))
    rig, controller = read_files(rig_path, controller_path)
    ready = make_ready(rig, controller)
    next(parts)(1, 1)
    known = ready.knowledge()
    setup, firmware = build_firmware(ready.rig, controller, known, "library", place)
    next(parts)(1, 1)
    return PreparedBearing(setup, known.model, firmware)


def _force(rig_path: PathLike, place: Path, progress: Progress | None) -> PreparedForce:
    parts = in_parts(progress, (1.0, 1.0))
    rig = read_rig(rig_path)
    loops = loops_of_rig(rig)
    rig = complete_rig(rig, loops)
    next(parts)(1, 1)
    program = prepare(
        "full", find_model(rig, loops), rig.settings.timing.rate_Hz, "library", place / "full"
    )
    next(parts)(1, 1)
    return PreparedForce(rig, loops, program)


COMPARED: tuple[MethodName, MethodName] = ("single-valued", OWN)
"""Between what a stage is switched while it runs."""


def _stage(rig_path: PathLike, progress: Progress | None) -> PreparedStage:
    """Identify the magnets of a stage, and find the gains of both variants."""
    parts = in_parts(progress, (2.0, 1.0))
    rig = read_stage(rig_path)
    check_calibration(rig)
    magnet = identify_stage(rig)
    next(parts)(1, 1)
    setups = [make_stage(rig, magnet, method) for method in COMPARED]
    scan = rig.settings.scan
    training = motion_of(scan, scan.train_m_per_s2)
    gains = all_of(partial(find_gains, motion=training), setups, next(parts))
    variants = [StageVariant(*one) for one in zip(setups, gains, strict=True)]
    return PreparedStage(rig, magnet, tuple(variants))


def kind_of_bench(path: PathLike) -> FileKind:
    """Return what a rig file is of; no other kind has a virtual bench."""
    return take_kind(path, (FileKind.BEARING, FileKind.FORCE, FileKind.STAGE))
