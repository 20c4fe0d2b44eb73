"""The command ``identify``: find a model from measured loops."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from anhyst.cli.printing import TerminalTable
    from anhyst.cli.shared import OutputPart
    from anhyst.data.source import LoopSource
    from anhyst.identification.run import IdentifyResult
    from anhyst.model.actuator import Model
    from anhyst.support.atomic import PathLike
    from anhyst.support.jobs import Progress

PLACE = 13, "From measurements to a model"
PROGRESS = "searching"

GapMap = Literal["scaling", "reluctance", "circuit", "free", "auto"]
"""Gap maps, or ``auto``: the map with the smallest error at withheld gaps."""
Output = Literal["auto", "force", "flux_linkage"]
"""Output of a model that was identified from loops of flux linkage."""
Weights = Literal["loops", "points", "relative"]
"""Weights of the cost: equal for all loops, equal for all samples, or each loop relative to its
largest output."""
SearchMethod = Literal["default", "paper"]
"""Methods of the search."""


def identify(
    loops: LoopSource,
    *,
    out: PathLike | None = None,
    law: str = "auto",
    gap_map: GapMap = "auto",
    search: SearchMethod = "default",
    seed: int = 1,
    weights: Weights = "loops",
    offsets: bool = True,
    dead_band: bool = True,
    rate: bool = True,
    output: Output = "auto",
    force_at: PathLike | Any = None,
    pole_area: float | None = None,
    turns: float | None = None,
    progress: Progress | None = None,
    checkpoint: PathLike | None = None,
    **reading: Any,
) -> IdentifyResult:
    """Find the model of an actuator from measured loops.

    All loops at all gaps are fitted together. The model file contains the parameters with units,
    the valid range, the fit figures, the uncertainty and the origin.

    Without a force sensor, give loops of flux linkage over current at three gaps or more. The force
    follows from the energy balance of the magnetic circuit, and its uncertainty is stated.

    Exit code 1: the model file is written, but the model must not be used. Its rms deviation exceeds
    5 % of full scale and is not noise, it explains little of the output, the output has dynamics, or
    its force does not rise everywhere as the gap closes and as the current rises.

    Ctrl-C writes the best model found until then; the exit code is 130. If a search 'paper' was
    stopped or killed, the same command continues it.

    Parameters
    ----------
    loops : Loops, path-like, list of path-like, data frame or dict
        CSV files, recordings or folders.
    out : path-like, ``FILE``, required on the command line
        Model file to write.
    law : str, ``LAW``
        Hysteresis law: effective-field, jiles-atherton-1986, play-cells, play-cells-langevin, or
        auto: the law that best predicts withheld data.
    gap_map : str, ``MAP``
        What depends on the gap: 'scaling' of the field (as in the paper), 'reluctance' in series,
        'circuit' (all parameters except those of the iron), 'free' (all parameters; for fixed gaps
        only), or 'auto': the one of scaling, reluctance and circuit that best predicts withheld
        gaps.
    search : str, ``HOW``
        'default', or 'paper' to reproduce the figures of the paper.
    seed : int, at least 0
        The same seed gives the same model on the same machine.
    weights : str, ``WHAT``
        Equal weights for all loops ('loops', so that minor loops count), for all samples
        ('points'), or for all loops relative to their own largest output ('relative').
    offsets : bool
        Use offsets of input and output if the loops require them, or no offsets.
    dead_band : bool
        Use the widest dead band that the loops allow, so that small movements do not erase the
        history, or no dead band.
    rate : bool
        If the loops have several speeds, fit the eddy-current lag of solid iron, or treat all loops
        as quasi-static.
    output : str, ``WHAT``
        Output of the model for loops of flux linkage: 'force', derived from the energy balance,
        'flux_linkage', or 'auto': the force if there are three gaps or more.
    force_at : path-like, data frame or dict, ``FILE``, optional
        CSV file with static forces at constant currents, columns I_A, gap_m, F_N, which calibrate a
        derived force; best at the smallest gap and the largest current. The weight of the armature
        at lift-off is such a force.
    pole_area : float, ``M2``, optional
        Area of flat pole faces, m^2, known to 5 %; it calibrates a derived force. For two pole
        faces in series, give half of the area of one.
    turns : float, ``N``, optional
        Turns of the coil, with `pole_area`.
    progress : callable, optional
        Called with the number of stages done and the total.
    checkpoint : path-like, optional, only in Python
        File with the finished stages of the search 'paper', so that a stopped search can
        continue. [default: next to `out`]
    **reading
        How files or columns are read: the keywords of `read_loops`, and ``clean``, the cleaning
        steps. `Loops` are used unchanged.

    Returns
    -------
    IdentifyResult
        After Ctrl-C, the best model until then, marked as interrupted.

    Raises
    ------
    InputError
        The loops cannot be used or contradict their headers, or a law, map, search or weighting is
        unknown.
    KeyboardInterrupt
        Ctrl-C before there was a model.

    Examples
    --------
    anhyst identify loops.csv --out model.toml --gap-map auto
    """
    from dataclasses import replace

    from anhyst.data.input_files import list_input_files
    from anhyst.data.loops import Loops
    from anhyst.data.source import load_loops
    from anhyst.data.table import check_source, is_data_frame
    from anhyst.identification.flux_force import read_calibration
    from anhyst.identification.identify import check_options
    from anhyst.identification.identify import identify as work
    from anhyst.support.atomic import check_writable
    from anhyst.support.jobs import split_progress

    check_options(law, gap_map, search)
    calibration = read_calibration(force_at, pole_area, turns)
    if out is not None:
        files: Any = None if isinstance(loops, Loops) or is_data_frame(loops) else loops
        if files is not None:
            check_source(files, "identify: loops")
            files = list_input_files(files, reading.get("sidecar"))
        check_writable(out, input_files=files or ())
        checkpoint = checkpoint or _checkpoint_path(Path(out))
    reading_progress, fit_progress = split_progress(progress, (1.0, 9.0))
    loaded_loops, options = load_loops(loops, "identify: loops", reading, progress=reading_progress)
    result = work(
        loaded_loops, law=law, gap_map=gap_map, search=search, seed=seed, weights=weights,
        offsets=offsets, dead_band=dead_band, rate=rate, output=output, calibration=calibration,
        progress=fit_progress, checkpoint=checkpoint,
    )  # fmt: skip
    if options is not None:
        result = replace(result, model=result.model.with_read_options(options))
    if out is not None:
        result.model.save(out)
    return result


def _checkpoint_path(out: Path) -> Path | None:
    """Return the path of the checkpoint file; None if the output is not a regular file."""
    if out.exists() and not out.is_file():
        return None
    return out.with_name(f"{out.name}.checkpoint")


def stopped(arguments: Mapping[str, Any]) -> str:
    """Return the message after Ctrl-C if there is no model yet."""
    return f"too early for a model; nothing was written{_continuation_text(arguments)}"


def _continuation_text(arguments: Mapping[str, Any]) -> str:
    """Return the hint that the same command continues the search; empty if it does not."""
    checkpoint = _checkpoint_path(arguments["out"]) if arguments["search"] == "paper" else None
    can_continue = checkpoint is not None and checkpoint.exists()
    return "; the same command continues from there" if can_continue else ""


def refuse(result: IdentifyResult, arguments: Mapping[str, Any]) -> None:
    """Raise an error if the search was interrupted or if the model must not be used."""
    from anhyst.support.errors import Interrupted, NegativeResult

    out = arguments["out"]
    if result.interrupted:
        raise Interrupted(f"{out} contains the best model until then{_continuation_text(arguments)}")
    if result.acceptance.passed is False:
        failed_tests = result.acceptance.text(result.model.input.unit)
        rejection_text = "; ".join(filter(None, (failed_tests, result.rejection)))
        raise NegativeResult(f"{out}: {rejection_text}", code="acceptance-failed")
    if result.rejection:
        raise NegativeResult(f"{out}: {result.rejection}", code="fit-rejected")


def as_json(result: IdentifyResult, arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Return the result for ``--json``."""
    from dataclasses import asdict

    model = result.model
    return {
        "out": str(arguments["out"]),
        "law": model.law,
        "gap_map": model.gap_map,
        "parameters": dict(model.parameters),
        "nodes": list(model.nodes),
        "fit": asdict(model.fit) if model.fit else None,
        "uncertainty": asdict(model.uncertainty) if model.uncertainty else None,
        "reduction": [asdict(reduction_step) for reduction_step in model.reduction],
        "rejection": result.rejection,
        "warnings": list(result.warnings),
        "seconds": result.seconds,
        "stages_s": dict(result.stages),
        "evaluations": result.evaluations,
        "interrupted": result.interrupted,
    }


