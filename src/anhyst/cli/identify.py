"""The verb ``identify``."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

import anhyst
from anhyst.cli.printing import TerminalTable, printer
from anhyst.cli.shared import (
    AsJson,
    Clean,
    Columns,
    Constants,
    Drop,
    Flip,
    LoopColumn,
    LoopFiles,
    LoopHistory,
    Scale,
    Schedule,
    Sidecar,
    Verbose,
    print_json,
    progress_bar,
    read_options,
    show_with,
    table,
    warn,
)
from anhyst.laws import LAWS
from anhyst.support.errors import Interrupted, NegativeResult
from anhyst.support.wording import count_of

if TYPE_CHECKING:
    from anhyst import IdentifyResult, Model


GapMapChoice = Literal["scaling", "reluctance", "circuit", "free", "auto"]
"""Gap maps, and letting the cross-validation error choose."""

Weights = Literal["loops", "points", "relative"]
"""What counts the same."""

SearchChoice = Literal["default", "paper"]
"""Ways to search."""

Out = Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="Model file to write.")]


def _known(law: str) -> str:
    if law not in {*LAWS, "auto"}:
        known = ", ".join(repr(name) for name in LAWS)
        raise typer.BadParameter(f"{law!r} is not one of {known}.")
    return law


LawOption = Annotated[
    str,
    typer.Option(
        metavar="LAW",
        callback=_known,
        help=f"Hysteresis law: {', '.join(LAWS)}, or auto: the law "
        "that best predicts withheld data.",
    ),
]
GapMapOption = Annotated[
    GapMapChoice,
    typer.Option(
        metavar="MAP",
        help="What depends on the gap: 'scaling' of the field (as in the paper), "
        "'reluctance' in series, 'circuit' (all parameters except those of the iron), "
        "'free' (all parameters; for fixed gaps only), or 'auto': the one of scaling, "
        "reluctance and circuit that best predicts withheld gaps.",
    ),
]
SearchOption = Annotated[
    SearchChoice,
    typer.Option(
        metavar="HOW", help="'default', or 'paper' to reproduce the figures of the paper."
    ),
]
Seed = Annotated[
    int, typer.Option(min=0, help="The same seed gives the same model on the same machine.")
]
WeightsOption = Annotated[
    Weights,
    typer.Option(
        metavar="WHAT",
        help="Equal weights for all loops ('loops', so that minor loops count), for all "
        "samples ('points'), or for all loops relative to their own largest output "
        "('relative').",
    ),
]
Offsets = Annotated[
    bool,
    typer.Option(help="Use offsets of input and output if the loops require them, or no offsets."),
]
DeadBand = Annotated[
    bool,
    typer.Option(
        help="Use the widest dead band that the loops allow, so that small movements do not "
        "erase the history, or no dead band."
    ),
]


Rate = Annotated[
    bool,
    typer.Option(
        help="If the loops have several speeds, fit the eddy-current lag of solid iron, or "
        "treat all loops as quasi-static."
    ),
]


def identify(
    loops: LoopFiles,
    out: Out,
    law: LawOption = "auto",
    gap_map: GapMapOption = "auto",
    search: SearchOption = "default",
    seed: Seed = 1,
    weights: WeightsOption = "loops",
    offsets: Offsets = True,
    dead_band: DeadBand = True,
    rate: Rate = True,
    columns: Columns = None,
    sidecar: Sidecar = None,
    schedule: Schedule = None,
    loop: LoopColumn = None,
    constants: Constants = None,
    history: LoopHistory = None,
    clean: Clean = None,
    scale: Scale = None,
    flip: Flip = None,
    drop: Drop = None,
    as_json: AsJson = False,
    _verbose: Verbose = False,
) -> None:
    """Find the model of an actuator from measured loops.

    All loops at all gaps are fitted together. The model file keeps parameters with units, valid
    range, fit figures, uncertainty and where it came from.

    Exit code 1: the model file is written, but the model must not be used. Either its rms deviation
    exceeds 5 % of full scale and is not noise, or its force does not rise everywhere as the gap
    closes and as the current rises.

    Ctrl-C writes the best model found until then; the exit code is 130. If a search 'paper' was
    stopped or killed, the same command continues it.

    Example: anhyst identify loops.csv --out model.toml --gap-map auto
    """
    from anhyst.data.reading import files_read
    from anhyst.support.atomic import check_writable

    check_writable(out, reads=files_read(loops, sidecar))
    options = read_options(
        columns, sidecar, schedule, loop, constants, history, clean, scale, flip, drop
    )
    with progress_bar("reading") as progress:
        measured = options.read(loops, progress)
    checkpoint = _checkpoint(out) if search == "paper" else None
    with _stoppable(checkpoint), progress_bar("searching") as progress:
        result = anhyst.identify(
            measured,
            law=law,
            gap_map=gap_map,
            search=search,
            seed=seed,
            weights=weights,
            offsets=offsets,
            dead_band=dead_band,
            rate=rate,
            progress=progress,
            checkpoint=checkpoint,
        )
    result.model.with_read_options(options).save(out)
    _report(result, out, checkpoint, as_json)


def _checkpoint(out: Path) -> Path | None:
    """Place of the checkpoint; beside a device there is none."""
    if out.exists() and not out.is_file():
        return None
    return out.with_name(f"{out.name}.checkpoint")


def _go_on(checkpoint: Path | None) -> str:
    """Say that a stopped search may go on, where it may."""
    kept = checkpoint is not None and checkpoint.exists()
    return "; the same command goes on from there" if kept else ""


@contextmanager
def _stoppable(checkpoint: Path | None) -> Iterator[None]:
    try:
        yield
    except KeyboardInterrupt:
        raise Interrupted(f"too early for a model, nothing written{_go_on(checkpoint)}") from None


def _report(result: IdentifyResult, out: Path, checkpoint: Path | None, as_json: bool) -> None:
    """Say what came out, and end as it deserves."""
    if as_json:
        for text in result.warnings:
            warn(text)
        print_json(_as_dict(result, out))
    else:
        _show(result, out)
    if result.interrupted:
        raise Interrupted(f"{out} holds the best model so far{_go_on(checkpoint)}")
    if result.acceptance.passed is False:
        failed = result.acceptance.text(result.model.input.unit)
        reasons = "; ".join(filter(None, (failed, result.rejection)))
        raise NegativeResult(f"{out}: {reasons}", code="acceptance-failed")
    if result.rejection:
        raise NegativeResult(f"{out}: {result.rejection}", code="fit-rejected")


def _as_dict(result: IdentifyResult, out: Path) -> dict[str, object]:
    from dataclasses import asdict

    model = result.model
    return {
        "out": str(out),
        "law": model.law,
        "gap_map": model.gap_map,
        "parameters": dict(model.parameters),
        "nodes": list(model.nodes),
        "fit": asdict(model.fit) if model.fit else None,
        "uncertainty": asdict(model.uncertainty) if model.uncertainty else None,
        "reduction": [asdict(step) for step in model.reduction],
        "rejection": result.rejection,
        "warnings": list(result.warnings),
        "seconds": result.seconds,
        "stages_s": dict(result.stages),
        "evaluations": result.evaluations,
        "interrupted": result.interrupted,
    }


def _show(result: IdentifyResult, out: Path) -> None:
    from anhyst.data.output_map import name_full_scale

    model, fit = result.model, result.model.fit
    lines: list[str | TerminalTable] = [
        f"{out}: {model.law}, gap map {model.gap_map}, found in {result.seconds:.2g} s"
    ]
    if fit is not None and fit.largest_output > 0.0:
        mean, rms, worst = (
            100.0 * value / fit.largest_output for value in (fit.mean_abs, fit.rms, fit.worst)
        )
        lines.append(
            f"deviation from the measurement: mean {mean:.3g} %, rms {rms:.3g} %, worst "
            f"{worst:.3g} % of {name_full_scale(model.output, fit.largest_output)}"
        )
        lines += [fit.left_over] if fit.left_over else []
        if expected := fit.cross_validation:
            where = (
                "between the measured values, choice of the map and all"
                if expected.left_out == "gap"
                else "at other samples of such loops, not of other sizes"
            )
            lines.append(
                f"expected {where}: "
                f"{100.0 * expected.error:.3g} % ({100.0 * expected.interval[0]:.2g} to "
                f"{100.0 * expected.interval[1]:.2g} %)"
            )
        lines += _candidates(model)
    if reason := model.provenance.settings.get("law_reason"):
        lines.append(str(reason))
    lines += _offsets(model)
    if chosen := model.provenance.settings.get("dead_band"):
        lines.append(f"dead band: {chosen}")
    if late := model.provenance.settings.get("rate"):
        lines.append(f"rate: {late}")
    lines += [
        f"reduction: {step.frozen} made common to all nodes, mean deviation "
        f"{100.0 * step.cost_before:.3g} % -> {100.0 * step.cost_after:.3g} %"
        for step in model.reduction
    ]
    if model.uncertainty is not None:
        lines += [f"note: {text}" for text in model.uncertainty.statements]
    if fit is not None:
        lines += [
            f"cross-validation error with gap map {name}: {100.0 * error:.3g} %"
            for name, error in fit.left_out.items()
        ]
    show_with(result.warnings, *lines)


MAX_CANDIDATES = 4
"""Candidates that are listed without ``--verbose``."""


def _candidates(model: Model) -> list[str | TerminalTable]:
    """List the candidates: the chosen one first, then by their error at withheld data."""
    listed = sorted(
        model.fit.candidates if model.fit else (),
        key=lambda one: (
            one.note != "chosen",
            one.left_out is None,
            one.left_out or one.rms or 0.0,
        ),
    )
    shown = listed if printer.is_verbose else listed[:MAX_CANDIDATES]
    hidden = len(listed) - len(shown)
    rows = table(
        "candidates, the chosen one first", ["law", "gap map", "rms %", "left out %", "numbers"]
    )
    for one in shown:
        note = f" ({one.note})" if one.note else ""
        left_out = "" if one.left_out is None else f"{100.0 * one.left_out:.3g}"
        rms = "" if one.rms is None else f"{100.0 * one.rms:.3g}"
        rows.add_row(f"{one.law}{note}", one.gap_map, rms, left_out, str(one.numbers))
    more = [f"{count_of(hidden, 'more candidate')}: --verbose"] if hidden else []
    return [rows, *more] if listed else []


def _offsets(model: Model) -> list[str]:
    """Name the offsets that were taken, and how sure they are."""
    unsure = model.uncertainty
    if unsure is None:
        return []
    lines = [
        f"{name}: {value:.3g} +- {std:.2g}"
        for name, value, std in zip(unsure.names, unsure.values, unsure.std, strict=True)
        if "offset" in name
    ]
    return lines or ["offsets of input and output: none, the loops demand none"]
