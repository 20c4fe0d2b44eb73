"""Explain the selection of a hysteresis law and a gap map in sentences, and list all candidates.

A gap map states how parameters depend on the air gap. A sentence states the errors that decided the
selection. If another candidate has a smaller error, the sentence explains why it was not selected.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from anhyst.data import Loops
from anhyst.identification.candidates import CandidateComparison, ModelCandidate, make_titles
from anhyst.identification.model_building import is_scheduled_over_gap
from anhyst.model.schema import CHOSEN, CandidateFit

_MIN_OFFER_RATIO = 1.5
"""Ratio of the rms residual of the selected map to that of a map that cannot be compiled. Above
this ratio, the text suggests the other map."""


def list_candidates(
    comparison: CandidateComparison, best: ModelCandidate, law: str
) -> tuple[CandidateFit, ...]:
    """Return all candidates, the simplest first."""
    candidates = sorted(
        dict.fromkeys([*comparison.fits, *comparison.drop_reasons]), key=lambda entry: entry.rank
    )
    return tuple(
        CandidateFit(
            law=title,
            gap_map=candidate.file_gap_map,
            numbers=fits.reduced_fit.theta.size if fits else 0,
            rms=float(np.sqrt(fits.reduced_fit.cost)) if fits else None,
            left_out=comparison.finite_withheld_error(candidate)
            if candidate in comparison.contenders
            else None,
            note=_explain_drop(comparison, candidate, best),
        )
        for candidate, title in zip(candidates, make_titles(candidates, law), strict=True)
        for fits in [comparison.fits.get(candidate)]
    )


def _explain_drop(comparison: CandidateComparison, candidate: ModelCandidate, best: ModelCandidate) -> str:
    if candidate == best:
        return CHOSEN
    if candidate in comparison.drop_reasons:
        return f"dropped: {comparison.drop_reasons[candidate]}"
    return "" if candidate in comparison.contenders else "passed over"


def explain_law(comparison: CandidateComparison, best: ModelCandidate, law: str, loopset: Loops) -> str:
    """Explain why this law was selected."""
    names = dict(zip(comparison.fits, make_titles(list(comparison.fits), law), strict=True))
    withheld_names = {"gap": _schedule_plural(loopset), "loop": "loops", "block": "blocks of samples"}
    selected_error = comparison.finite_withheld_error(best)
    if selected_error is None:
        return (
            f"law {names[best]}: the simplest, because for each candidate the error at some withheld "
            "samples cannot be computed"
        )
    text = (
        f"law {names[best]} predicts withheld {withheld_names[comparison.withheld_kind]} with a mean error of "
        f"{_as_percent(selected_error)} of the largest output"
    )
    errors = {
        model: comparison.finite_withheld_error(model) for model in comparison.contenders if model != best
    }
    rival_errors = {model: error for model, error in errors.items() if error is not None}
    if not rival_errors:
        return text
    rival = min(rival_errors, key=lambda model: rival_errors[model])
    map_text = "" if rival.file_gap_map == best.file_gap_map else f" under '{rival.file_gap_map}'"
    text += f"; {names[rival]}{map_text} has an error of {_as_percent(rival_errors[rival])}"
    return text + (_explain_rejected(comparison, best, rival) if rival_errors[rival] < selected_error else "")


def _explain_rejected(comparison: CandidateComparison, best: ModelCandidate, loser: ModelCandidate) -> str:
    """Explain why a candidate with a smaller mean error was not selected."""
    if comparison.is_several_times_worse(loser, best):
        rms = np.sqrt([comparison.fits[candidate].reduced_fit.cost for candidate in (best, loser)])
        return f", but it fits the loops with {_as_percent(rms[1])} rms instead of {_as_percent(rms[0])}"
    if loser.rank > best.rank:
        return ", but the difference is within its scatter and the law is more complex"
    return ", but its mean square error, which decides, is larger or within its scatter"


def explain_gap_map(
    comparison: CandidateComparison,
    best: ModelCandidate,
    requested_map: str,
    loopset: Loops,
    loser: Sequence[ModelCandidate],
) -> str:
    """Explain why this gap map was selected."""
    name = best.file_gap_map
    gaps, count = _schedule_plural(loopset), len(loopset.schedule_values)
    if count < 2:
        schedule_name = loopset.schedule.name if loopset.schedule else "gap"
        return f"there are loops at only one {schedule_name}, so no parameter depends on the {schedule_name}"
    if count == 2:
        reason = (
            f"gap map '{name}' was {'selected by its fit only' if requested_map == 'auto' else 'requested'}; "
            f"with two {gaps} none can be withheld for a test, so the model is a guess between and "
            "beyond them"
        )
    elif requested_map != "auto":
        reason = f"gap map '{name}' was requested"
    else:
        reason = _explain_comparison(comparison, best, gaps)
    text = f"{reason}{_offer_free_map(comparison, best, loopset)}"
    if names := dict.fromkeys(candidate.file_gap_map for candidate in loser):
        text += (
            f"; passed over: {', '.join(names)} (cannot be compiled, fails the acceptance test, "
            "deviates between the gaps or has an implausible initial curve)"
        )
    return text


def _explain_comparison(comparison: CandidateComparison, best: ModelCandidate, gaps: str) -> str:
    name = best.file_gap_map
    errors = comparison.errors_by_map(best) if comparison.withheld_kind == "gap" else {}
    selected_error = errors.pop(name, np.inf)
    if not np.isfinite(selected_error):
        return f"gap map '{name}' fits the loops best"
    reason = (
        f"gap map '{name}' predicts withheld {gaps} with a mean error of {_as_percent(selected_error)} of the "
        "largest output"
    )
    if rejected_map_texts := ", ".join(
        f"{map_name} {_as_percent(error)}" if np.isfinite(error) else f"{map_name} has no solution there"
        for map_name, error in errors.items()
    ):
        reason += f" ({rejected_map_texts})"
    if any(error < selected_error for error in errors.values()):
        reason += "; a smaller error is within its scatter, or belongs to a more complex map or a worse fit"
    return reason


def _offer_free_map(comparison: CandidateComparison, best: ModelCandidate, loopset: Loops) -> str:
    """Suggest the map ``free`` if it fits better and was rejected because it cannot be compiled."""
    if is_scheduled_over_gap(loopset) or best.gap_map == "free":
        return ""
    selected_cost = comparison.fits[best].reduced_fit.cost
    costs = [
        fits.reduced_fit.cost
        for candidate, fits in comparison.fits.items()
        if candidate.gap_map == "free" and candidate not in comparison.contenders
    ]
    if not costs or selected_cost < _MIN_OFFER_RATIO**2 * min(costs):
        return ""
    rms = [_as_percent(float(np.sqrt(cost))) for cost in (selected_cost, min(costs))]
    return f"; --gap-map free fits the loops with {rms[1]} rms instead of {rms[0]}, but cannot be compiled"


def _schedule_plural(loopset: Loops) -> str:
    """Return the plural name of the scheduling variable's values."""
    if loopset.schedule is None or is_scheduled_over_gap(loopset):
        return "gaps"
    return f"values of the {loopset.schedule.name}"


def _as_percent(ratio: float) -> str:
    return f"{100.0 * ratio:.2g} %"
