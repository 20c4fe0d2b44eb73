"""A compensator as an FMU: the C that ``anhyst compile`` writes, behind the standard's functions."""

from __future__ import annotations

import hashlib
import json
import subprocess
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from anhyst.compilation.verb import compile_actuator
from anhyst.exchange.description import (
    MODEL,
    Described,
    FmiVersion,
    Variable,
    build_description,
    model_description,
)
from anhyst.model.actuator import Model
from anhyst.support.atomic import PathLike, check_writable, write_bytes
from anhyst.support.errors import InputError
from anhyst.support.progress import Progress
from anhyst.support.version import running_version
from anhyst.verification.toolchain import zig_cc

WRAPPER = Path(__file__).with_name("fmu")
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


def export_fmu(
    model: Model | PathLike,
    out: PathLike,
    *,
    rate: float,
    kind: Literal["full", "simplified"] = "full",
    fmi: FmiVersion = "2.0",
    platforms: Sequence[str] = PLATFORMS_ALL,
    progress: Progress | None = None,
) -> Path:
    """Write a compensator as an FMU for co-simulation: demand and gap in, current out.

    It computes at its own rate what the compiled fixed-point C computes on a controller, bit for
    bit; between ticks inputs and outputs are held. States can be read, set and serialised.

    Parameters
    ----------
    model : Model or path-like
        The model, or its file.
    out : path-like
        The file, ``.fmu``; with sources, and binaries for Linux, Windows and macOS.
    rate : float
        Ticks a second.
    kind : str
        ``"full"`` or ``"simplified"``.
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
        The model cannot be compiled, the file cannot be written, or ziglang (extra ``verify``) is
        not installed.
    """
    path = Path(out)
    if path.suffix != ".fmu":
        raise InputError(f"{path}: an FMU is written as .fmu; name it so")
    for name in platforms:
        if name not in PLATFORMS:
            raise InputError(f"platform '{name}' is unknown; use one of {', '.join(PLATFORMS)}")
    check_writable(path)
    compiler = zig_cc("fmu")
    with tempfile.TemporaryDirectory(prefix="anhyst-fmu-") as scratch:
        folder = Path(scratch) / "controller"
        compiled = compile_actuator(model, folder, rate=rate, kind=kind, io="q31")
        manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
        sources = _sources(folder, manifest, fmi)
        token = hashlib.sha256(b"".join(sources[name] for name in sorted(sources))).hexdigest()[:32]
        sources["actuator.h"] = _actuator_header(manifest, token).encode()
        c_files = sorted(name for name in sources if name.endswith(".c"))
        about = Described(
            manifest["name"],
            f"Current of a demanded {manifest['signals']['demand']['quantity']}, hysteresis "
            f"included: compensator {compiled.manifest['kind']} in fixed point",
            f"anhyst {running_version()}",
            token,
            rate,
            c_files,
        )
        files = {"modelDescription.xml": model_description(fmi, about, _variables(manifest))}
        if fmi == "3.0":
            files["sources/buildDescription.xml"] = build_description(c_files)
        files |= {f"sources/{name}": text for name, text in sources.items()}
        files |= _binaries(compiler, Path(scratch), sources, fmi, platforms, progress)
    _write(path, files)
    return path


def _sources(folder: Path, manifest: Mapping[str, Any], fmi: FmiVersion) -> dict[str, bytes]:
    """Return what is compiled, by its path below ``sources/``."""
    name = manifest["name"]
    own = [path for place in ("include", "src") for path in (folder / place).rglob("*.[ch]")]
    own += [folder / f"{name}_parameters.c", folder / f"{name}_parameters.h"]
    found = {path.relative_to(folder).as_posix(): path.read_bytes() for path in own}
    wrapper = [
        "component.h",
        "component.c",
        *(path.name for path in WRAPPER.glob(f"fmi{fmi[0]}*.c")),
    ]
    headers = [f"fmi/{path.name}" for path in (WRAPPER / "fmi").glob(f"fmi{fmi[0]}*.h")]
    return found | {name: (WRAPPER / name).read_bytes() for name in (*wrapper, *headers)}


def _actuator_header(manifest: Mapping[str, Any], token: str) -> str:
    """Return the header that gives the wrapper the names of this actuator."""
    name, signals = manifest["name"], manifest["signals"]
    gap = signals.get("gap") or {"low": 0.0, "high": 0.0}
    lines = {
        "KERNEL": f"{name.upper()}_KERNEL",
        "WORDS": f"{name.upper()}_PARAMETERS_WORDS",
        "RATE": f"{float(manifest['rate_Hz'])!r}",
        "FULL_SCALE_DEMAND": f"{float(signals['demand']['scale'])!r}",
        "FULL_SCALE_CURRENT": f"{float(signals['current']['scale'])!r}",
        "GAP_LOW": f"{float(gap['low'])!r}",
        "GAP_HIGH": f"{float(gap['high'])!r}",
        "TOKEN": f'"{token}"',
    }
    defined = "".join(f"#define ACTUATOR_{key} {value}\n" for key, value in lines.items())
    return (
        f"/* The actuator '{name}' under the names that the FMU uses; generated. */\n"
        f'#ifndef ACTUATOR_H\n#define ACTUATOR_H\n\n#include "{name}_parameters.h"\n\n{defined}'
        f"#define actuator_parameters {name}_parameters\n\n#endif\n"
    )


def _variables(manifest: Mapping[str, Any]) -> list[Variable]:
    signals = manifest["signals"]
    demand, current, gap = (signals.get(name) for name in ("demand", "current", "gap"))
    found = [
        Variable(
            *("demand", 1, "input", demand["unit"], demand["low"], demand["high"]),
            *(max(0.0, demand["low"]), f"wanted {demand['quantity']}"),
        )
    ]
    if gap:
        text = f"{gap['quantity']}; beyond its range the nearer end counts"
        ends = gap["low"], gap["high"]
        found.append(Variable("gap", 2, "input", gap["unit"], *ends, gap["low"], text))
    text = f"{current['quantity']} that gives it, from the last tick on"
    ends = current["low"], current["high"]
    found.append(Variable("current", 3, "output", current["unit"], *ends, 0.0, text))
    return found


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
        options = ["-std=c99", "-O2", "-shared", "-fPIC", "-I.", "-Iinclude", "-s"]
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
