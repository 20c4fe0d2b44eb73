"""Open the bench of a rig file: compile its controller, build the firmware, and switch it on.

Prepared benches are cached for each user under a hash of all inputs. These are the contents and
paths of the files that a rig names, the C sources, the compiled core and the compiler. Therefore, a
cached bench is never outdated.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any, Protocol

from anhyst.compensate.block import DemandLimits, Kind
from anhyst.compensate.plan import CompileRequest
from anhyst.model.actuator import Model, read_model
from anhyst.support.atomic import PathLike, cache_folder, core_folder
from anhyst.support.block_words import Scales
from anhyst.support.cache import code_digest, load_cached, pickle_with_digest, remove_oldest
from anhyst.support.errors import InputError
from anhyst.support.jobs import Progress, begin_step, map_ordered, split_progress
from anhyst.support.kinds import COMPILED_FOLDER, MethodName, require_capability, require_kind
from anhyst.support.toml_file import require_rig
from anhyst_rigs.link.firmware import firmware_folder
from anhyst_rigs.link.xcp import XcpMaster
from anhyst_rigs.rig.bench.bearing import BearingBench
from anhyst_rigs.rig.bench.force import ForceBench
from anhyst_rigs.rig.bench.hardware import HardwareBench
from anhyst_rigs.rig.bench.piezo import PiezoBench
from anhyst_rigs.rig.bench.stage import StageBench
from anhyst_rigs.rig.force.file import read_rig
from anhyst_rigs.rig.force.programs import identify_force_model, read_rig_loops
from anhyst_rigs.rig.from_loops import complete_rig
from anhyst_rigs.rig.piezo import read_piezo_rig
from anhyst_rigs.rig.stage.file import read_stage
from anhyst_rigs.rig.stage.fitted import identify_stage_magnet, make_stage
from anhyst_rigs.rig.stage.setpoint import scan_motion
from anhyst_rigs.study.bearing.inputs import check_inputs, read_files
from anhyst_rigs.study.bearing.on_board import build_firmware
from anhyst_rigs.study.excite.design import Specimen
from anhyst_rigs.study.excite.excite import Excitation, MeasureFunction
from anhyst_rigs.study.excite.on_board import measure_on_board
from anhyst_rigs.study.force_control import build_program
from anhyst_rigs.study.piezo import find_inverses
from anhyst_rigs.study.prepared_benches import (
    Prepared,
    PreparedBearing,
    PreparedBoard,
    PreparedForce,
    PreparedPiezo,
    PreparedStage,
)
from anhyst_rigs.study.tracking.gains import find_gains
from anhyst_rigs.study.tracking.simulate import COMPENSATOR, check_calibration


def open_bench(
    rig_path: PathLike, controller_path: PathLike | None = None, progress: Progress | None = None
) -> BearingBench | ForceBench | StageBench | PiezoBench:
    """Open the virtual bench of a rig."""
    # needed only until the bench is open
    with tempfile.TemporaryDirectory(prefix="anhyst-") as folder:
        part_progress = split_progress(progress, (2.0, 1.0))
        bench = prepare_bench(rig_path, controller_path, Path(folder), next(part_progress)).open()
    next(part_progress)(1, 1)
    return bench


def open_board(folder: PathLike, url: str) -> HardwareBench:
    """Open the bench of a stand-alone controller."""
    manifest = _read_manifest(folder)
    return HardwareBench(lambda: XcpMaster(url), manifest)


def measure_through_board(folder: PathLike, url: str) -> MeasureFunction:
    """Return a function that measures loops with a stand-alone controller."""

    def measure(specimen: Specimen, progress: Progress | None) -> Excitation:
        with closing(open_board(folder, url)) as bench:
            return measure_on_board(specimen, bench, progress)

    return measure


def prepare_board(rig_path: PathLike, folder: PathLike) -> PreparedBoard:
    """Read the data that are needed to improve the model of a stand-alone controller."""
    manifest = _read_manifest(folder)
    rig = read_rig(rig_path)
    if manifest["controller"] is not None or manifest["io"] not in ("q15", "q31"):
        raise InputError(
            f"{folder}: is not a fixed-point controller of force; compile one", code="not-a-compiled-folder"
        )
    loops = read_rig_loops(rig)
    signals, limits = manifest["signals"], manifest["limits"]
    gap_signal = signals["gap"] or {"low": 0.0, "high": 0.0}
    law_kind: Kind = "simplified" if manifest["kind"] == "simplified" else "full"
    return PreparedBoard(
        complete_rig(rig, loops),
        loops,
        _find_model_file(manifest, [Path(folder).resolve().parent, rig.path.resolve().parent]),
        CompileRequest(law_kind, manifest["io"], float(manifest["rate_Hz"])),
        Scales(
            signals["demand"]["scale"], signals["current"]["scale"], gap_signal["low"], gap_signal["high"]
        ),
        DemandLimits(tuple(limits["demand"]), tuple(limits["current"])),
    )


def _read_manifest(folder: PathLike) -> dict[str, Any]:
    """Read the manifest of a compiled folder."""
    require_kind(folder, [COMPILED_FOLDER])
    path = Path(folder) / "manifest.json"
    try:
        manifest = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        manifest = None
    if not isinstance(manifest, dict) or "signals" not in manifest:
        raise InputError(
            f"{path}: is missing or not a manifest; enter the folder that anhyst compile wrote for "
            "the firmware",
            code="not-a-compiled-folder",
        )
    return manifest


def _find_model_file(manifest: Mapping[str, Any], folders: Sequence[Path]) -> Model:
    """Find the model file of a compiled folder by its checksum."""
    digest = manifest["model"]["sha256"]
    for path in (file for folder in folders for file in sorted(folder.glob("*.toml"))):
        if hashlib.sha256(path.read_bytes()).hexdigest() == digest:
            return read_model(path)
    folder_names = " or ".join(str(folder) for folder in folders)
    raise InputError(
        f"model '{manifest['model']['name']}': the file that the folder was compiled from is not in "
        f"{folder_names}; put it there, unchanged",
        code="model-file-missing",
    )


class HasBench(Protocol):
    """A kind of rig that has a virtual bench."""

    def prepare(
        self, rig: PathLike, controller: PathLike | None, folder: Path, progress: Progress | None
    ) -> Prepared:
        """Compile and build all that the bench needs, with the firmware in a folder."""

    def files(self, rig: PathLike, controller: PathLike | None) -> list[Path]:
        """Return the rig file, and all files that it and a controller file name."""


def prepare_bench(
    rig: PathLike, controller: PathLike | None, folder: Path, progress: Progress | None = None
) -> Prepared:
    """Compile and build all that the virtual bench of a rig needs."""
    return _bench_kind(rig, controller).prepare(rig, controller, folder, progress)


def _bench_kind(rig: PathLike, controller: PathLike | None) -> HasBench:
    """Return the kind of a rig; raise an error if it cannot use the given controller file."""
    kind = require_rig(rig, "live")
    kind.refuse_options("live", {"--controller": controller})
    return require_capability(kind, HasBench)


def prepare_bearing(
    rig_path: PathLike, controller_path: PathLike | None, folder: Path, progress: Progress | None
) -> PreparedBearing:
    """Identify the magnet of a bearing, and build the firmware of its controller."""
    part_progress = split_progress(progress, (1.0, 9.0, 4.0))
    begin_step("read the rig, the controller and the loops")
    rig, controller = read_files(rig_path, controller_path)
    inputs = check_inputs(rig, controller)
    next(part_progress)(1, 1)
    begin_step("identify the magnet" if inputs.model is None else "read the model of the magnet")
    knowledge = inputs.identify_magnet()
    next(part_progress)(1, 1)
    setup, firmware = build_firmware(inputs.rig, controller, knowledge, "library", folder)
    next(part_progress)(1, 1)
    return PreparedBearing(setup, knowledge.model, firmware)


def prepare_force(
    rig_path: PathLike, controller_path: PathLike | None, folder: Path, progress: Progress | None
) -> PreparedForce:
    """Identify the actuator of a rig, and build the firmware that controls its force."""
    part_progress = split_progress(progress, (1.0, 9.0, 4.0))
    begin_step("read the rig and the loops")
    rig = read_rig(rig_path)
    loops = read_rig_loops(rig)
    rig = complete_rig(rig, loops)
    next(part_progress)(1, 1)
    begin_step("identify the actuator")
    model = identify_force_model(rig, loops, next(part_progress))
    program = build_program("full", model, rig.settings.timing.rate_Hz, "library", folder / "full")
    next(part_progress)(1, 1)
    return PreparedForce(rig, loops, program)


SWITCHED_METHODS: tuple[MethodName, MethodName] = ("single-valued", COMPENSATOR)
"""The two methods between which a running stage can be switched."""


def prepare_stage(
    rig_path: PathLike, controller_path: PathLike | None, folder: Path, progress: Progress | None
) -> PreparedStage:
    """Identify the magnets of a stage, and find the feedforward gains of both methods."""
    part_progress = split_progress(progress, (2.0, 1.0))
    begin_step("read the rig")
    rig = read_stage(rig_path)
    check_calibration(rig)
    begin_step("identify the magnets")
    magnet = identify_stage_magnet(rig)
    next(part_progress)(1, 1)
    begin_step("find the feedforward gains")
    setups = [make_stage(rig, magnet, method) for method in SWITCHED_METHODS]
    scan = rig.settings.scan
    training = scan_motion(scan, scan.train_m_per_s2)
    gains = map_ordered(partial(find_gains, motion=training), setups, next(part_progress))
    return PreparedStage(magnet, tuple(setups), tuple(gains))


def prepare_piezo(
    rig_path: PathLike, controller_path: PathLike | None, folder: Path, progress: Progress | None
) -> PreparedPiezo:
    """Identify two inverses of a piezo stage: single-valued and with hysteresis."""
    begin_step("read the rig")
    rig = read_piezo_rig(rig_path)
    begin_step("identify the inverses")
    inverses = find_inverses(rig)
    return PreparedPiezo(rig, (inverses["single-valued"], inverses["full"]))


MAX_CACHED_BENCHES = 20
"""Maximum number of cached benches; those that were not opened for the longest time are removed."""
_FIRMWARE_FILE = "firmware"
_PICKLE_FILE = "prepared.pickle"


@contextmanager
def prepare_cached(
    rig_path: PathLike, controller_path: PathLike | None, progress: Progress | None = None
) -> Iterator[Prepared]:
    """Prepare a bench, or load it from the cache if the same files were prepared before."""
    begin_step("search the cache of prepared rigs")
    bench_kind = _bench_kind(rig_path, controller_path)
    # The hash does not cover the code of other packages.
    is_cacheable = bench_kind.prepare.__module__.startswith("anhyst_rigs.")
    cache_entry = cache_folder("benches") / _cache_key(bench_kind.files(rig_path, controller_path))
    prepared_before = _load_cached(cache_entry) if is_cacheable else None
    if prepared_before is not None:
        yield prepared_before
        return
    with tempfile.TemporaryDirectory(prefix="anhyst-") as folder:
        prepared = prepare_bench(rig_path, controller_path, Path(folder), progress)
        if is_cacheable:
            with suppress(OSError):
                _store_prepared(prepared, cache_entry)
        yield prepared


def _load_cached(folder: Path) -> Prepared | None:
    """Return the cached bench of a folder, or None if it is missing, damaged or of another user."""
    prepared: Prepared | None = load_cached(folder / _PICKLE_FILE)
    if prepared is None:
        return None
    os.utime(folder)
    return prepared.with_firmware(folder / _FIRMWARE_FILE) if prepared.firmware else prepared


def _store_prepared(prepared: Prepared, cache_entry: Path) -> None:
    """Write a bench into the cache, either completely or not at all."""
    cache_entry.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".", dir=cache_entry.parent) as draft_folder:
        folder = Path(draft_folder) / "whole"
        folder.mkdir()
        if prepared.firmware is not None:
            shutil.copy2(prepared.firmware, folder / _FIRMWARE_FILE)
        (folder / _PICKLE_FILE).write_bytes(pickle_with_digest(prepared))
        shutil.rmtree(cache_entry, ignore_errors=True)  # removes an unreadable entry
        folder.rename(cache_entry)
    remove_oldest(cache_entry.parent, MAX_CACHED_BENCHES)


def _cache_key(files: Sequence[Path]) -> str:
    """Return the hash of all inputs of a bench."""
    digest = hashlib.sha256(code_digest())
    for path in [*files, *_source_files()]:
        digest.update(f"\0{path}\0{path.resolve()}\0".encode())
        with suppress(OSError):  # The reader reports the errors.
            digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


def _source_files() -> Iterator[Path]:
    """Yield the compilers and the C sources of a firmware."""
    for name in ("cc", "gcc", "clang"):
        if compiler := shutil.which(name):
            yield Path(compiler)
    for folder in (core_folder(), firmware_folder()):
        for path in sorted(folder.rglob("*")):
            if path.is_file() and path.suffix in {".c", ".h", ".ld", ".toml"}:
                yield path
