"""Find the best fits of each law and gap map to the random measurements, from random starts.

For each law and gap map, 64 random starts are sampled without knowledge of other fits. The
parameters of the law and its largest effective field are log-uniform; the parameters of the circuit
are scanned gap by gap. All starts descend a few steps on few samples, and the better ones take some
more steps. The best eight continue on more samples until they converge or reach a step limit, the
best three of these on all samples.

    nice python benchmarks/known.py 0-39 60    missing fits of these draws, for up to 60 minutes

``known_best.json`` is written after each fit, and a further run continues from it. For each law and
map it contains:

- ``numbers``: number of fitted parameters
- ``rms``: deviation from all loops, % of the largest output
- ``near``: how many of the eight reached a deviation within 2 % of the best
- ``usable``: whether the model passes the checks of identification; the best usable fit is stored

``through`` is the last stage for which all laws and maps of a draw are complete.
"""

from __future__ import annotations

import json
import os
import sys
import time
import warnings
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from anhyst.data import Loops
from anhyst.data.output_map import is_electromagnet
from anhyst.identification.cell_kernel import LAW_BY_SHAPE, CellKernel
from anhyst.identification.default_search import FoundModel, descend_from
from anhyst.identification.fit_records import FitRecords, make_fit_records, read_rest_offsets
from anhyst.identification.model_building import make_model, make_response_form, valid_range
from anhyst.identification.objective import CellResponder
from anhyst.identification.response import ParameterSet, Responder, ResponseForm
from anhyst.identification.space import CoordinateSpace
from anhyst.identification.uncertainty import OFFSET_NAMES
from anhyst.laws import DEFAULT_LAW, LAWS
from anhyst.laws.cells import Shape
from anhyst.model.actuator import find_compile_obstacle
from anhyst.support.atomic import atomic_writer
from anhyst.support.errors import InputError, NegativeResult, NoResponseError
from anhyst.support.numeric import FloatArray
from drawn import draw
from drawn_families import SETTINGS
from search import KNOWN_FILE, loops_rms

STAGES: dict[int, tuple[tuple[Shape, int], ...]] = {
    1: (("tanh", 1), ("tanh", 2)),
    2: (("langevin", 1), ("langevin", 2)),
    3: (("tanh", 3), ("langevin", 3)),
}
"""Play-cell laws of each stage by curve and populations; stage 1 includes Jiles-Atherton."""

START_COUNT, RANKED_STARTS, FINE_STARTS, FINAL_STARTS = 64, 24, 8, 3
COARSE_SAMPLES, FINE_SAMPLES = 40, 100
"""Samples per loop for the first descents, and for the descents of the best starts."""

_FIRST_STEPS, _COARSE_STEPS, _FINE_STEPS, _FINAL_STEPS = 4, 8, 80, 30
_SCAN_POINTS = 24
_TRIES = 30
_NEAR_RATIO = 1.02

_LAW_RANGES = {
    "kappa": (0.01, 10.0),
    "c": (0.0, 0.95),
    "share": (0.03, 3.0),
    "width": (0.1, 10.0),
    "pinning": (0.01, 10.0),
    "spread": (0.5, 6.0),
}
"""Ranges of the law's parameters, by the first part of their names; log-uniform except ``c``."""

_MAX_FIELD_RANGE = (0.5, 40.0)
"""Range of the largest effective field, in units of the law."""

_OMEGA_RANGE = (0.02, 500.0)
_SCALE_RATIOS = np.geomspace(0.2, 5.0, _SCAN_POINTS)

Known = dict[str, float | bool]


@dataclass(frozen=True)
class Target:
    """A law with a gap map."""

    gap_map: str
    response_form: ResponseForm

    @property
    def name(self) -> str:
        """The name of the target in the file."""
        cells = self.response_form.cells
        count = f"-{cells.population_count}" if isinstance(cells, CellKernel) else ""
        return f"{self.gap_map}/{self.response_form.law}{count}"


def list_targets(loops: Loops, stage: int) -> Iterator[Target]:
    """Yield the laws and maps of a stage that identification compares, the cheapest first."""
    gaps = len(loops.schedule_values)
    gap_maps = ["none"] if gaps < 2 else ["reluctance", "circuit", "scaling"]
    if gaps == 2:
        gap_maps.remove("circuit")
    first_form = make_response_form(loops.input, loops.output, DEFAULT_LAW)
    response_forms = [first_form] if stage == 1 else []
    for curve_name, count in STAGES[stage]:
        law = LAW_BY_SHAPE[curve_name]
        if LAWS[law].least_slope or not is_electromagnet(loops):
            response_forms.append(replace(first_form, law=law, cells=CellKernel(curve_name, count)))
    return (Target(gap_map, response_form) for response_form in response_forms for gap_map in gap_maps)


def unit_gain_output(
    response_form: ResponseForm, local: ParameterSet, records: FitRecords
) -> FloatArray | None:
    """Return the output for a gain of 1 at a single gap; None if the law has no solution."""
    responder = CellResponder() if response_form.cells else Responder()
    unit_gain_set = replace(local, gain=1.0, out_0=0.0)
    try:
        return np.concatenate(responder.outputs(response_form, [unit_gain_set], records.loops))
    except NoResponseError:
        return None


