"""The command ``watch``: check whether a model still fits its magnet."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from anhyst.data.loops import Loops
    from anhyst.model.actuator import Model
    from anhyst.support.atomic import PathLike
    from anhyst_rigs.study.watch import WatchResult

PLACE = 42, "During operation"


def watch(
    model: Model | PathLike,
    recording: Loops | PathLike | Mapping[str, Any],
    *,
    least: float | None = None,
    run_length: float = 1e5,
    **reading: Any,
) -> WatchResult:
    """Check whether a model still fits its magnet; if not, since when and by how much it drifted.

    The model is assumed to fit the first cycles of the current in the recording. Every later
    residual is compared with the residuals of these cycles. The exit code is 1 after a drift.

    Parameters
    ----------
    model : Model or path-like
        A model.toml.
    recording : Loops, path-like, data frame or dict
        CSV of one run with the columns t_s, I_A, F_N and gap_m. The gap may vary.
    least : float, ``N``, optional
        Smallest drift that matters. [default: a thousandth of the largest force of the model]
    run_length : float, at least 100, ``CYCLES``
        Mean number of cycles until a false alarm occurs.
    **reading : only in Python
        How a file or columns are read: the keywords of `read_loops`.

    Returns
    -------
    Watched

    Raises
    ------
    InputError
        The recording is not a single run, or has no time or gap.

    Examples
    --------
    anhyst watch model.toml monday.csv
    """
    from anhyst_rigs.study.watch import watch_recording

    return watch_recording(model, recording, reading, least=least, run_length=run_length)


def show(result: WatchResult, arguments: Mapping[str, Any]) -> list[str]:
    """Return the terminal output."""
    is_known = result.finding.drift is None and not result.finding.is_learning
    return [str(result)] if is_known else []


def refuse(result: WatchResult, arguments: Mapping[str, Any]) -> None:
    """Raise NegativeResult if the model has drifted, InputError if the recording is too short."""
    from anhyst.support.errors import InputError, NegativeResult

    if result.finding.drift is not None:
        raise NegativeResult(str(result), code="drifted")
    if result.finding.is_learning:
        recording = arguments["recording"]
        raise InputError(
            f"{recording}: too short for a result: {result}; record more cycles", code="too-short"
        )