def show(result: IdentifyResult, arguments: Mapping[str, Any]) -> Iterator[OutputPart]:
    """Return the terminal output: the deviations, the choices and their reasons."""
    model, fit = result.model, result.model.fit
    yield f"{arguments['out']}: {model.law}, gap map {model.gap_map}, found in {result.seconds:.2g} s"
    settings = model.provenance.settings
    if model.flux is not None:
        mean, worst = (
            100.0 * (value or 0.0) for value in (model.flux.mean_uncertainty, model.flux.worst_uncertainty)
        )
        yield (
            f"force derived from the flux linkage: uncertain by {mean:.2g} % in the mean and {worst:.2g} % "
            "at worst, of the largest force"
        )
    if hysteresis := settings.get("hysteresis"):
        yield f"hysteresis: {hysteresis}"
    yield from _show_fit(model)
    if reason := settings.get("law_reason"):
        yield str(reason)
    yield from _list_offsets(model)
    if dead_band := settings.get("dead_band"):
        yield f"dead band: {dead_band}"
    if model.flux is not None:
        yield from model.flux.assumptions
    if rate_text := settings.get("rate"):
        yield f"rate: {rate_text}"
    for reduction_step in model.reduction:
        yield (
            f"reduction: {reduction_step.frozen} made equal at all nodes, mean deviation "
            f"{100.0 * reduction_step.cost_before:.3g} % -> {100.0 * reduction_step.cost_after:.3g} %"
        )
    if model.uncertainty is not None:
        yield from (f"note: {text}" for text in model.uncertainty.statements)
    for name, error in fit.left_out.items() if fit else ():
        yield f"cross-validation error with gap map {name}: {100.0 * error:.3g} %"


