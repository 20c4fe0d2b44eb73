"""Export a model or a rig file as FMU, S-function or tables.

A component is a set of C sources with inputs and outputs (:mod:`anhyst_exchange.part`). The
exporter adds the wrapper of the standard, and compiles it for all platforms with zig.
"""

from __future__ import annotations

import importlib.util
import subprocess
import tempfile
import zipfile
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from anhyst.compilation.toolchain import zig_cc
from anhyst.data.formats.text import write_csv
from anhyst.model.actuator import MODEL_SOURCES, Model, resolve_model
from anhyst.support import running_version
from anhyst.support.atomic import (
    PathLike,
    atomic_folder,
    atomic_writer,
    check_path,
    check_writable,
    json_text,
    write_bytes,
    write_files,
)
from anhyst.support.cache import c_name
from anhyst.support.errors import InputError
from anhyst.support.jobs import Progress, core_count
from anhyst.support.kinds import MODEL_FILE, accepted_kinds
from anhyst.support.registry import Registry
from anhyst.support.toml_file import require_rig, require_toml_kind
from anhyst_exchange.part import (
    MODEL_IDENTIFIER,
    WRAPPER_FOLDER,
    FmiVersion,
    Kind,
    Part,
    actuator_part,
    build_description,
    compensator_part,
    model_description,
)


@dataclass(frozen=True)
class Platform:
    """Compiler target, folder name in FMI 2.0, file suffix and link options of a platform."""

    target: str
    fmi2_folder: str
    suffix: str
    link_options: tuple[str, ...]


# By default, zig first compiles the start-up code of Windows and a run-time library for each
# processor, which takes over a minute. An FMU does not need this code: C functions come from the
# library of the system, and a library without constructors needs no entry point.
_LINUX_LINK_OPTIONS = ("-Wl,-z,defs", "-lc", "-lm")
_MACOS_LINK_OPTIONS = ("-lc",)
_WINDOWS_LINK_OPTIONS = (
    "-Wl,--no-entry",
    *(f"-lapi-ms-win-crt-{part}-l1-1-0" for part in ("heap", "math", "private", "string")),
)

PLATFORMS = {
    "x86_64-linux": Platform("x86_64-linux-gnu.2.17", "linux64", ".so", _LINUX_LINK_OPTIONS),
    "aarch64-linux": Platform("aarch64-linux-gnu.2.17", "aarch64-linux", ".so", _LINUX_LINK_OPTIONS),
    "x86_64-windows": Platform("x86_64-windows-gnu", "win64", ".dll", _WINDOWS_LINK_OPTIONS),
    "x86_64-darwin": Platform("x86_64-macos", "darwin64", ".dylib", _MACOS_LINK_OPTIONS),
    "aarch64-darwin": Platform("aarch64-macos", "aarch64-darwin", ".dylib", _MACOS_LINK_OPTIONS),
}
"""Platforms by their names in FMI 3.0."""
PLATFORM_NAMES = tuple(PLATFORMS)

REPRODUCIBLE_OPTIONS = ("-ffp-contract=off",)
"""Options that forbid fused multiply-add, so that the bits equal the bits of the core in Python."""


def compile_all(
    sources: Path, name: str, platforms: Sequence[str], progress: Progress | None
) -> dict[str, bytes]:
    """Compile all C files of a folder to a library for each platform; return the libraries."""
    compiler = zig_cc("fmu")
    files = sorted(path.relative_to(sources).as_posix() for path in sources.rglob("*.c"))

    def compile_one(platform: str) -> bytes:
        target = PLATFORMS[platform]
        binary_path = sources.with_name(f"{platform}-{name}") / f"{name}{target.suffix}"
        binary_path.parent.mkdir()
        options = ["-target", target.target, "-std=c99", "-O2", *REPRODUCIBLE_OPTIONS, "-I.", "-Iinclude"]
        if (
            target.link_options is _WINDOWS_LINK_OPTIONS
        ):  # without the start-up code, zig does not find its headers
            options += ["-isystem", str(_windows_headers())]
        options += ["-shared", "-fPIC", "-s", "-nostdlib", "-o", str(binary_path)]
        command = [*compiler, *options, *files, *target.link_options]
        compiler_run = subprocess.run(command, cwd=sources, capture_output=True, text=True, check=False)
        if compiler_run.returncode != 0:
            raise RuntimeError(f"{target.target}: {compiler_run.stderr.strip()[-500:]}")
        return binary_path.read_bytes()

    binaries = {}
    with ThreadPoolExecutor(core_count()) as thread_pool:
        platform_by_future: dict[Future[bytes], str] = {
            thread_pool.submit(compile_one, platform): platform for platform in platforms
        }
        for count, finished_future in enumerate(as_completed(platform_by_future), start=1):
            binaries[platform_by_future[finished_future]] = finished_future.result()
            if progress is not None:
                progress(count, len(platforms))
    return {platform: binaries[platform] for platform in platforms}


