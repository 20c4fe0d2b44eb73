"""A model as an FMU: its compensator or the actuator, behind the functions of the standard."""

from __future__ import annotations

import subprocess
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from anhyst.exchange.actuator_part import actuator_part
from anhyst.exchange.bearing_part import bearing_part
from anhyst.exchange.compensator_part import Kind, compensator_part
from anhyst.exchange.description import MODEL, FmiVersion, build_description, model_description
from anhyst.exchange.part import WRAPPER, Part
from anhyst.model.actuator import Model
from anhyst.model.file import read_model
from anhyst.support.atomic import PathLike, check_writable, write_bytes
from anhyst.support.errors import InputError
from anhyst.support.progress import Progress
from anhyst.support.toml_file import format_of
from anhyst.verification.toolchain import zig_cc

Of = Literal["compensator", "actuator"]
BEARING = "anhyst-bearing"
"""Format of a rig file."""

_BEGIN_OF_TIME = (1980, 1, 1, 0, 0, 0)  # the same model gives the same file


@dataclass(frozen=True)
class Platform:
    """Where a binary runs: zig's target, the folder in FMI 2.0, the ending."""

    target: str
    second: str
    ending: str


PLATFORMS = {
    "x86_64-linux": Platform("x86_64-linux-gnu.2.17", "linux64", ".so"),
    "aarch64-linux": Platform("aarch64-linux-gnu.2.17", "aarch64-linux", ".so"),
    "x86_64-windows": Platform("x86_64-windows-gnu", "win64", ".dll"),
    "x86_64-darwin": Platform("x86_64-macos", "darwin64", ".dylib"),
    "aarch64-darwin": Platform("aarch64-macos", "aarch64-darwin", ".dylib"),
}
"""By the names of FMI 3.0."""
PLATFORMS_ALL = tuple(PLATFORMS)

SAME_BITS = ("-ffp-contract=off",)
"""No product fused into a sum, as the core is compiled for Python."""


def export_fmu(
    model: Model | PathLike,
    out: PathLike,
    *,
    of: Of | None = None,
    rate: float | None = None,
    kind: Kind | None = None,
    fmi: FmiVersion = "2.0",
    platforms: Sequence[str] = PLATFORMS_ALL,
    progress: Progress | None = None,
) -> Path:
    """Write an FMU for co-simulation: a model's compensator, the actuator itself, or a bearing.

    A compensator (demand and gap in, current out) computes at its own rate what the compiled
    fixed-point C computes on a controller, bit for bit; between ticks inputs and outputs are held.
    An actuator (current and gap in, force out) takes each step of the tool as one sample, as the
    model's stepper does. A bearing (wanted gap and load in; gap, force and currents out) is plant
    and controller of ``anhyst simulate``. States can be read, set and serialised.

    Parameters
    ----------
    model : Model or path-like
        The model, its file, or the rig file of a bearing.
    out : path-like
        The file, ``.fmu``; with sources, and binaries for Linux, Windows and macOS.
    of : str, optional
        Of a model: ``"compensator"`` (if left out) or ``"actuator"``.
    rate : float, optional
        Ticks a second of a compensator.
    kind : str, optional
        Of a compensator, ``"full"`` (if left out) or ``"simplified"``.
    fmi : str
        Version of the standard, ``"2.0"`` or ``"3.0"``.
    platforms : sequence of str
        Of :data:`PLATFORMS`; each costs a second, or a minute when it is built for the first time.
    progress : callable, optional
        Called with what is done and what there is in all.

    Returns
    -------
    Path
        The file, written whole or not at all.

    Raises
    ------
    InputError
        The model cannot be compiled or run alone, a rate is missing or of no use, the file cannot
        be written, or ziglang (extra ``verify``) is not installed.
    """
    path = Path(out)
    if path.suffix != ".fmu":
        raise InputError(f"{path}: an FMU is written as .fmu; name it so", code="wrong-ending")
    for name in platforms:
        if name not in PLATFORMS:
            raise InputError(
                f"platform '{name}' is unknown; use one of {', '.join(PLATFORMS)}",
                code="unknown-platform",
                key="platforms",
            )
    check_writable(path)
    compiler = zig_cc("fmu")
    part = part_of(model, of, rate, kind)
    number = fmi[0]
    wrapper = [place.name for place in WRAPPER.glob(f"fmi{number}*.c")]
    wrapper += [f"fmi/{place.name}" for place in (WRAPPER / "fmi").glob(f"fmi{number}*.h")]
    token, sources = part.complete(wrapper)
    c_files = [name for name in sources if name.endswith(".c")]
    files = {"modelDescription.xml": model_description(fmi, part, token, c_files)}
    if fmi == "3.0":
        files["sources/buildDescription.xml"] = build_description(c_files)
    files |= {f"sources/{name}": text for name, text in sources.items()}
    with tempfile.TemporaryDirectory(prefix="anhyst-fmu-") as scratch:
        files |= _binaries(compiler, Path(scratch), sources, fmi, platforms, progress)
    _write(path, files)
    return path