def _show_fit(model: Model) -> Iterator[OutputPart]:
    """Return the deviations from the measured loops, and the table of candidates."""
    from anhyst.data.output_map import name_full_scale

    fit = model.fit
    if fit is None or not fit.largest_output > 0.0:
        return
    mean, rms, worst = (100.0 * value / fit.largest_output for value in (fit.mean_abs, fit.rms, fit.worst))
    yield (
        f"deviation from the measurement: mean {mean:.3g} %, rms {rms:.3g} %, worst "
        f"{worst:.3g} % of {name_full_scale(model.output, fit.largest_output)}"
    )
    if fit.left_over:
        yield fit.left_over
    if expected_error := fit.cross_validation:
        scope = (
            "between the measured values, including the choice of the map"
            if expected_error.left_out == "gap"
            else "at other samples of such loops, but not for other loop sizes"
        )
        low, high = (100.0 * bound for bound in expected_error.interval)
        yield f"expected error {scope}: {100.0 * expected_error.error:.3g} % ({low:.2g} to {high:.2g} %)"
    yield from _list_candidates(model)


MAX_CANDIDATES = 4
"""Number of candidates that are listed without ``--verbose``."""


def _list_candidates(model: Model) -> list[str | TerminalTable]:
    """Return a table of candidates: the chosen one first, then by error at withheld data."""
    from anhyst.cli.printing import TerminalTable, printer
    from anhyst.support.wording import count_text

    sorted_candidates = sorted(
        model.fit.candidates if model.fit else (),
        key=lambda candidate: (
            candidate.note != "chosen",
            candidate.left_out is None,
            candidate.left_out or candidate.rms or 0.0,
        ),
    )
    shown_candidates = sorted_candidates if printer.is_verbose else sorted_candidates[:MAX_CANDIDATES]
    hidden_count = len(sorted_candidates) - len(shown_candidates)
    rows = TerminalTable(
        "candidates, the chosen one first", ["law", "gap map", "rms %", "withheld %", "parameters"]
    )
    for candidate in shown_candidates:
        note = f" ({candidate.note})" if candidate.note else ""
        left_out = "" if candidate.left_out is None else f"{100.0 * candidate.left_out:.3g}"
        rms = "" if candidate.rms is None else f"{100.0 * candidate.rms:.3g}"
        rows.add_row(f"{candidate.law}{note}", candidate.gap_map, rms, left_out, str(candidate.numbers))
    hidden_note = [f"{count_text(hidden_count, 'more candidate')}: --verbose"] if hidden_count else []
    return [rows, *hidden_note] if sorted_candidates else []


def _list_offsets(model: Model) -> list[str]:
    """Return the fitted offsets with their standard deviations."""
    uncertainty = model.uncertainty
    if uncertainty is None:
        return []
    lines = [
        f"{name}: {value:.3g} +- {std:.2g}"
        for name, value, std in zip(uncertainty.names, uncertainty.values, uncertainty.std, strict=True)
        if "offset" in name
    ]
    return lines or ["offsets of input and output: none, because the loops do not require any"]
