"""The command ``compile``: generate C from a model or from the rig file of a stage."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from anhyst.cli.shared import OutputPart
    from anhyst.compilation.compiled_stage import CompiledStage
    from anhyst.compilation.output import Compiled
    from anhyst.compilation.play import CompiledPlay
    from anhyst.model.actuator import Model
    from anhyst.support.atomic import PathLike
    from anhyst.support.jobs import Progress

PLACE = 23, "Use a model"
PROGRESS = "choosing tables and measuring"

CompensatorKind = Literal["full", "simplified", "play", "single-valued"]
"""Kinds of compensator."""
SignalFormat = Literal["q15", "q31", "f32"]
"""Number formats of the demand, the gap and the current."""


def compile(  # noqa: A001
    model: Model | PathLike,
    out: PathLike,
    *,
    rate: float | None = None,
    kind: CompensatorKind = "full",
    io: SignalFormat | None = None,
    accuracy: float | None = None,
    name: str | None = None,
    controller: PathLike | None = None,
    package: str | None = None,
    progress: Progress | None = None,
) -> Compiled | CompiledPlay | CompiledStage:
    """Generate C from a model or from a stage, in fixed point or single precision.

    The folder contains the sources of a compensator, which computes the current for a demanded
    output. All actuators of a program share these sources. The folder also contains the parameters
    of this actuator, an example, fragments for make and CMake, golden vectors, and an accuracy
    budget measured against the model. DROP_IN.md explains how to add the folder to a project. With
    `controller`, the position controller is included. For a stage, the folder contains the complete
    controller, from sensor heads and gaps to currents. The golden vectors of a stage are a
    simulated motion. With `package`, the folder has the layout that a build system such as Zephyr
    or PlatformIO expects.

    Parameters
    ----------
    model : Model or path-like
        A model.toml, or the rig file of a stage.
    out : path-like, ``DIR``
        Output folder.
    rate : float, at least 1, ``HZ``, optional
        Control ticks per second. Not needed with `controller` or a rig file, which contain it.
    kind : str, ``KIND``
        'full': the law with its exact step. 'simplified': a straight anhysteretic curve in closed
        form, less accurate and faster. 'play' (magnets only): the best single-valued current and
        one play operator, fitted to the loops of the model. 'single-valued' (stages only): the same
        without the play operator.
    io : str, ``FORMAT``, optional
        Format of demand, gap and current: q15 (16 bits), q31, or f32 (single precision throughout).
        A position controller needs q31. A stage uses f32, or with q31 fixed point throughout.
        [default: q15; for a stage f32]
    accuracy : float, ``PERCENT``, optional
        Largest deviation from the model, in per cent of the largest output. [default: 0.1 for
        number formats and tables; the deviation of a simplified law is added to it]
    name : str, ``NAME``, optional
        Name of the actuator in the C code. Two actuators in one program need different names.
        [default: as the model]
    controller : path-like, ``FILE``, optional
        Controller file of a magnetic bearing. Its position controller is added to the folder.
    package : str, ``ECOSYSTEM``, optional
        Layout of the folder, with manifest, example and licence: cmsis-pack, zephyr (a module),
        platformio, arduino (libraries) or cargo (a Rust no_std crate). Not for a stage. [default: C
        with fragments for make and CMake]
    progress : callable, optional
        Called with the work done and the total work.

    Returns
    -------
    Compiled, CompiledPlay or CompiledStage

    Raises
    ------
    InputError
        The model or rig cannot be read or compiled, an option does not fit what is compiled, or the
        folder cannot be written.
    NegativeResult
        The required accuracy cannot be reached.

    Examples
    --------
    anhyst compile model.toml --kind full --io q15 --rate 10000 --out controller
    """
    from anhyst.compilation.compiled_stage import HasController, StageRequest
    from anhyst.compilation.output import compile_actuator
    from anhyst.model.actuator import MODEL_SOURCES, Model
    from anhyst.support.atomic import check_path
    from anhyst.support.errors import wrong_key
    from anhyst.support.kinds import MODEL_FILE, file_kind, require_capability

    check_path(out, "compile: out")
    if not isinstance(model, Model):
        check_path(model, "compile: model", f"{MODEL_SOURCES} or of the rig file of a stage")
    rig = MODEL_FILE if isinstance(model, Model) else file_kind(model)
    if not isinstance(model, Model) and rig is not MODEL_FILE and "compile" in rig.verbs:
        model_options = {"--accuracy": accuracy, "--controller": controller, "--package": package}
        for option, given_value in model_options.items():
            if given_value is not None:
                text = f"is for a model; leave it out, because the rig file determines how {rig.title} is compiled"
                raise wrong_key(option, text, code="option-not-for-this")
        stage_request = StageRequest(kind, io or "f32", rate, name)
        return require_capability(rig, HasController).compile_controller(model, out, stage_request, progress)
    if kind == "single-valued":
        text = "single-valued is for the rig file of a stage; give full, simplified or play"
        raise wrong_key("--kind", text, code="option-not-for-this")
    return compile_actuator(
        model, out, rate=rate, kind=kind, io=io or "q15", accuracy=accuracy, name=name,
        controller=controller, package=package, progress=progress,
    )  # fmt: skip


def show(result: Compiled | CompiledPlay | CompiledStage, _: Mapping[str, Any]) -> Iterator[OutputPart]:
    """Return the terminal output: what was compiled, its accuracy, and the guide to read next."""
    from anhyst.compilation.compiled_stage import CompiledStage
    from anhyst.compilation.play import CompiledPlay

    if isinstance(result, CompiledPlay):
        yield from _show_play(result)
    elif isinstance(result, CompiledStage):
        yield from _show_stage(result)
    else:
        yield from _show_model(result)
    guide_file = "README.md" if result.manifest.get("package") else "DROP_IN.md"
    yield f"{result.out / guide_file} explains how to add it to a project"


def _show_play(compiled: CompiledPlay) -> Iterator[OutputPart]:
    from anhyst.cli.printing import TerminalTable

    manifest = compiled.manifest
    largest_force = manifest["accuracy"]["largest_output"]
    rows = TerminalTable(
        f"force of the model minus demand, in % of {largest_force:.4g} N",
        ("", "whole loop, rms", "worst", "10 % cycles, rms", "worst"),
    )
    for title, key in (("map with one play", "play"), ("single-valued curve", "single-valued")):
        deviations = manifest["accuracy"][key]
        rows.add_row(title, *(f"{value:.2g}" for value in deviations.values()))
    size = manifest["memory"]["parameters_bytes"]
    play_data = manifest["play"]
    yield f"{compiled.out}: play, {manifest['io']}, {size} bytes of parameters"
    yield rows
    yield (
        f"half-width of the play: {play_data['radius_A']:.3g} A; half-width of the loops: up to "
        f"{play_data['half_width_A']:.3g} A"
    )


def _show_stage(compiled: CompiledStage) -> Iterator[str]:
    manifest, stage = compiled.manifest, compiled.manifest["stage"]
    kind, io, rate = (manifest[name] for name in ("kind", "io", "rate_Hz"))
    yield f"{compiled.out}: controller of a stage, {kind}, {io}, {rate:g} Hz"
    yield f"number format of the compensators: {stage['force_to_current']} (control.format of the rig file)"
    yield (
        f"coordinates {', '.join(stage['free'])}; {stage['heads']} heads, {stage['magnets']} "
        f"magnets; {manifest['memory']['parameters_bytes']} bytes of parameters"
    )
    yield f"{len(compiled.vectors['flags'])} ticks of a simulated motion are its golden vectors"


def _show_model(compiled: Compiled) -> Iterator[OutputPart]:
    from anhyst.cli.printing import TerminalTable

    manifest, budget = compiled.manifest, compiled.budget
    rows = TerminalTable(
        f"accuracy, in % of {budget.reference_output:.4g} {budget.unit}", ("part", "worst", "rms")
    )
    for row in (*budget.parts, budget.compiled, budget.total, budget.drift):
        if row.worst is not None and row.rms is not None:
            worst, rms = (f"{100.0 * value / budget.reference_output:.2g}" for value in (row.worst, row.rms))
            rows.add_row(row.title, worst, rms)
    size = manifest["memory"]["parameters_bytes"]
    yield f"{compiled.out}: {manifest['kind']}, {manifest['io']}, {size} bytes of parameters"
    yield rows
    if position_controller := manifest["controller"]:
        yield (
            f"position controller '{position_controller['name']}': {position_controller['rate_Hz']:g} Hz, "
            f"{position_controller['state_bytes']} bytes of state"
        )
    yield from (f"{name}: {setting}" for name, setting in manifest["plan"].items())