def part_of(model: Model | PathLike, of: Of | None, rate: float | None, kind: Kind | None) -> Part:
    """Return the part of a model that is asked for.

    Raises
    ------
    InputError
        As :func:`export_fmu`.
    """
    if not isinstance(model, Model) and format_of(model) == BEARING:
        for name, given in (("--of", of), ("--rate", rate), ("--kind", kind)):
            if given is not None:
                raise InputError(
                    f"{name}: is of a model; the files of a bearing say it, leave it out",
                    code="option-not-for-this",
                    key=name,
                )
        return bearing_part(model)
    if of == "actuator":
        for name, given in (("--rate", rate), ("--kind", kind)):
            if given is not None:
                raise InputError(
                    f"{name}: is of a compensator; an actuator answers at each step of the tool, "
                    "leave it out",
                    code="option-not-for-this",
                    key=name,
                )
        return actuator_part(model if isinstance(model, Model) else read_model(model))
    if rate is None:
        raise InputError(
            "--rate: is missing; give the ticks a second of the compensator",
            code="missing",
            key="--rate",
        )
    return compensator_part(model, rate, kind or "full")


def _binaries(
    compiler: Sequence[str],
    scratch: Path,
    sources: Mapping[str, bytes],
    fmi: FmiVersion,
    platforms: Sequence[str],
    progress: Progress | None,
) -> dict[str, bytes]:
    """Compile for every platform."""
    place = scratch / "sources"
    for name, text in sources.items():
        (place / name).parent.mkdir(parents=True, exist_ok=True)
        (place / name).write_bytes(text)
    c_files = sorted(name for name in sources if name.endswith(".c"))
    found = {}
    for done_already, third in enumerate(platforms, start=1):
        if progress is not None:
            progress(done_already, len(platforms) + 1)
        one = PLATFORMS[third]
        binary = scratch / f"{MODEL}{one.ending}"
        options = ["-std=c99", "-O2", *SAME_BITS, "-shared", "-fPIC", "-I.", "-Iinclude", "-s"]
        if one.ending == ".so":  # elsewhere nothing is left open anyway
            options.append("-Wl,-z,defs")
        command = [*compiler, "-target", one.target, *options, "-o", str(binary), *c_files, "-lm"]
        done = subprocess.run(command, cwd=place, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise RuntimeError(f"{one.target}: {done.stderr.strip()[-500:]}")
        folder = one.second if fmi == "2.0" else third
        found[f"binaries/{folder}/{MODEL}{one.ending}"] = binary.read_bytes()
    return found


def _write(path: Path, files: Mapping[str, bytes]) -> None:
    with tempfile.TemporaryFile() as whole:
        with zipfile.ZipFile(whole, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, content in files.items():
                archive.writestr(zipfile.ZipInfo(name, _BEGIN_OF_TIME), content)
        whole.seek(0)
        write_bytes(path, whole.read())
