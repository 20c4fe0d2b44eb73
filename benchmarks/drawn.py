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
from drawn_irons import Core, Iron, Job, Response, compute_responses
from rows import ROOT

DRAW_COUNT: int = SETTINGS["count"]

CYCLE_COUNT = 3
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
    evaluated_mask : ndarray of bool, shape (n,)
        Samples that are evaluated; False for the samples before the first of them.
    """

    kind: str
    input: FloatArray
    output: FloatArray
    schedule: FloatArray | None
    history: History
    evaluated_mask: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Draw:
    """One virtual measurement.

    Parameters
    ----------
    number : int
    family : str
    true_parameters : mapping of str to Any
        The sampled parameters.
    loops : Loops
        The measured loops.
    tests : tuple of Test
    """

    number: int
    family: str
    true_parameters: Mapping[str, Any]
    loops: Loops
    tests: tuple[Test, ...]


@dataclass(frozen=True, eq=False)
class _Record:
    """The reversal points before a record, its samples and its name."""

    kind: str
    label: str
    lead_points: tuple[float, ...]
    history: str  # settled, demagnetised or conditioned
    history_points: tuple[float, ...]
    current: FloatArray
    gap: FloatArray
    first_evaluated: int = 0  # first sample that counts


@dataclass(frozen=True, eq=False)
class _Plan:
    """A magnet, its iron and the paths of all records, before the responses are computed."""

    number: int
    family: str
    true_parameters: dict[str, Any]
    core: Core
    iron: Iron
    records: list[_Record]

    def jobs(self) -> list[Job]:
        """Return the paths of all records."""
        record_jobs = []
        for record in self.records:
            lead_points = np.array(record.lead_points)
            gap = np.concatenate([np.full(lead_points.size, record.gap[0]), record.gap])
            record_jobs.append(Job(self.iron, self.core, np.concatenate([lead_points, record.current]), gap))
        return record_jobs


def _size_core(magnet: dict[str, Any], true_iron: dict[str, Any]) -> tuple[Core, FloatArray]:
    """Choose the size of a magnet from the force at its smallest gap; return it and the gaps, m."""
    field = magnet["saturating"] * true_iron["knee_sharp"]
    density = true_iron["saturation_sharp"] * field / (field + true_iron["knee_sharp"])
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
    excitation = poles.iron_length * field + float(core.outer_reluctance(gaps)[0]) * area * density
    poles = replace(poles, turns=float(max(1.0, round(excitation / magnet["current_A"]))))
    magnet["current_A"] = excitation / poles.turns
    return replace(core, poles=poles), gaps


def _gaps(magnet: dict[str, Any], smallest_gap: float) -> FloatArray:
    count = magnet["gaps"]
    if count == 1:
        return np.array([smallest_gap])
    exponents = np.arange(count) / (count - 1.0)
    exponents[1:-1] += magnet["unevenness"] / (count - 1.0) * (-1.0) ** np.arange(count - 2)
    return np.asarray(smallest_gap * magnet["gap_range"] ** exponents)


def _sweep_samples(reversal_points: list[float], sample_step: float) -> FloatArray:
    """Return straight ramps between points, evenly sampled."""
    ramp_samples = [np.array(reversal_points[:1])]
    for start, end in pairwise(reversal_points):
        count = max(6, round(abs(end - start) / sample_step))
        ramp_samples.append(np.linspace(start, end, count + 1)[1:])
    return np.concatenate(ramp_samples)


def _sample_loop_limits(
    drive: dict[str, Any], is_ring: bool, largest_input: float, rng: np.random.Generator
) -> list[tuple[float, float]]:
    """Return the limits of the loops at every gap, the largest loop first."""
    is_bipolar = is_ring or drive["bipolar"]
    limits_list = [(-largest_input if is_bipolar else 0.0, largest_input)]
    for _ in range(drive["ring_loops" if is_ring else "loops"] - 1):
        loop_limits = from_ranges({name: SETTINGS["drive"][name] for name in
                       ("biased", "inner_size", "biased_low", "biased_high")}, rng)  # fmt: skip
        if loop_limits["biased"]:
            limits_list.append(
                (loop_limits["biased_low"] * largest_input, loop_limits["biased_high"] * largest_input)
            )
        else:
            amplitude = loop_limits["inner_size"] * largest_input
            limits_list.append((-amplitude if is_bipolar else 0.0, amplitude))
    return limits_list


def _measured_records(
    drive: dict[str, Any], ranges: list[tuple[float, float]], gap: float, rng: np.random.Generator
) -> list[_Record]:
    """Return the records of all loops at a gap."""
    initial_state, largest_range = drive["start"], ranges[0]
    current_step = (largest_range[1] - largest_range[0]) / drive["samples"]
    conditioning_points = (
        (*CYCLE_COUNT * largest_range, largest_range[0])
        if largest_range[0] < 0.0
        else (0.0, *CYCLE_COUNT * (largest_range[1], 0.0))
    )
    loop_records = []
    for loop_number, (low, high) in enumerate(ranges, start=1):
        history_points: tuple[float, ...] = ()
        if initial_state.startswith("settled"):
            history_points = (0.0, largest_range[1], 0.0) if initial_state == "settled-after-max" else ()
            cycle = _sweep_samples([low, high, low], current_step)
            reversal = int(rng.random() * (cycle.size - 1))
            lead_points = (*history_points, *CYCLE_COUNT * (low, high), low)
            lead_points += (
                (high, float(cycle[reversal])) if cycle.size <= 2 * reversal else (float(cycle[reversal]),)
            )
            current = np.concatenate([cycle[reversal:], cycle[1 : reversal + 1]])
        elif initial_state == "demagnetised":
            lead_points, current = (), _sweep_samples([low, high, low, high, low], current_step)
        else:
            lead_points, history_points = conditioning_points, conditioning_points
            current = _sweep_samples([low, high, low], current_step)
        loop_records.append(
            _Record(
                "",
                str(loop_number),
                lead_points,
                initial_state.split("-")[0],
                history_points,
                current,
                np.full(current.size, gap),
            )
        )
    return loop_records


def _test_records(
    plan: tuple[dict[str, Any], list[tuple[float, float]]], gaps: FloatArray, largest_current: float,
    rng: np.random.Generator,
) -> list[_Record]:  # fmt: skip
    """Return the test records; each starts after cycles of the whole range."""
    drive, ranges = plan
    tests, (low_limit, high_limit) = SETTINGS["tests"], ranges[0]
    current_step = (high_limit - low_limit) / tests["samples"]
    lead_points = (
        (*CYCLE_COUNT * (low_limit, high_limit), low_limit)
        if low_limit < 0.0
        else (0.0, *CYCLE_COUNT * (high_limit, 0.0))
    )
    intermediate_gaps = [
        float(np.sqrt(smaller_gap * larger_gap)) for smaller_gap, larger_gap in pairwise(gaps)
    ]
    tested_gaps = (
        [intermediate_gaps[0], intermediate_gaps[-1]] if len(intermediate_gaps) > 1 else intermediate_gaps
    )

    def make_record(kind: str, reversal_points: list[float], gap: float, first_evaluated: int = 0) -> _Record:
        current = _sweep_samples([lead_points[-1], *reversal_points], current_step)
        return _Record(kind, f"{kind}-{gap:.6g}", lead_points, "conditioned", lead_points, current,
                       np.full(current.size, gap), first_evaluated)  # fmt: skip

    def sample_reversals(count: int) -> list[float]:
        return [float(end) for end in low_limit + (high_limit - low_limit) * rng.random(count)]

    records = [make_record("other", sample_reversals(tests["turns"]), float(gaps[0]))]
    for gap in tested_gaps:
        records.append(make_record("unseen", sample_reversals(tests["turns"]), gap))
        records += [replace(record, kind="same") for record in _measured_records(drive, ranges, gap, rng)]
    amplitude = 0.5 * tests["small"] * largest_current
    for bias in tests["biases"]:
        bias_current, gap = bias * largest_current, float((tested_gaps or gaps)[-1])
        approach_count = _sweep_samples([lead_points[-1], bias_current - amplitude], current_step).size
        cycle_points = [
            bias_current - amplitude,
            *tests["small_cycles"] * [bias_current + amplitude, bias_current - amplitude],
        ]
        records.append(make_record("small", cycle_points, gap, approach_count))
    if gaps.size > 1:
        record = make_record("moving", sample_reversals(tests["moving_turns"]), float(gaps[0]))
        phase_step = 2.0 * np.pi * tests["moving_cycles"] / (record.current.size - 1.0)
        gap_fraction = 0.5 - 0.5 * np.cos(phase_step * np.arange(record.current.size))
        records.append(replace(record, gap=gaps[0] + (gaps[-1] - gaps[0]) * gap_fraction))
    return records


def _sample_plan(number: int) -> _Plan:
    rng = np.random.default_rng([SETTINGS["seed"], number])
    family = FAMILIES[number // 2 % len(FAMILIES)]
    magnet, drive, sensors = (from_ranges(SETTINGS[name], rng) for name in ("magnet", "drive", "sensors"))
    iron, true = draw_iron(family, rng)
    core, gaps = _size_core(magnet, true)
    largest_current = magnet["current_A"]
    ranges = _sample_loop_limits(drive, core.is_ring, largest_current, rng)
    records = [record for gap in gaps for record in _measured_records(drive, ranges, float(gap), rng)]
    records += _test_records((drive, ranges), gaps, largest_current, rng)
    sampled = {"iron": true, "magnet": magnet, "drive": drive, "sensors": sensors}
    return _Plan(number, family, sampled, core, iron, records)


def _hash() -> str:
    digest = hashlib.sha256()
    for pattern in _MADE_FROM:
        for path in sorted(ROOT.glob(pattern)):
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


@cache
def _compute_responses() -> tuple[list[_Plan], list[list[Response]]]:
    """Return all plans and the responses of their records, cached in ``build/``."""
    plans = [_sample_plan(number) for number in range(DRAW_COUNT)]
    sample_counts = [job.current.size for plan in plans for job in plan.jobs()]
    cache_file = ROOT / "build" / f"drawn-{_hash()}.npy"
    if cache_file.exists():
        response_table = np.load(cache_file)
    else:
        responses_by_plan = compute_responses([job for plan in plans for job in plan.jobs()])
        response_table = np.concatenate([np.stack(responses) for responses in responses_by_plan], axis=1)
        cache_file.parent.mkdir(exist_ok=True)
        np.save(cache_file, response_table)
    response_arrays = iter(np.split(response_table, np.cumsum(sample_counts)[:-1], axis=1))
    return plans, [[Response(*next(response_arrays)) for _ in plan.records] for plan in plans]


def draw(number: int) -> Draw:
    """Return a virtual measurement by its number, 0 to :data:`DRAW_COUNT` - 1."""
    plans, responses_by_plan = _compute_responses()
    return apply_sensors(
        plans[number], responses_by_plan[number], np.random.default_rng([SETTINGS["seed"], number, 1])
    )


def apply_sensors(plan: _Plan, responses: Sequence[Response], rng: np.random.Generator) -> Draw:
    """Apply the sensors of a plan to its responses."""
    sensors, magnet, ring = plan.true_parameters["sensors"], plan.true_parameters["magnet"], plan.core.is_ring
    is_field_loop = ring and magnet["ring_flux_density"]
    poles = plan.core.poles
    input_per_ampere = poles.turns / poles.iron_length if is_field_loop else 1.0
    outputs, spans = [], []
    for record, response in zip(plan.records, responses, strict=True):
        linkage, flux = (values[len(record.lead_points):] for values in response)  # fmt: skip
        output = linkage if ring else plan.core.magnet_force(flux, record.gap)
        outputs.append(output / (poles.turns * poles.area) if is_field_loop else output)
        spans.append(float(np.max(np.abs(outputs[-1]))) if not record.kind else 0.0)
    output_span, largest_input = max(spans), input_per_ampere * magnet["current_A"]
    offsets = (sensors["current_offset"] * largest_input * sensors["offsets"],
             sensors["output_offset"] * output_span * sensors["offsets"])  # fmt: skip
    noise = (sensors["current_noise"] * largest_input, sensors["noise"] * output_span)
    if sensors["noiseless"]:
        noise = (0.0, 0.0)
    loops, tests, start_time = [], [], 0.0
    for record, output in zip(plan.records, outputs, strict=True):
        true_input, output_reading = input_per_ampere * record.current + offsets[0], output + offsets[1]
        points = tuple(input_per_ampere * point + offsets[0] for point in record.history_points)
        history = History(record.history, points)  # type: ignore[arg-type]
        gap = None if ring else record.gap
        if record.kind:
            counted = np.arange(output_reading.size) >= record.first_evaluated
            if record.kind == "moving":
                history_gaps = (float(record.gap[0]),) * len(record.history_points)
                history = replace(history, schedule=history_gaps)
            tests.append(Test(record.kind, true_input, output_reading, gap, history, counted))
            continue
        input_readings = true_input + rng.normal(0.0, 1.0, output_reading.size) * noise[0]
        output_reading = output_reading + rng.normal(0.0, 1.0, output_reading.size) * noise[1]
        if sensors["bits"]:
            converter_step = (
                1.2 * largest_input * (2.0 if plan.true_parameters["drive"]["bipolar"] or ring else 1.0)
            )
            converter_step /= 2.0 ** sensors["bits"]
            input_readings = converter_step * np.round(input_readings / converter_step)
        time = (
            start_time + 0.01 * np.arange(output_reading.size)
            if plan.true_parameters["drive"]["clock"]
            else None
        )
        start_time += 0.01 * output_reading.size + 1.0
        loops.append(Loop(record.label, input_readings, output_reading, gap, time, history))
    names = ("field", "flux_density") if is_field_loop else ("current", "flux_linkage" if ring else "force")
    quantities = [QUANTITIES[name] for name in names]
    output_reading = Loops(tuple(loops), quantities[0], quantities[1], None if ring else QUANTITIES["gap"])
    return Draw(plan.number, plan.family, plan.true_parameters, output_reading, tuple(tests))


if __name__ == "__main__":
    for place in range(0, DRAW_COUNT, 2):
        shown = draw(place)
        facts = "; ".join(f"{name} {text}" for name, text in shown.loops.facts().items())
        start = shown.true_parameters["drive"]["start"]
        print(f"{place} {shown.family}, {start}: {facts}")
