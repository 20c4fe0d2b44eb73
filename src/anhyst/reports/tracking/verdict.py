"""Whether compensation is worth it on a stage, against which baseline, and where it is not."""

from __future__ import annotations

from collections.abc import Sequence

from anhyst.compensate.interface import MethodName
from anhyst.compensate.methods import METHODS
from anhyst.rig.stage.loop import AT_BIAS
from anhyst.study.engine.verdict import ComparedFigure, Judgement, compare, judge, weigh
from anhyst.study.tracking.measures import BANDS_M
from anhyst.study.tracking.simulate import OWN, TrackingStudy, TriedVariant
from anhyst.support.pays import STAGE

_NAMES = {"peak_m": "peak", "average_m": "moving average", "settling_50_s": "settling to 50 nm"}


def judged(study: TrackingStudy, baseline: MethodName) -> Judgement:
    """Compare the compensator with one baseline."""
    return weigh(OWN, _compared(study, [baseline]), "measures")


def verdict(study: TrackingStudy) -> Judgement:
    """Say whether compensation is worth it on this stage.

    Each measure is compared with the strongest baseline in it: of all that have neither a model of
    the iron nor a sensor for it, the one with the lowest.
    """
    if study.lost_in:
        return Judgement("unknown", f"the loop of '{OWN}' was lost: {'; '.join(study.lost_in)}")
    held = [name for name in _held(study) if METHODS[name].role == "baseline"]
    if not held:
        return Judgement("unknown", "every baseline lost the loop")
    return judge(OWN, _compared(study, held), "measures", STAGE)


def _compared(study: TrackingStudy, names: Sequence[MethodName]) -> list[ComparedFigure]:
    """Compare every measure with the lowest one of some variants."""
    compared = []
    for measure, title in _NAMES.items():
        of = {name: study.tried[name].of(measure) for name in names}
        best = min(of, key=lambda name: of[name].mean)
        compared.append(compare(title, best, study.tried[OWN].of(measure), of[best]))
    return compared


def memoryless(study: TrackingStudy) -> MethodName:
    """Return the variant without memory whose peak is the lowest."""
    methods: list[MethodName] = [*AT_BIAS, "single-valued"]
    tried = [name for name in methods if name in study.tried]
    held = [name for name in tried if name in _held(study)]
    return min(held or tried, key=lambda name: study.tried[name].of("peak_m").mean)


def _held(study: TrackingStudy) -> list[MethodName]:
    """Return the variants that were not lost on the test set-point."""
    return [name for name, one in study.tried.items() if not one.of("peak_m").lost]


def verdicts(study: TrackingStudy) -> dict[MethodName, Judgement]:
    """Compare with the best curve without memory, with what knows one play, and with the probe.

    What was lost is compared with nothing.
    """
    held = _held(study)
    if study.lost_in:
        return {}
    names: list[MethodName] = [memoryless(study)]
    names += [name for name in study.tried if name not in (OWN, *names, *AT_BIAS)]
    return {name: judged(study, name) for name in names if name in held}


def limits(study: TrackingStudy) -> list[str]:
    """Say what is gained with small forces, at a standstill and on one repeated set-point."""
    own, plain = study.tried[OWN], study.tried[memoryless(study)]
    name = memoryless(study)

    def against(mine: float, its: float, what: str) -> str:
        word = "nothing to gain" if mine >= its else f"{mine / its:.2g} of it"
        if its <= BANDS_M[-1]:
            word = f"little to gain: that is within {1e9 * BANDS_M[-1]:g} nm without it"
        return f"{what}: {1e9 * mine:.3g} nm against {1e9 * its:.3g} nm of '{name}', {word}"

    def peaks(one: TriedVariant) -> float:
        return one.small.peak_m

    return [
        against(peaks(own), peaks(plain), "A tenth of the forces, the same gains, peak"),
        against(own.standstill_m, plain.standstill_m, "Standstill, the long stroke moving, rms"),
        against(
            own.repeated.average_m,
            plain.repeated.average_m,
            "One set-point repeated, gains found on that very one, moving average",
        ),
    ]
