"""Generate 200 random virtual measurements of magnets and rings, and noise-free test records.

``drawn.toml`` defines ranges and seed, ``drawn_irons.py`` the six families of iron.
``draw(number)`` returns one measurement. All measurements are computed together and cached in
``build/`` under a hash of their sources. ``python benchmarks/drawn.py`` lists those with an even
number.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from anhyst.data import Loop, Loops
from anhyst.data.path import History
from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0, QUANTITIES
from anhyst_rigs.rig.parts.magnet import Poles
from drawn_families import FAMILIES, SETTINGS, draw_iron, from_ranges
from drawn_irons import Answer, Core, Iron, Job, answers
from rows import ROOT

COUNT: int = SETTINGS["count"]

CYCLES = 3
"""Number of cycles before a record, of the whole range or of the recorded loop."""

_MADE_FROM = ("benchmarks/drawn*", "plant/**/*.[ch]", "packages/anhyst-rigs/src/anhyst_rigs/rig/parts/*.py")


@dataclass(frozen=True, eq=False)
class Test:
    """A record for testing a model: sensor readings without noise.

    Parameters
    ----------
    kind : str
        ``same``: the fitted loops at a gap between; ``unseen``: random reversals at that gap;
        ``moving``: random reversals while the gap moves; ``small``: small cycles about a bias;
        ``other``: random reversals at measured gaps.
    input, output : ndarray, shape (n,)
        Input and output, SI units.
    schedule : ndarray, shape (n,), or None
        Gap, m.
    history : History
    counted : ndarray of bool, shape (n,)
        Samples that are evaluated; False for the samples before the first of them.
    """

    kind: str
    input: FloatArray
    output: FloatArray
    schedule: FloatArray | None
    history: History
    counted: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Draw:
    """One virtual measurement.

    Parameters
    ----------
    number : int
    family : str
    true : mapping of str to Any
        The sampled parameters.
    loops : Loops
        The measured loops.
    tests : tuple of Test
    """

    number: int
    family: str
    true: Mapping[str, Any]
    loops: Loops
    tests: tuple[Test, ...]


@dataclass(frozen=True, eq=False)
class _Record:
    """The reversal points before a record, its samples and its name."""

    kind: str
    label: str
    lead: tuple[float, ...]
    history: str  # settled, demagnetised or conditioned
    stated: tuple[float, ...]
    current: FloatArray
    gap: FloatArray
    since: int = 0  # first sample that counts


@dataclass(frozen=True, eq=False)
class _Plan:
    """A magnet, its iron and the paths of all records, before the responses are computed."""

    number: int
    family: str
    true: dict[str, Any]
    core: Core
    iron: Iron
    records: list[_Record]

    def jobs(self) -> list[Job]:
        """Return the paths of all records."""
        found = []
        for record in self.records:
            lead = np.array(record.lead)
            gap = np.concatenate([np.full(lead.size, record.gap[0]), record.gap])
            found.append(Job(self.iron, self.core, np.concatenate([lead, record.current]), gap))
        return found


def _size_core(magnet: dict[str, Any], true: dict[str, Any]) -> tuple[Core, FloatArray]:
    """Choose the size of a magnet from the force at its smallest gap; return it and the gaps, m."""
    field = magnet["saturating"] * true["knee_sharp"]
    density = true["saturation_sharp"] * field / (field + true["knee_sharp"])
    area = magnet["force_N"] * MU_0 / density**2
    width = float(np.sqrt(area / magnet["aspect"]))
    smallest_gap = magnet["smallest_gap"] * width
    gaps = np.zeros(1) if magnet["ring"] else _gaps(magnet, smallest_gap)
    permeance = 0.5 * MU_0 * area / smallest_gap
    poles = Poles(
        turns=1.0,
        resistance=1.0,
        width=width,
        depth=area / width,
        leakage=magnet["leakage"] * permeance,
        iron_length=magnet["iron_length"] * width,
        joints=magnet["joints"] * smallest_gap,
    )
    core = Core(poles, magnet["ring"])
    excitation = poles.iron_length * field + float(core.outer(gaps)[0]) * area * density
    poles = replace(poles, turns=float(max(1.0, round(excitation / magnet["current_A"]))))
    magnet["current_A"] = excitation / poles.turns
    return replace(core, poles=poles), gaps


def _gaps(magnet: dict[str, Any], smallest_gap: float) -> FloatArray:
    count = magnet["gaps"]
    if count == 1:
        return np.array([smallest_gap])
    places = np.arange(count) / (count - 1.0)
    places[1:-1] += magnet["unevenness"] / (count - 1.0) * (-1.0) ** np.arange(count - 2)
    return np.asarray(smallest_gap * magnet["gap_range"] ** places)


def _sweep_samples(ends: list[float], step: float) -> FloatArray:
    """Return straight ramps between points, evenly sampled."""
    parts = [np.array(ends[:1])]
    for start, end in pairwise(ends):
        count = max(6, round(abs(end - start) / step))
        parts.append(np.linspace(start, end, count + 1)[1:])
    return np.concatenate(parts)


def _ranges(
    drive: dict[str, Any], ring: bool, top: float, rng: np.random.Generator
) -> list[tuple[float, float]]:
    """Return the limits of the loops at every gap, the largest loop first."""
    is_bipolar = ring or drive["bipolar"]
    found = [(-top if is_bipolar else 0.0, top)]
    for _ in range(drive["ring_loops" if ring else "loops"] - 1):
        loop_limits = from_ranges({name: SETTINGS["drive"][name] for name in
                       ("biased", "inner_size", "biased_low", "biased_high")}, rng)  # fmt: skip
        if loop_limits["biased"]:
            found.append((loop_limits["biased_low"] * top, loop_limits["biased_high"] * top))
        else:
            size = loop_limits["inner_size"] * top
            found.append((-size if is_bipolar else 0.0, size))
    return found


def _measured_records(
    drive: dict[str, Any], ranges: list[tuple[float, float]], gap: float, rng: np.random.Generator
) -> list[_Record]:
    """Return the records of all loops at a gap."""
    start, whole = drive["start"], ranges[0]
    step = (whole[1] - whole[0]) / drive["samples"]
    all_of_it = (*CYCLES * whole, whole[0]) if whole[0] < 0.0 else (0.0, *CYCLES * (whole[1], 0.0))
    found = []
    for number, (low, high) in enumerate(ranges, start=1):
        stated: tuple[float, ...] = ()
        if start.startswith("settled"):
            stated = (0.0, whole[1], 0.0) if start == "settled-after-max" else ()
            cycle = _sweep_samples([low, high, low], step)
            reversal = int(rng.random() * (cycle.size - 1))
            lead = (*stated, *CYCLES * (low, high), low)
            lead += (
                (high, float(cycle[reversal])) if cycle.size <= 2 * reversal else (float(cycle[reversal]),)
            )
            current = np.concatenate([cycle[reversal:], cycle[1 : reversal + 1]])
        elif start == "demagnetised":
            lead, current = (), _sweep_samples([low, high, low, high, low], step)
        else:
            lead, stated = all_of_it, all_of_it
            current = _sweep_samples([low, high, low], step)
        found.append(
            _Record("", str(number), lead, start.split("-")[0], stated, current, np.full(current.size, gap))
        )
    return found


def _test_records(
    plan: tuple[dict[str, Any], list[tuple[float, float]]], gaps: FloatArray, top: float,
    rng: np.random.Generator,
) -> list[_Record]:  # fmt: skip
    """Return the test records; each starts after cycles of the whole range."""
    drive, ranges = plan
    tests, (low, high) = SETTINGS["tests"], ranges[0]
    step = (high - low) / tests["samples"]
    lead = (*CYCLES * (low, high), low) if low < 0.0 else (0.0, *CYCLES * (high, 0.0))
    between = [float(np.sqrt(one * test_gaps)) for one, test_gaps in pairwise(gaps)]
    test_gap = [between[0], between[-1]] if len(between) > 1 else between

    def path(kind: str, ends: list[float], gap: float, since: int = 0) -> _Record:
        current = _sweep_samples([lead[-1], *ends], step)
        return _Record(kind, f"{kind}-{gap:.6g}", lead, "conditioned", lead, current,
                       np.full(current.size, gap), since)  # fmt: skip

    def reversals(count: int) -> list[float]:
        return [float(end) for end in low + (high - low) * rng.random(count)]

    found = [path("other", reversals(tests["turns"]), float(gaps[0]))]
    for gap in test_gap:
        found.append(path("unseen", reversals(tests["turns"]), gap))
        found += [replace(record, kind="same") for record in _measured_records(drive, ranges, gap, rng)]
    swing = 0.5 * tests["small"] * top
    for bias in tests["biases"]:
        middle_gap, gap = bias * top, float((test_gap or gaps)[-1])
        there = _sweep_samples([lead[-1], middle_gap - swing], step).size
        ends = [middle_gap - swing, *tests["small_cycles"] * [middle_gap + swing, middle_gap - swing]]
        found.append(path("small", ends, gap, there))
    if gaps.size > 1:
        record = path("moving", reversals(tests["moving_turns"]), float(gaps[0]))
        turn = 2.0 * np.pi * tests["moving_cycles"] / (record.current.size - 1.0)
        part = 0.5 - 0.5 * np.cos(turn * np.arange(record.current.size))
        found.append(replace(record, gap=gaps[0] + (gaps[-1] - gaps[0]) * part))
    return found


def _sample_plan(number: int) -> _Plan:
    rng = np.random.default_rng([SETTINGS["seed"], number])
    family = FAMILIES[number // 2 % len(FAMILIES)]
    magnet, drive, sensors = (from_ranges(SETTINGS[name], rng) for name in ("magnet", "drive", "sensors"))
    iron, true = draw_iron(family, rng)
    core, gaps = _size_core(magnet, true)
    top = magnet["current_A"]
    ranges = _ranges(drive, core.ring, top, rng)
    records = [record for gap in gaps for record in _measured_records(drive, ranges, float(gap), rng)]
    records += _test_records((drive, ranges), gaps, top, rng)
    sampled = {"iron": true, "magnet": magnet, "drive": drive, "sensors": sensors}
    return _Plan(number, family, sampled, core, iron, records)


def _hash() -> str:
    digest = hashlib.sha256()
    for pattern in _MADE_FROM:
        for path in sorted(ROOT.glob(pattern)):
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


@cache
def _compute_responses() -> tuple[list[_Plan], list[list[Answer]]]:
    """Return all plans and the responses of their records, cached in ``build/``."""
    plans = [_sample_plan(number) for number in range(COUNT)]
    sizes = [job.current.size for plan in plans for job in plan.jobs()]
    cache_file = ROOT / "build" / f"drawn-{_hash()}.npy"
    if cache_file.exists():
        all_jobs = np.load(cache_file)
    else:
        found = answers([job for plan in plans for job in plan.jobs()])
        all_jobs = np.concatenate([np.stack(responses) for responses in found], axis=1)
        cache_file.parent.mkdir(exist_ok=True)
        np.save(cache_file, all_jobs)
    pieces = iter(np.split(all_jobs, np.cumsum(sizes)[:-1], axis=1))
    return plans, [[Answer(*next(pieces)) for _ in plan.records] for plan in plans]


def draw(number: int) -> Draw:
    """Return a virtual measurement by its number, 0 to :data:`COUNT` - 1."""
    plans, found = _compute_responses()
    return measured(plans[number], found[number], np.random.default_rng([SETTINGS["seed"], number, 1]))


def measured(plan: _Plan, found: Sequence[Answer], rng: np.random.Generator) -> Draw:
    """Apply the sensors of a plan to its responses."""
    sensors, magnet, ring = plan.true["sensors"], plan.true["magnet"], plan.core.ring
    field = ring and magnet["ring_flux_density"]
    poles = plan.core.poles
    unit = poles.turns / poles.iron_length if field else 1.0  # input per ampere
    outputs, spans = [], []
    for record, answer in zip(plan.records, found, strict=True):
        linkage, flux = (values[len(record.lead):] for values in answer)  # fmt: skip
        output = linkage if ring else plan.core.pull(flux, record.gap)
        outputs.append(output / (poles.turns * poles.area) if field else output)
        spans.append(float(np.max(np.abs(outputs[-1]))) if not record.kind else 0.0)
    span, top = max(spans), unit * magnet["current_A"]
    zeros = (sensors["current_offset"] * top * sensors["offsets"],
             sensors["output_offset"] * span * sensors["offsets"])  # fmt: skip
    noise = (sensors["current_noise"] * top, sensors["noise"] * span)
    if sensors["noiseless"]:
        noise = (0.0, 0.0)
    loops, tests, clock = [], [], 0.0
    for record, output in zip(plan.records, outputs, strict=True):
        true_input, read = unit * record.current + zeros[0], output + zeros[1]
        history = History(record.history, tuple(unit * point + zeros[0] for point in record.stated))  # type: ignore[arg-type]
        gap = None if ring else record.gap
        if record.kind:
            counted = np.arange(read.size) >= record.since
            if record.kind == "moving":
                loop_samples = (float(record.gap[0]),) * len(record.stated)
                history = replace(history, schedule=loop_samples)
            tests.append(Test(record.kind, true_input, read, gap, history, counted))
            continue
        readings = true_input + rng.normal(0.0, 1.0, read.size) * noise[0]
        read = read + rng.normal(0.0, 1.0, read.size) * noise[1]
        if sensors["bits"]:
            step = 1.2 * top * (2.0 if plan.true["drive"]["bipolar"] or ring else 1.0)
            step /= 2.0 ** sensors["bits"]
            readings = step * np.round(readings / step)
        time = clock + 0.01 * np.arange(read.size) if plan.true["drive"]["clock"] else None
        clock += 0.01 * read.size + 1.0
        loops.append(Loop(record.label, readings, read, gap, time, history))
    names = ("field", "flux_density") if field else ("current", "flux_linkage" if ring else "force")
    quantities = [QUANTITIES[name] for name in names]
    read = Loops(tuple(loops), quantities[0], quantities[1], None if ring else QUANTITIES["gap"])
    return Draw(plan.number, plan.family, plan.true, read, tuple(tests))


if __name__ == "__main__":
    for place in range(0, COUNT, 2):
        shown = draw(place)
        facts = "; ".join(f"{name} {text}" for name, text in shown.loops.facts().items())
        start = shown.true["drive"]["start"]
        print(f"{place} {shown.family}, {start}: {facts}")
