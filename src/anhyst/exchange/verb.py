"""The verb ``export``: a model or a rig file, in any form that other tools read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from anhyst.data.formats.text import write_csv
from anhyst.exchange.fmu_file import PLATFORMS_ALL, Of, export_fmu, part_of
from anhyst.exchange.model_part import Kind
from anhyst.exchange.part import FmiVersion, Part
from anhyst.model.actuator import Model
from anhyst.model.file import read_model
from anhyst.support.atomic import PathLike, atomic_writer, check_writable, whole_folder, write_texts
from anhyst.support.c_objects import c_name
from anhyst.support.errors import InputError
from anhyst.support.json_text import json_text
from anhyst.support.progress import Progress
from anhyst.support.version import running_version


def export_sfunction(
    model: Model | PathLike,
    out: PathLike,
    *,
    of: Of | None = None,
    rate: float | None = None,
    kind: Kind | None = None,
) -> Path:
    """Write a level-2 C S-function: sources, and the function that builds them in MATLAB.

    It holds what :func:`~anhyst.exchange.fmu_file.export_fmu` puts into an FMU: outputs that follow
    from the inputs of a sample are there at the next one. An actuator gets its sample time, s, as
    the parameter of the block.
    """
    folder = Path(out)
    if folder.is_dir() and any(folder.iterdir()) and not [*folder.glob("build_sfun_*.m")]:
        raise InputError(
            f"{folder}: holds other files; name a new folder", code="folder-holds-other-files"
        )
    part = part_of(model, of, rate, kind)
    block = f"sfun_{c_name(part.name)}"
    _, sources = part.complete(["sfunction.c"])
    texts = {f"src/{name}": text.decode("utf-8") for name, text in sources.items()}
    with whole_folder(folder, replace=True) as draft:
        write_texts(draft, texts | {f"build_{block}.m": _build_script(block, part, [*sources])})
    return folder


def _build_script(block: str, part: Part, sources: list[str]) -> str:
    """Return the MATLAB function that compiles the sources."""
    ports = [
        f"%   {kind} {index}: {variable.name} ({variable.unit or '1'}), {variable.text}"
        for kind in ("input", "output")
        for index, variable in enumerate(part.named(kind), start=1)
    ]
    timed = (
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
            *ports,
            timed,
            "here = fileparts(mfilename('fullpath'));",
            "names = {",
            f"{files}}};",
            "sources = cellfun(@(name) fullfile(here, 'src', name), names, 'UniformOutput', false);",
            "include = {['-I' fullfile(here, 'src')], ['-I' fullfile(here, 'src', 'include')]};",
            "flags = {};",
            "if ~ispc % the bits of other builds: no product is fused into a sum",
            "    flags = {'CFLAGS=$CFLAGS -std=c99 -ffp-contract=off'};",
            "end",
            f"mex('-DS_FUNCTION_NAME={block}', '-outdir', here, '-output', '{block}', ...",
            "    include{:}, flags{:}, sources{:});",
            "end\n",
        ]
    )


POINTS, GAPS = 101, 11


def export_tables(model: Model, out: PathLike) -> Path:
    """Write the settled loop of a model over its valid range as tables.

    A table holds the major loop alone: inner loops, and so hysteresis in use, need the model.
    """
    path = Path(out)
    if path.suffix not in {".csv", ".json"}:
        raise InputError(
            f"{path}: tables are written as .csv or .json; name it so", code="wrong-ending"
        )
    if model.valid is None:
        raise InputError(
            "the model does not say where it holds ([valid]): no range for a table",
            code="no-valid-range",
            key="valid",
        )
    check_writable(path)
    ends, name = model.valid.schedule, model.output.column
    at = np.array([0.0]) if ends is None else np.linspace(*ends, GAPS if ends[0] < ends[1] else 1)
    places = [None if model.schedule is None else float(value) for value in at]
    loops = [model.settled_loop(one, POINTS) for one in places]
    axes = {model.input.column: loops[0][0][:POINTS]}
    if model.schedule is not None:
        axes = {model.schedule.column: at} | axes
    branches = {
        f"{name}_rising": np.array([output[:POINTS] for _, output in loops]),
        f"{name}_falling": np.array([output[: POINTS - 1 : -1] for _, output in loops]),
    }
    if path.suffix == ".csv":
        grid = np.meshgrid(*axes.values(), indexing="ij")
        columns = dict(zip(axes, grid, strict=True)) | branches
        write_csv(path, {head: values.ravel() for head, values in columns.items()})
        return path
    content = {head: values.tolist() for head, values in branches.items()}
    about = {"format": "anhyst-tables", "model": model.name}
    with atomic_writer(path) as stream:
        stream.write(
            json_text(about | {"axes": {k: v.tolist() for k, v in axes.items()}} | content)
        )
    return path


As = Literal["fmu", "simulink", "lut"]


@dataclass(frozen=True)
class Exported:
    """A file or a folder that was written."""

    out: Path
    form: As

    def as_dict(self) -> dict[str, Any]:
        """Return it for JSON, with its size in bytes."""
        files = [self.out] if self.out.is_file() else [*self.out.rglob("*")]
        size = sum(path.stat().st_size for path in files if path.is_file())
        return {"out": str(self.out), "as": self.form, "bytes": size}


def export(
    model: Model | PathLike,
    out: PathLike,
    *,
    as_: As = "fmu",
    of: Of | None = None,
    rate: float | None = None,
    kind: Kind | None = None,
    fmi: FmiVersion = "2.0",
    platforms: Sequence[str] | None = None,
    progress: Progress | None = None,
) -> Exported:
    """Export a model for other tools: its compensator or the actuator; or its loops as tables.

    Parameters
    ----------
    model : Model or path-like
        The model, its file, or the rig file of a bearing or a stage, for plant and controller in
        one.
    out : path-like
        ``.fmu``, a folder for Simulink, ``.csv`` or ``.json``.
    as_ : str
        ``"fmu"``: for co-simulation; ``"simulink"``: a C S-function; ``"lut"``: settled loops over
        the gap as tables.
    of : str, optional
        Of a model: ``"compensator"`` (if left out), demand in, current out; ``"actuator"``,
        current in, force out.
    rate : float, optional
        Ticks a second of a compensator.
    kind : str, optional
        Of a compensator, ``"full"`` (if left out) or ``"simplified"``.
    fmi : str
        Version of the standard, ``"2.0"`` or ``"3.0"``.
    platforms : sequence of str, optional
        Of an FMU, such as ``"x86_64-linux"``; all if left out.
    progress : callable, optional
        Called with what is done and what there is in all.

    Returns
    -------
    Exported

    Raises
    ------
    InputError
        The model cannot be read or exported so, or the place cannot be written.
    """
    if as_ == "lut":
        path = export_tables(model if isinstance(model, Model) else read_model(model), out)
    elif as_ == "simulink":
        path = export_sfunction(model, out, of=of, rate=rate, kind=kind)
    else:
        names = PLATFORMS_ALL if platforms is None else platforms
        path = export_fmu(
            model, out, of=of, rate=rate, kind=kind, fmi=fmi, platforms=names, progress=progress
        )
    return Exported(path, as_)
