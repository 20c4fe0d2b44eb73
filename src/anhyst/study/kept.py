"""Prepared benches, kept in the user's cache: files that were opened before open soon.

What is kept is found by a hash over all that goes into it: the contents of the files that a rig
names, where they lie, the sources and the binary that compute, the compiler. So it is never stale.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from anhyst.link.firmware import firmware_folder
from anhyst.rig.force.file import read_rig
from anhyst.rig.stage.file import read_stage
from anhyst.study.bearing.ready import read_files
from anhyst.study.bench import kind_of_bench, prepare_bench
from anhyst.study.prepared import Prepared
from anhyst.support.atomic import PathLike
from anhyst.support.folder import cache_folder, core_folder
from anhyst.support.kept import computed_with, forget, load, sealed
from anhyst.support.kinds import FileKind
from anhyst.support.progress import Progress

MOST = 20
"""Benches that are kept; those not opened for longest go."""
_FIRMWARE, _PICKLE = "firmware", "prepared.pickle"


@contextmanager
def prepared_once(
    rig_path: PathLike, controller_path: PathLike | None, progress: Progress | None = None
) -> Iterator[Prepared]:
    """Prepare a bench, or take what was prepared of the same files before."""
    place = cache_folder("benches") / _key(rig_path, controller_path)
    found = _load(place)
    if found is not None:
        yield found
        return
    with tempfile.TemporaryDirectory(prefix="anhyst-") as folder:
        prepared = prepare_bench(rig_path, controller_path, Path(folder), progress)
        with suppress(OSError):
            _keep(prepared, place)
        yield prepared


def _load(place: Path) -> Prepared | None:
    """Return what is kept at a place, if it is there, whole and one's own."""
    prepared: Prepared | None = load(place / _PICKLE)
    if prepared is not None:
        os.utime(place)
    return prepared and prepared.with_firmware(place / _FIRMWARE)


def _keep(prepared: Prepared, place: Path) -> None:
    """Put a bench into the cache, whole or not at all."""
    place.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".", dir=place.parent) as draft:
        folder = Path(draft) / "whole"
        folder.mkdir()
        if prepared.firmware is not None:
            shutil.copy2(prepared.firmware, folder / _FIRMWARE)
        (folder / _PICKLE).write_bytes(sealed(prepared))
        shutil.rmtree(place, ignore_errors=True)  # one that could not be read
        folder.rename(place)
    forget(place.parent, MOST)


def _key(rig_path: PathLike, controller_path: PathLike | None) -> str:
    """Return a name for all that goes into a bench."""
    digest = hashlib.sha256(computed_with())
    for path in [*_named(rig_path, controller_path), *_sources()]:
        digest.update(f"\0{path}\0{path.resolve()}\0".encode())
        with suppress(OSError):  # whoever reads it says what is wrong
            digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


def _named(rig_path: PathLike, controller_path: PathLike | None) -> list[Path]:
    """Return all files that a rig and a controller name."""
    kind = kind_of_bench(rig_path)
    if kind is FileKind.STAGE:
        stage = read_stage(rig_path)
        calibration = stage.settings.tracking.calibration
        own = [stage.path, None if calibration is None else stage.path.parent / calibration]
        files = stage.measured.files
    elif kind is FileKind.FORCE:
        force = read_rig(rig_path)
        named = force.settings.solenoid
        own = [force.path, None if named is None else force.path.parent / named.file]
        files = force.measured.files
    else:
        rig, controller = read_files(rig_path, controller_path)
        own = [rig.path, rig.model, rig.flux_table, controller.path, controller.model]
        own += [rig.calibration]
        files = rig.measured.files
    return [one for one in own if one is not None] + list(files)


def _sources() -> Iterator[Path]:
    """Return what firmware is made of: the C that is compiled, the compiler."""
    for name in ("cc", "gcc", "clang"):
        if found := shutil.which(name):
            yield Path(found)
    for folder in (core_folder(), firmware_folder()):
        for path in sorted(folder.rglob("*")):
            if path.is_file() and path.suffix in {".c", ".h", ".ld", ".toml"}:
                yield path
