"""What keeps tuned gains from being better: aims, noise, force, voltage, delay, pinning."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from anhyst.rig.bearing.loop import Setup, SimulatedLoop
from anhyst.rig.bearing.scenario import steps_up_and_down
from anhyst.study.bearing.linear import CurrentLoop
from anhyst.study.bearing.responses import StepCell, compare, default_seeds, sweep
from anhyst.study.bearing.sensitivity import Sensitivity
from anhyst.study.tuning.aims import TITLES, Aims, Figures, text_of, worst_of
from anhyst.study.tuning.screen import Screen, make_screen, refine, spread_over
from anhyst.study.tuning.space import GainSpace
from anhyst.study.tuning.trial import Condition, check_frequencies, peak_of
from anhyst.support.jobs import all_of

Report = Callable[[float, float], None]

WORST = float("inf")


@dataclass(frozen=True)
class Check:
    """What gains reach over all noise seeds."""

    # means over the seeds, worst of all heights; all infinite where levitation was lost
    figures: dict[Condition, Figures]
    cells: tuple[StepCell, ...]  # every height with confidence intervals
    peaks: dict[Condition, float]  # frequency of the peak of the sensitivity, Hz
    seeds: int  # noise seeds behind every mean

    @property
    def worst(self) -> Figures:
        """The worst of each figure."""
        return worst_of(self.figures.values())

    def where(self, name: str) -> Condition:
        """Return the condition that is worst in a figure."""
        return max(self.figures, key=lambda each: float(getattr(self.figures[each], name)))

    def cell(self, name: str) -> StepCell:
        """Return the step that is worst in a figure of steps."""
        kept = [cell for cell in self.cells if cell.figures]
        return max(kept, key=lambda each: each.figures[name].mean)


def check(setup: Setup, conditions: Sequence[Condition], jobs: int | None = None) -> Check:
    """Run the steps of all conditions with every noise seed, and a fine swept sine at each."""
    seeds = default_seeds(setup.rig)
    heights = setup.rig.settings.step.heights_m
    gaps = list(dict.fromkeys(one.gap for one in conditions))
    loads = list(dict.fromkeys(one.load for one in conditions))
    cells = compare([setup], gaps, heights, loads, list(seeds), jobs=jobs)
    measured = all_of(partial(_sweep, setup), list(conditions), jobs=jobs)
    figures, peaks = {}, {}
    for condition, found in zip(conditions, measured, strict=True):
        mine = [cell for cell in cells if (cell.gap, cell.load) == (condition.gap, condition.load)]
        figures[condition] = _figures(mine, found)
        peaks[condition] = WORST if found is None else found.peak_frequency
    return Check(figures, tuple(cells), peaks, len(seeds))


def _sweep(setup: Setup, condition: Condition) -> Sensitivity | None:
    return sweep(setup, condition.gap, condition.load, check_frequencies(setup.rig), 0)


def _figures(cells: Sequence[StepCell], measured: Sensitivity | None) -> Figures:
    if measured is None or any(cell.lost or not cell.figures for cell in cells):
        return Figures(WORST, WORST, WORST, WORST, WORST)

    def worst(name: str) -> float:
        return max(cell.figures[name].mean for cell in cells)

    return Figures(
        overshoot_percent=worst("overshoot_percent"),
        settling_time_s=worst("settling_time_s"),
        peak_sensitivity=peak_of(measured),
        standstill_rms_m=worst("standstill_rms_m"),
        current_rate_rms_A_per_s=worst("current_rate_rms_A_per_s"),
    )


_NEAR = 0.9  # of a limit: from here on it is said to bind
_AT = 0.995  # of what there is: counts as all of it
_WORTH = 0.05  # of the settling time: less is not reported
_NOISES, _BAND = 3.0, 0.02  # standard deviations; of the smallest step


@dataclass(frozen=True)
class Limit:
    """One thing that limits."""

    # name of a figure of :class:`anhyst.study.tuning.aims.Figures`, or ``noise``, ``force``,
    # ``voltage``, ``current``, ``delay``, ``amplifier``, ``pinning``
    what: str
    text: str  # A sentence for a person, with numbers


def find_limits(
    setup: Setup,
    conditions: Sequence[Condition],
    aims: Aims,
    reached: Check,
    seed: int,
    jobs: int | None = None,
) -> list[Limit]:
    """Report what limits gains that were found and checked."""
    if not math.isfinite(reached.worst.settling_time_s):
        return [Limit("settling_time_s", "no gains settled within the hold at every condition")]
    found = [
        *_aims(aims, reached),
        *_noise(setup, reached),
        *_used_up(setup, conditions, seed, jobs),
    ]
    return [*found, *_would_help(setup, conditions, aims, seed, jobs)]


def _aims(aims: Aims, reached: Check) -> list[Limit]:
    """Aims that are missed or nearly so, and where."""
    found = []
    for name, limit in aims.limits.items():
        value = float(getattr(reached.worst, name))
        if value < _NEAR * limit:
            continue
        where = f"at {reached.where(name).text}"
        if name == "peak_sensitivity":
            where += f", around {reached.peaks[reached.where(name)]:.0f} Hz"
        else:
            where += f", step of {1e6 * reached.cell(name).height:g} um"
        _, factor, unit = TITLES[name]
        verb = "misses" if value > limit else "nearly takes"
        text = f"{text_of(name, value)} {verb} its limit of {factor * limit:g} {unit}".rstrip()
        found.append(Limit(name, f"{text} {where}"))
    return found


def _noise(setup: Setup, reached: Check) -> list[Limit]:
    """Noise of the sensor, where it fills much of the band in which a small step must stay."""
    height = min(setup.rig.settings.step.heights_m)
    rest = reached.worst.standstill_rms_m
    share = _NOISES * rest / (_BAND * height)
    if share < 0.5:
        return []
    kind = setup.rig.settings.gap_sensor.kind
    return [
        Limit(
            "noise",
            f"three times the standstill of {1e9 * rest:.0f} nm rms fill {100.0 * share:.0f} % of "
            f"the band in which a step of {1e6 * height:g} um must stay (position sensor: {kind})",
        )
    ]


def _used_up(
    setup: Setup, conditions: Sequence[Condition], seed: int, jobs: int | None
) -> list[Limit]:
    """Report what the steps use up: the force that is allowed, the supply, the current."""
    work = partial(_usage, setup, seed)
    usages = list(zip(conditions, all_of(work, list(conditions), jobs=jobs), strict=True))
    limits, amplifier = setup.controller.limits, setup.rig.settings.amplifier
    ends = {
        "force": f"the demand is at its limits of {limits.force_low_N:g} and "
        f"{limits.force_high_N:g} N",
        "voltage": f"the amplifier is at its supply of {amplifier.supply_V:g} V",
        "current": f"the current is at its limits of {limits.current_low_A:g} and "
        f"{limits.current_high_A:g} A",
    }
    found = []
    for what, text in ends.items():
        condition, seconds = max(
            ((one, usage[what]) for one, usage in usages), key=lambda each: each[1]
        )
        if seconds > 0.0:
            found.append(
                Limit(
                    what, f"{text} for up to {1e3 * seconds:.2g} ms of a step, at {condition.text}"
                )
            )
    return found


def _usage(setup: Setup, seed: int, condition: Condition) -> Mapping[str, float]:
    """Return for how long of a step each thing is used up, s."""
    rig, limits = setup.rig, setup.controller.limits
    heights = rig.settings.step.heights_m
    scenario = steps_up_and_down(rig, setup.controller, condition.gap, heights, condition.load)
    recording = SimulatedLoop(setup, seed).run(scenario)
    longest = {"force": 0.0, "voltage": 0.0, "current": 0.0}
    for step in scenario.steps:
        part = recording.part(step.begin, step.end)
        spare = (1.0 - _AT) * limits.force_high_N
        demand, current = part["demand_N"], part["command_A"]
        high, low = limits.current_high_A, limits.current_low_A
        at_end = {
            "force": (demand >= limits.force_high_N - spare)
            | (demand <= limits.force_low_N + spare),
            "voltage": np.abs(part["voltage_V"]) >= _AT * rig.settings.amplifier.supply,
            "current": (current >= _AT * high) | (current <= low + (1.0 - _AT) * high),
        }
        for what, ticks in at_end.items():
            longest[what] = max(longest[what], float(np.count_nonzero(ticks)) * rig.dt)
    return longest


def _would_help(
    setup: Setup, conditions: Sequence[Condition], aims: Aims, seed: int, jobs: int | None
) -> list[Limit]:
    """Tune linear loops again with one thing eased at a time."""
    screen = make_screen(setup, conditions)
    loops = screen.loops
    eased: dict[str, tuple[str, Screen, Aims]] = {
        "": ("", screen, aims),
        "peak_sensitivity": (
            f"a peak sensitivity of {1.5 * aims.peak_sensitivity:g}",
            screen,
            aims.tightened({"peak_sensitivity": 1.5}),
        ),
        "overshoot_percent": (
            f"an overshoot of {2.0 * aims.overshoot_percent:g} %",
            screen,
            aims.tightened({"overshoot_percent": 2.0}),
        ),
        "force": ("half as much force again for the largest step", screen.stronger(1.5), aims),
        "delay": (
            "half the delay from sample to current",
            screen.around(
                [
                    replace(one, chain=replace(one.chain, delay_ticks=0.5 * one.chain.delay_ticks))
                    for one in loops
                ]
            ),
            aims,
        ),
        "pinning": ("an iron without pinning", screen.of(range(0, len(loops), 2)), aims),
    }
    if isinstance(loops[0].amplifier, CurrentLoop):
        quick = [_quick(one.amplifier) for one in loops if isinstance(one.amplifier, CurrentLoop)]
        eased["amplifier"] = (
            "an amplifier of twice the bandwidth",
            screen.around(
                [replace(one, amplifier=two) for one, two in zip(loops, quick, strict=True)]
            ),
            aims,
        )
    work = partial(_least_settling, setup, seed)
    tasks = [(one, two) for _, one, two in eased.values()]
    times = dict(zip(eased, all_of(work, tasks, jobs=jobs), strict=True))
    base = times.pop("")
    if not math.isfinite(base):
        return []
    helps = sorted((time, what) for what, time in times.items() if time < (1.0 - _WORTH) * base)
    return [
        Limit(
            what,
            f"with {eased[what][0]} linear loops would settle in {1e3 * time:.2g} instead of "
            f"{1e3 * base:.2g} ms",
        )
        for time, what in helps
    ]


def _quick(amplifier: CurrentLoop) -> CurrentLoop:
    return CurrentLoop(gain=2.0 * amplifier.gain, reset=2.0 * amplifier.reset)


def _least_settling(setup: Setup, seed: int, eased: tuple[Screen, Aims]) -> float:
    """Return the settling time of the best gains for linear loops, s; infinite if none will do."""
    screen, aims = eased
    plant = setup.rig.settings
    space = GainSpace(plant.timing.rate_Hz, plant.body.mass_kg)
    places = spread_over(space.size, seed)
    best = refine(screen, space, setup.controller, aims, places, seed)
    found = screen.look(space.per_tick(best[None, :], setup.controller))
    cost = float(found.costs(aims, screen.horizon)[0])
    return cost if cost <= screen.horizon else math.inf