def _windows_headers() -> Path:
    """Return the folder of zig with the C headers of Windows."""
    spec = importlib.util.find_spec("ziglang")
    assert spec is not None
    assert spec.origin is not None
    return Path(spec.origin).parent / "lib" / "libc" / "include" / "any-windows-any"


ExportedPart = Literal["compensator", "actuator"]
_FIXED_ZIP_DATE = (1980, 1, 1, 0, 0, 0)  # fixed, so that the same model gives the same file


def export_fmu(
    model: Model | PathLike,
    out: PathLike,
    *,
    of: ExportedPart | None = None,
    rate: float | None = None,
    kind: Kind | None = None,
    fmi: FmiVersion = "2.0",
    platforms: Sequence[str] = PLATFORM_NAMES,
    progress: Progress | None = None,
) -> Path:
    """Write an FMU for co-simulation: the compensator or the actuator of a model, or a rig.

    A compensator (inputs: demand and gap; output: current) runs at its own rate. Its bits equal the
    bits of the compiled fixed-point C on a controller. Inputs and outputs are held between ticks.
    An actuator (inputs: current and gap; output: force) takes each step of the tool as one sample,
    as the stepper of the model does. A bearing (inputs: demanded gap and load; outputs: gap, force
    and currents), a stage (inputs: set-point and feedforward) and a piezo stage (input: demanded
    displacement) contain the plant and the controller of ``anhyst simulate``. A rig for force
    control (inputs: demand and gap; outputs: current and force) contains the plant and the
    controller of ``anhyst force-control``. States can be read, set and serialised.
    """
    path = Path(out)
    if path.suffix != ".fmu":
        raise InputError(f"{path}: the name of an FMU must end in .fmu; rename it", code="wrong-ending")
    for name in platforms:
        if name not in PLATFORMS:
            raise InputError(
                f"platform '{name}' is unknown; use one of {', '.join(PLATFORMS)}",
                code="unknown-platform",
                key="platforms",
            )
    check_writable(path)
    zig_cc("fmu")  # check for the compiler first
    part = part_of(model, of, rate, kind)
    major_version = fmi[0]
    wrapper = [path.name for path in WRAPPER_FOLDER.glob(f"fmi{major_version}*.c")]
    wrapper += [f"fmi/{path.name}" for path in (WRAPPER_FOLDER / "fmi").glob(f"fmi{major_version}*.h")]
    token, sources = part.add_wrapper(wrapper)
    c_files = [name for name in sources if name.endswith(".c")]
    files = {"modelDescription.xml": model_description(fmi, part, token, c_files)}
    if fmi == "3.0":
        files["sources/buildDescription.xml"] = build_description(c_files)
    files |= {f"sources/{name}": text for name, text in sources.items()}
    files |= _compile_binaries(sources, fmi, platforms, progress)
    with tempfile.TemporaryFile() as archive_file:
        with zipfile.ZipFile(archive_file, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, content in files.items():
                archive.writestr(zipfile.ZipInfo(name, _FIXED_ZIP_DATE), content)
        archive_file.seek(0)
        write_bytes(path, archive_file.read())
    return path


RIG_PART_FACTORIES: Registry[Callable[[PathLike], Part]] = Registry(
    "anhyst.exports", {}, lambda factory, _: "" if callable(factory) else "and it is not a function"
)
"""Functions that return the component of a rig file, by the word of the kind of rig.

They are the entry points ``anhyst.exports`` of installed packages.
"""


def rig_part(path: PathLike) -> Part:
    """Return the component of a rig file: plant and controller as C, with inputs and outputs."""
    kind_name = require_rig(path, "export").word
    if part := RIG_PART_FACTORIES.get(kind_name):
        return part(path)
    reason = RIG_PART_FACTORIES.explain_unusable(kind_name) or "ask the author of the package that adds it"
    raise InputError(
        f"{path}: control.kind: '{kind_name}' has no part for export; {reason}",
        code="not-installed",
        key="control.kind",
    )


def part_of(model: Model | PathLike, of: ExportedPart | None, rate: float | None, kind: Kind | None) -> Part:
    """Return the requested component of a model or a rig file."""
    if not isinstance(model, Model):
        check_path(model, "export: model", f"{MODEL_SOURCES} or of a rig file")
    if not isinstance(model, Model) and require_toml_kind(model, accepted_kinds("export")) is not MODEL_FILE:
        for name, value in (("--of", of), ("--rate", rate), ("--kind", kind)):
            if value is not None:
                raise InputError(
                    f"{name}: is for a model; the rig file states it, leave it out",
                    code="option-not-for-this",
                    key=name,
                )
        return rig_part(model)
    if of == "actuator":
        for name, value in (("--rate", rate), ("--kind", kind)):
            if value is not None:
                raise InputError(
                    f"{name}: is for a compensator; an actuator has one sample per step of the tool, "
                    "leave it out",
                    code="option-not-for-this",
                    key=name,
                )
        return actuator_part(resolve_model(model, "export"))
    if rate is None:
        raise InputError(
            "--rate: is missing; give the ticks per second of the compensator", code="missing", key="--rate"
        )
    return compensator_part(model, rate, kind or "full")


def _compile_binaries(
    sources: Mapping[str, bytes], fmi: FmiVersion, platforms: Sequence[str], progress: Progress | None
) -> dict[str, bytes]:
    """Compile the sources for each platform; return the binaries by their paths in the FMU."""
    with tempfile.TemporaryDirectory(prefix="anhyst-fmu-") as temporary_folder:
        source_folder = Path(temporary_folder) / "sources"
        for name, text in sources.items():
            (source_folder / name).parent.mkdir(parents=True, exist_ok=True)
            (source_folder / name).write_bytes(text)
        binary_by_platform = compile_all(source_folder, MODEL_IDENTIFIER, platforms, progress)
    binaries = {}
    for platform, content in binary_by_platform.items():
        target = PLATFORMS[platform]
        folder = target.fmi2_folder if fmi == "2.0" else platform
        binaries[f"binaries/{folder}/{MODEL_IDENTIFIER}{target.suffix}"] = content
    return binaries


def export_sfunction(
    model: Model | PathLike,
    out: PathLike,
    *,
    of: ExportedPart | None = None,
    rate: float | None = None,
    kind: Kind | None = None,
) -> Path:
    """Write a level-2 C S-function: its sources, and the MATLAB function that builds it.

    The component is the same as in an FMU of :func:`~anhyst_exchange.exporter.export_fmu`.
    Outputs that follow from the inputs of a sample appear at the next sample. The parameter of
    the block of an actuator is the sample time in s.
    """
    folder = Path(out)
    if folder.is_dir() and any(folder.iterdir()) and not [*folder.glob("build_sfun_*.m")]:
        raise InputError(
            f"{folder}: contains other files; name a new folder", code="folder-holds-other-files"
        )
    part = part_of(model, of, rate, kind)
    block = f"sfun_{c_name(part.name)}"
    _, sources = part.add_wrapper(["sfunction.c"])
    texts = {f"src/{name}": text.decode("utf-8") for name, text in sources.items()}
    with atomic_folder(folder, replace=True) as draft:
        write_files(draft, texts | {f"build_{block}.m": _build_script(block, part, [*sources])})
    return folder


def _build_script(block: str, part: Part, sources: list[str]) -> str:
    """Return the text of the MATLAB function that compiles the sources."""
    port_comments = [
        f"%   {kind} {index}: {variable.name} ({variable.unit or '1'}), {variable.text}"
        for kind in ("input", "output")
        for index, variable in enumerate(part.variables_with_causality(kind), start=1)
    ]
    time_comments = (
        f"%   It samples {part.rate:g} times a second."
        if part.rate > 0.0
        else "%   The parameter of the block is its sample time, s."
    )
    files = "".join(f"    '{name}'\n" for name in sources if name.endswith(".c"))
    return "\n".join(
        [
            f"function build_{block}",
            f"%BUILD_{block.upper()} Compile the S-function '{block}'; written by anhyst "
            f"{running_version()}.",
            f"%   {part.text}",
            *port_comments,
            time_comments,
            "here = fileparts(mfilename('fullpath'));",
            "names = {",
            f"{files}}};",
            "sources = cellfun(@(name) fullfile(here, 'src', name), names, 'UniformOutput', false);",
            "include = {['-I' fullfile(here, 'src')], ['-I' fullfile(here, 'src', 'include')]};",
            "flags = {};",
            "if ~ispc % no fused multiply-add, for the same bits as other builds",
            "    flags = {'CFLAGS=$CFLAGS -std=c99 -ffp-contract=off'};",
            "end",
            f"mex('-DS_FUNCTION_NAME={block}', '-outdir', here, '-output', '{block}', ...",
            "    include{:}, flags{:}, sources{:});",
            "end\n",
        ]
    )


BRANCH_POINTS = 101
GAP_POINTS = 11


def export_tables(model: Model, out: PathLike) -> Path:
    """Write the steady-state loop of a model over its valid range as tables.

    The tables contain only the major loop. Minor loops need the model.
    """
    path = Path(out)
    if path.suffix not in {".csv", ".json"}:
        raise InputError(
            f"{path}: the name of a table file must end in .csv or .json; rename it", code="wrong-ending"
        )
    check_writable(path)
    valid_range, name = model.valid_range.schedule, model.output.column
    schedule_values = (
        np.array([0.0])
        if valid_range is None
        else np.linspace(*valid_range, GAP_POINTS if valid_range[0] < valid_range[1] else 1)
    )
    gaps = [None if model.schedule is None else float(value) for value in schedule_values]
    loops = [model.settled_loop(gap, BRANCH_POINTS) for gap in gaps]
    axes = {model.input.column: loops[0][0][:BRANCH_POINTS]}
    if model.schedule is not None:
        axes = {model.schedule.column: schedule_values} | axes
    branches = {
        f"{name}_rising": np.array([output[:BRANCH_POINTS] for _, output in loops]),
        f"{name}_falling": np.array([output[: BRANCH_POINTS - 1 : -1] for _, output in loops]),
    }
    if path.suffix == ".csv":
        grid = np.meshgrid(*axes.values(), indexing="ij")
        columns = dict(zip(axes, grid, strict=True)) | branches
        write_csv(path, {head: values.ravel() for head, values in columns.items()})
        return path
    content = {head: values.tolist() for head, values in branches.items()}
    table_head = {"format": "anhyst-tables", "model": model.name}
    with atomic_writer(path) as stream:
        stream.write(json_text(table_head | {"axes": {k: v.tolist() for k, v in axes.items()}} | content))
    return path


ExportForm = Literal["fmu", "simulink", "lut"]


@dataclass(frozen=True)
class Exported:
    """A file or a folder that was written."""

    out: Path
    form: ExportForm

    def as_dict(self) -> dict[str, Any]:
        """Return the path, the form and the size in bytes for JSON."""
        files = [self.out] if self.out.is_file() else [*self.out.rglob("*")]
        size = sum(path.stat().st_size for path in files if path.is_file())
        return {"out": str(self.out), "as": self.form, "bytes": size}
