"""A model as an S-function for Simulink: the component of an FMU behind Simulink's own interface."""

from __future__ import annotations

from pathlib import Path

from anhyst.exchange.compensator_part import Kind
from anhyst.exchange.fmu_file import Of, part_of
from anhyst.exchange.part import Part
from anhyst.model.actuator import Model
from anhyst.support.atomic import PathLike
from anhyst.support.c_names import c_name
from anhyst.support.errors import InputError
from anhyst.support.folder import whole_folder, write_texts
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