class Scan:
    """Searches the circuit parameters at one gap for given parameters of the law."""

    def __init__(self, response_form: ResponseForm, records: FitRecords) -> None:
        self.response_form, self.records = response_form, records
        weights = [np.full(record.output.size, record.weight) for record in records.loops]
        self.weights = np.concatenate(weights)
        self.output = np.concatenate([record.output for record in records.loops])

    def find_best(
        self, candidates: Sequence[ParameterSet], gain: float | None
    ) -> tuple[ParameterSet, float] | None:
        """Return the set with the lowest cost, and this cost; fit the gain unless it is given."""
        best_set: tuple[ParameterSet, float] | None = None
        for local in candidates:
            unit_output = unit_gain_output(self.response_form, local, self.records)
            if unit_output is None:
                continue
            weighted_response, weighted_output = unit_output * self.weights, self.output * self.weights
            set_gain = gain or float(weighted_response @ weighted_output) / max(
                float(weighted_response @ weighted_response), 1e-300
            )
            cost = float(np.sum((set_gain * weighted_response - weighted_output) ** 2))
            if set_gain > 0.0 and (best_set is None or cost < best_set[1]):
                best_set = replace(local, gain=set_gain), cost
        return best_set


def random_start(space: CoordinateSpace, rng: np.random.Generator) -> FloatArray | None:
    """Sample a start; None if the law has no solution for any sampled parameter set."""
    response_form, records = space.form, space.records
    reference_gap = records.reference_gap
    scans = [Scan(response_form, records.at_gap(gap)) for gap in range(records.gap_count)]
    for _ in range(_TRIES):
        law = tuple(
            _sample_parameter(parameter.name, rng) for parameter in response_form.kernel.fit_parameters
        )
        low, high = _MAX_FIELD_RANGE
        max_field = low * (high / low) ** rng.random()
        share_sum = 1.0 + sum(
            share
            for parameter, share in zip(response_form.kernel.fit_parameters, law, strict=True)
            if parameter.name.startswith("share")
        )
        reference_set = scans[reference_gap].find_best(
            _sets_at_reference_gap(space, law, max_field, share_sum), None
        )
        if reference_set is None:
            continue
        gap_sets = []
        for gap, scan in enumerate(scans):
            gap_set = (
                reference_set
                if gap == reference_gap
                else scan.find_best(*_sets_at_another_gap(space, reference_set[0]))
            )
            if gap_set is None:
                break
            gap_sets.append(gap_set[0])
        else:
            return space.pack(
                [
                    response_form.make_set([*response_form.named_values(parameter_set).values()])
                    for parameter_set in gap_sets
                ]
            )
    return None


def _sample_parameter(name: str, rng: np.random.Generator) -> float:
    low, high = _LAW_RANGES[name.split("_", maxsplit=1)[0]]
    fraction = float(rng.random())
    return low + (high - low) * fraction if low == 0.0 else float(low * (high / low) ** fraction)


def _sets_at_reference_gap(
    space: CoordinateSpace, law: tuple[float, ...], max_field: float, share_sum: float
) -> list[ParameterSet]:
    """Return sets of one law with several reluctances and the same largest effective field."""
    input_span, magnetisation = space.records.input_span, share_sum * max_field / (1.0 + max_field)
    omegas = [0.0, *np.geomspace(*_OMEGA_RANGE, _SCAN_POINTS)]
    parameter_sets = [ParameterSet(law, omega, input_span / (max_field + omega * magnetisation), 1.0, 0.0, 0.0, 0.0)
             for omega in omegas]  # fmt: skip
    parameter_sets += [replace(parameter_sets[0], omega=omega / share_sum) for omega in (-0.3, -0.7)]
    # h follows from scale and gain if field and flux density are measured.
    return [
        replace(parameter_set, h=0.0 if space.form.permeability else space.form.h)
        for parameter_set in parameter_sets
    ]


def _sets_at_another_gap(
    space: CoordinateSpace, reference_set: ParameterSet
) -> tuple[list[ParameterSet], float | None]:
    """Return the sets that the map allows at another gap, and the gain if it is common."""
    if space.gap_map == "scaling":
        return [
            replace(reference_set, scale=ratio * reference_set.scale) for ratio in _SCALE_RATIOS
        ], reference_set.gain
    unscaled = reference_set.scale * (1.0 - reference_set.h * reference_set.omega)
    omegas = [max(reference_set.omega, 0.05) * ratio**2 for ratio in _SCALE_RATIOS]
    candidates = [replace(reference_set, omega=omega, scale=unscaled / max(1.0 - reference_set.h * omega, 0.05))
            for omega in omegas]  # fmt: skip
    return candidates, None if space.gap_map == "circuit" else reference_set.gain


