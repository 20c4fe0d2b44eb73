"""Whether compensation is worth it on a stage, against which baseline, and where it is not."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from anhyst.compensate.interface import MethodName
from anhyst.compensate.methods import METHODS
from anhyst.rig.stage.loop import AT_BIAS
from anhyst.study.bearing.metrics import Interval
from anhyst.study.tracking.measures import BANDS_M
from anhyst.study.tracking.simulate import OWN, TrackingStudy, TriedVariant
from anhyst.support.pays import STAGE

_NAMES = {"peak_m": "peak", "average_m": "moving average", "settling_50_s": "settling to 50 nm"}


@dataclass(frozen=True)
class TrackingVerdict:
    """What one sentence says of one baseline."""

    baseline: MethodName
    ratios: Mapping[str, float]  # mean measure of the compensator over that of the baseline
    # every measure is lower by more than both intervals leave open, but for what the baseline
    # leaves nothing of
    better: bool

    @property
    def text(self) -> str:
        """One sentence."""
        parts = ", ".join(f"{_NAMES[name]} {value:.2g}" for name, value in self.ratios.items())
        word = "Worth it" if self.better else "Not worth it"
        return f"{word} against '{self.baseline}': {parts} of its"


def judged(study: TrackingStudy, baseline: MethodName) -> TrackingVerdict:
    """Compare the compensator with one baseline."""
    own, other = study.tried[OWN], study.tried[baseline]
    ratios = {
        name: own.of(name).mean / other.of(name).mean
        for name in _NAMES
        if other.of(name).mean > 0.0
    }
    better = all(_lower(own.of(name), other.of(name)) for name in _NAMES)
    return TrackingVerdict(baseline, ratios, better)


def _lower(own: Interval, other: Interval) -> bool:
    """Whether it certainly is, or there is nothing that could be lower."""
    if own.mean == other.mean == 0.0:
        return True
    return own.mean + own.half_width < other.mean - other.half_width


def verdict(study: TrackingStudy) -> tuple[bool, str]:
    """Say in one sentence whether compensation is worth it on this stage.

    Each measure is compared with the strongest baseline in it: of all that have neither a model of
    the iron nor a sensor for it, the one with the lowest.
    """
    own = study.tried[OWN]
    if study.lost_in:
        return False, f"None: the loop of '{OWN}' was lost: {'; '.join(study.lost_in)}"
    held = [name for name in _held(study) if METHODS[name].role == "baseline"]
    if not held:
        return False, "None: every baseline lost the loop"
    gained, missed = [], []
    for measure, title in _NAMES.items():
        best = min(held, key=lambda name: study.tried[name].of(measure).mean)
        mine, its = own.of(measure), study.tried[best].of(measure)
        share = f"{mine.mean / its.mean:.2g}" if its.mean > 0.0 else "more than nothing"
        if _lower(mine, its):
            gained.append(f"{title} {share} of '{best}'" if its.mean > 0.0 else f"{title} 0")
        else:
            missed.append(f"{title} {share} of '{best}'")
    if missed:
        return False, (
            f"Not worth it here: not certainly below the strongest baseline: {', '.join(missed)}"
            + (f"; below it: {', '.join(gained)}" if gained else "")
            + f"; {STAGE}"
        )
    return True, f"Worth it here, against the strongest baseline in each: {', '.join(gained)}"


def memoryless(study: TrackingStudy) -> MethodName:
    """Return the variant without memory whose peak is the lowest."""
    found: list[MethodName] = [*AT_BIAS, "single-valued"]
    tried = [name for name in found if name in study.tried]
    held = [name for name in tried if name in _held(study)]
    return min(held or tried, key=lambda name: study.tried[name].of("peak_m").mean)


def _held(study: TrackingStudy) -> list[MethodName]:
    """Return the variants that were not lost on the test set-point."""
    return [name for name, one in study.tried.items() if not one.of("peak_m").lost]


def verdicts(study: TrackingStudy) -> list[TrackingVerdict]:
    """Compare with the best curve without memory, with what knows one play, and with the probe.

    What was lost is compared with nothing.
    """
    held = _held(study)
    if study.lost_in:
        return []
    names: list[MethodName] = [memoryless(study)]
    names += [name for name in study.tried if name not in (OWN, *names, *AT_BIAS)]
    return [judged(study, name) for name in names if name in held]


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