def find_best_known(target: Target, loops: Loops, draw_number: int) -> dict[str, Known | None]:
    """Fit a law and map from random starts, then without offsets; None if there is no solution."""
    records = make_fit_records(loops, "loops", read_rest_offsets(loops))
    common = OFFSET_NAMES if target.gap_map == "circuit" else frozenset()
    full_records = CoordinateSpace(target.gap_map, records, target.response_form, common=common)
    coarse, fine = (
        replace(full_records, records=records.thinned(max_samples))
        for max_samples in (COARSE_SAMPLES, FINE_SAMPLES)
    )
    rng = np.random.default_rng([SETTINGS["seed"], draw_number, zlib.crc32(target.name.encode())])
    starts = [random_start(coarse, rng) for _ in range(START_COUNT)]
    first_fits = [descend_from(coarse, start, 1e-4, _FIRST_STEPS) for start in starts if start is not None]
    if not first_fits:
        return {target.name: None}
    first_fits.sort(key=lambda fit: fit.cost)
    ranked_fits = [descend_from(coarse, fit.theta, 1e-4, _COARSE_STEPS) for fit in first_fits[:RANKED_STARTS]]
    ranked_fits.sort(key=lambda fit: fit.cost)
    best_fits = [descend_from(fine, fit.theta, 1e-6, _FINE_STEPS) for fit in ranked_fits[:FINE_STARTS]]
    best_fits.sort(key=lambda fit: fit.cost)
    near_count = sum(bool(fit.cost <= _NEAR_RATIO**2 * best_fits[0].cost) for fit in best_fits)
    final_fits = [
        descend_from(full_records, fit.theta, 1e-7, _FINAL_STEPS) for fit in best_fits[:FINAL_STARTS]
    ]
    space_without_offsets, kept_coordinates = full_records.with_fixed(OFFSET_NAMES)
    final_fits_without_offsets = [
        descend_from(space_without_offsets, fit.theta[kept_coordinates], 1e-7, _FINAL_STEPS)
        for fit in final_fits
    ]
    return {
        target.name: find_best_fit(final_fits, loops, near_count),
        f"{target.name}/no offsets": find_best_fit(final_fits_without_offsets, loops, near_count),
    }


def find_best_fit(fits: Sequence[FoundModel], loops: Loops, near_count: int) -> Known | None:
    """Return the best fit in the form of the file; usable fits are preferred."""
    ranked_fits = []
    for fit in fits:
        try:
            rms = 100.0 * loops_rms(make_model(fit, loops), loops)
        except (InputError, NegativeResult):
            continue
        ranked_fits.append((not is_usable(fit, loops), rms, fit.theta.size))
    if not ranked_fits:
        return None
    is_unusable, rms, parameter_count = min(ranked_fits)
    return {
        "numbers": parameter_count,
        "rms": float(f"{rms:.5g}"),
        "near": near_count,
        "usable": not is_unusable,
    }


def is_usable(fit: FoundModel, loops: Loops) -> bool:
    """Whether identification could choose a fit: it compiles and does not fail acceptance."""
    model = replace(make_model(fit, loops), valid=valid_range(loops))
    if is_electromagnet(loops) and find_compile_obstacle(model) is not None:
        return False
    return model.acceptance().passed is not False


def main(arguments: Sequence[str]) -> None:
    """Run missing fits of some draws for some minutes, expensive laws and odd draws last."""
    warnings.simplefilter("ignore")
    first_draw, last_draw = (int(end) for end in arguments[0].split("-"))
    deadline = time.monotonic() + 60.0 * float(arguments[1])
    known_fits = json.loads(KNOWN_FILE.read_text(encoding="utf-8")) if KNOWN_FILE.exists() else {"draws": {}}
    for stage in STAGES:
        for number in sorted(range(first_draw, last_draw + 1), key=lambda draw_number: draw_number % 2):
            loops = draw(number).loops
            draws = known_fits["draws"]
            finished_stage = draws.setdefault(str(number), {"through": 0, "fits": {}})
            fits = finished_stage["fits"]
            for target in list_targets(loops, stage):
                if time.monotonic() > deadline:
                    return
                if target.name not in fits:
                    fits |= find_best_known(target, loops, number)
                    write_known_fits(known_fits)
            finished_stage["through"] = max(stage, finished_stage["through"])
            write_known_fits(known_fits)
            print(f"known: draw {number}, stage {stage}", flush=True)


def write_known_fits(known_fits: dict[str, Any]) -> None:
    """Write the file with one line for each law and map, so that its changes can be reviewed."""
    lines = []
    for number, draw_fits in sorted(known_fits["draws"].items(), key=lambda item: int(item[0])):
        rows = [f"  {json.dumps(name)}: {json.dumps(fit)}" for name, fit in draw_fits["fits"].items()]
        file_text = f'"{number}": {{"through": {draw_fits["through"]}, "fits": {{'
        lines.append(f" {file_text}\n" + ",\n".join(rows) + "\n }}")
    with atomic_writer(KNOWN_FILE) as file:  # a search may read the file at the same time
        file.write('{"draws": {\n' + ",\n".join(lines) + "\n}}\n")


if __name__ == "__main__":
    main(sys.argv[1:])
