"""Many plants that have drifted away from what their controller was made for: Monte Carlo."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field, ValidationError

from anhyst.compensate.interface import MethodName
from anhyst.control.controller_file import ControllerFile
from anhyst.rig.bearing.file import BearingRig
from anhyst.rig.bearing.loop import Setup, SimulatedLoop, lost_at
from anhyst.rig.bearing.make_setup import make_setups
from anhyst.rig.bearing.scenario import Scenario, steps_up_and_down
from anhyst.rig.recording import Recording
from anhyst.study.bearing.drift import Drift, draw_drift, drifted_bearing, drifted_rig
from anhyst.study.bearing.metrics import step_figures
from anhyst.study.bearing.ready import make_ready
from anhyst.study.bearing.responses import position_resolution
from anhyst.support.atomic import PathLike
from anhyst.support.errors import Interrupted
from anhyst.support.jobs import each
from anhyst.support.progress import Progress
from anhyst.support.resuming import ResultsFile
from anhyst.support.toml_file import NotNegative, Number, Table, explain
from anhyst.support.version import running_version


class VariantRow(Table):
    """What a plant did behind one controller; nothing but ``lost_s`` where it was lost."""

    lost_s: NotNegative | None
    overshoot_percent: list[NotNegative] | None = None
    settling_s: list[NotNegative | None] | None = None
    standstill_rms_m: NotNegative | None = None


class PlantRow(Table):
    """One plant behind every controller."""

    plant: Annotated[int, Field(ge=0)]
    drift: dict[str, Number]
    variants: dict[str, VariantRow]


def fault_of(row: Mapping[str, Any], variants: Sequence[str], heights: int) -> str | None:
    """Say what keeps a line from being the result of a plant."""
    try:
        found = PlantRow.model_validate(row)
    except ValidationError as error:
        first: dict[str, Any] = {**error.errors(include_url=False)[0]}
        what, _, _ = explain(first).text.partition(";")  # nobody mends such a line by hand
        return f"{'.'.join(str(part) for part in first['loc'])}: {what}"
    for name in variants:
        run = found.variants.get(name)
        if run is None:
            return f"variants.{name}: is missing"
        if run.lost_s is not None:
            continue
        for key in ("overshoot_percent", "settling_s"):
            values = getattr(run, key)
            if values is None or len(values) != heights:
                return f"variants.{name}.{key}: must have {heights} values, one a step height"
        if run.standstill_rms_m is None:
            return f"variants.{name}.standstill_rms_m: is missing"
    return None


PERCENTILES = (5, 50, 95, 99)
STANDSTILL_S = 0.25
COMPARED: tuple[MethodName, ...] = ("ratio", "single-valued")
"""Compared with the variant of the controller file: without compensation, and without memory."""

FIGURES = ("overshoot_percent", "settling_s", "standstill_rms_m")
"""Of a plant: the first two for each step height, the larger one of up and down."""


@dataclass(frozen=True)
class PlantRun:
    """What one plant did behind one controller."""

    # One a step height, %; larger one of up and down. Infinite where levitation was lost.
    overshoot: tuple[float, ...]
    # likewise, s; into the band of :func:`anhyst.study.bearing.metrics.settling_band`
    settling: tuple[float, ...]
    standstill: float  # rms of the gap, m
    lost: float | None  # when levitation was lost, s

    def figure(self, name: str, place: int) -> float:
        """Return one of :data:`FIGURES` at a step height."""
        if name == "standstill_rms_m":
            return self.standstill
        return (self.overshoot if name == "overshoot_percent" else self.settling)[place]


@dataclass(frozen=True)
class MonteCarlo:
    """Plants drawn and run.

    Parameters
    ----------
    heights : tuple of float
        Of the steps, m.
    drifts : tuple of Drift
        One a plant.
    runs : mapping of str to tuple of PlantRun
        One a plant, by variant.
    seed : int
    own : str
        The variant of the controller file.
    """

    heights: tuple[float, ...]
    drifts: tuple[Drift, ...]
    runs: Mapping[MethodName, tuple[PlantRun, ...]]
    seed: int
    own: MethodName

    def values(self, variant: MethodName, name: str, place: int = 0) -> list[float]:
        """Return a figure of every plant, infinite where levitation was lost.

        Parameters
        ----------
        variant : str
        name : str
            One of :data:`FIGURES`.
        place : int, optional
            Of the step height.
        """
        return [run.figure(name, place) for run in self.runs[variant]]

    def as_dict(self) -> dict[str, Any]:
        """Return percentiles and worst plants as ``montecarlo.json`` holds them."""
        found = {variant: self._variant(variant) for variant in self.runs}
        worst = sorted({place for one in found.values() for place in _worst_plants(one)})
        return {
            "format": "anhyst-montecarlo-figures",
            "plants": len(self.drifts),
            "seed": self.seed,
            "variants": found,
            "worst_plants": {str(place): self.drifts[place].as_dict() for place in worst},
        }

    def _variant(self, variant: MethodName) -> dict[str, Any]:
        places = range(len(self.heights))
        return {
            "lost": sum(run.lost is not None for run in self.runs[variant]),
            **{
                name: [
                    {"height_m": self.heights[place], **_spread(self.values(variant, name, place))}
                    for place in places
                ]
                for name in FIGURES[:2]
            },
            "standstill_rms_m": _spread(self.values(variant, "standstill_rms_m")),
        }


def percentile(values: Sequence[float], percent: float) -> float:
    """Return the least of the values that so many percent of them do not exceed.

    >>> percentile([3.0, 1.0, 2.0, math.inf], 50), percentile([3.0, 1.0, 2.0, math.inf], 99)
    (2.0, inf)
    """
    return sorted(values)[max(math.ceil(0.01 * percent * len(values)), 1) - 1]


def monte_carlo(
    rig: BearingRig,
    controller: ControllerFile,
    path: PathLike,
    count: int = 1000,
    variants: Sequence[MethodName] = ("full",),
    seed: int | None = None,
    progress: Progress | None = None,
    jobs: int | None = None,
) -> MonteCarlo:
    """Run plants that have drifted; the controller keeps what it learnt from the nominal one."""
    seed = rig.settings.seed if seed is None else seed
    ready = make_ready(rig, controller)
    rig, knowledge = ready.rig, ready.knowledge()
    setups = tuple(make_setups(rig, controller, knowledge, tuple(variants)).values())
    plants = [DriftedPlant(setups, seed, index) for index in range(count)]
    heights = tuple(rig.settings.step.heights_m)

    def fault(row: Mapping[str, Any]) -> str | None:
        return fault_of(row, variants, len(heights))

    with ResultsFile(path, _header(rig, controller, variants, seed), "plant", fault) as results:
        done = _run_missing(plants, results, progress, jobs)
    return MonteCarlo(
        heights=heights,
        drifts=tuple(plant.drift for plant in plants),
        runs={
            name: tuple(_plant_run(one["variants"][name], len(heights)) for one in done)
            for name in variants
        },
        seed=seed,
        own=controller.settings.compensation.variant,
    )


def _run_missing(
    plants: Sequence[DriftedPlant],
    results: ResultsFile,
    progress: Progress | None,
    jobs: int | None,
) -> list[Mapping[str, Any]]:
    """Run the plants that have no result yet, and return the results of all in their order."""
    count = len(plants)
    left = [plant for plant in plants if plant.index not in results.done]

    try:
        for _, result in each(run_plant, left, progress, jobs):
            results.add(result)
    except KeyboardInterrupt:
        kept = sum(plant.index in results.done for plant in plants)
        raise Interrupted(
            f"{kept} of {count} plants are kept in {results.path}; the same command goes on from "
            "there"
        ) from None
    return [results.done[plant.index] for plant in plants]


@dataclass(frozen=True)
class DriftedPlant:
    """One plant and the controllers that hold it."""

    setups: tuple[Setup, ...]
    seed: int
    index: int

    @property
    def drift(self) -> Drift:
        """How far it is from the nominal one."""
        return self._draw()[0]

    @property
    def noise(self) -> int:
        """Seed of its noise."""
        return self._draw()[1]

    def _draw(self) -> tuple[Drift, int]:
        rng = np.random.default_rng([self.seed, self.index])
        noise = int(rng.integers(1 << 31))
        return draw_drift(self.setups[0].rig.settings.spread, rng), noise


def run_plant(plant: DriftedPlant) -> dict[str, Any]:
    """Lift off, step up and down by every height and hold position, behind every controller."""
    drift = plant.drift
    found = {one.name: _run_setup(one, drift, plant.noise) for one in plant.setups}
    return {"plant": plant.index, "drift": drift.as_dict(), "variants": found}


def _run_setup(setup: Setup, drift: Drift, noise: int) -> dict[str, Any]:
    rig = setup.rig
    tried = rig.settings
    scenario = steps_up_and_down(
        rig, setup.controller, tried.gap_m, tried.step.heights_m, rest=STANDSTILL_S
    )
    loop = SimulatedLoop(setup, bearing=drifted_bearing(rig, drift, noise))
    recording = loop.run(scenario)
    lost = lost_at(rig, recording, scenario.lifted)
    if lost is None and len(recording) < scenario.ticks:
        lost = float(recording["t_s"][-1])
    if lost is not None:
        return {"lost_s": lost}
    return {"lost_s": None, **_judge(drifted_rig(rig, drift), scenario, recording)}


def _judge(rig: BearingRig, scenario: Scenario, recording: Recording) -> dict[str, Any]:
    """Judge what an ideal sensor with the gain and offset of this one would read.

    An offset of the sensor moves every gap by as much and would otherwise count as overshoot.
    """
    sensor = rig.settings.gap_sensor
    read = (1.0 + sensor.gain_error) * recording["gap_m"] + sensor.offset_m
    time, reference = recording["t_s"], recording["reference_m"]
    heights = rig.settings.step.heights_m
    overshoot, settling = [0.0] * len(heights), [0.0] * len(heights)
    for number, step in enumerate(scenario.steps):
        rows = slice(step.begin - 1, step.end)
        found = step_figures(time[rows], reference[rows], read[rows], position_resolution(rig))
        place = number // 2
        overshoot[place] = max(overshoot[place], found.overshoot)
        settling[place] = max(settling[place], found.settling_time_in_noise)
    rest = recording["gap_m"][-round(STANDSTILL_S / rig.dt) :]
    return {
        "overshoot_percent": overshoot,
        "settling_s": [one if math.isfinite(one) else None for one in settling],
        "standstill_rms_m": float(np.std(rest)),
    }


def _plant_run(row: Mapping[str, Any], heights: int) -> PlantRun:
    if row["lost_s"] is not None:
        never = (math.inf,) * heights
        return PlantRun(never, never, math.inf, row["lost_s"])
    settling = tuple(math.inf if one is None else one for one in row["settling_s"])
    return PlantRun(tuple(row["overshoot_percent"]), settling, row["standstill_rms_m"], None)


def _spread(values: Sequence[float]) -> dict[str, float | int | None]:
    """Return percentiles, the worst and its plant; what is infinite becomes None, as for JSON."""
    worst = int(np.argmax(values))
    found = {f"p{percent}": percentile(values, percent) for percent in PERCENTILES}
    return {
        **{key: one if math.isfinite(one) else None for key, one in found.items()},
        "worst": values[worst] if math.isfinite(values[worst]) else None,
        "worst_plant": worst,
    }


def _worst_plants(found: Mapping[str, Any]) -> list[int]:
    spreads = [found["standstill_rms_m"], *(one for name in FIGURES[:2] for one in found[name])]
    return [spread["worst_plant"] for spread in spreads]


def _header(
    rig: BearingRig, controller: ControllerFile, variants: Sequence[MethodName], seed: int
) -> dict[str, Any]:
    """Return all that results depend on."""
    return {
        "format": "anhyst-montecarlo",
        "version": 1,
        "anhyst": running_version(),
        "rig": _hash(
            rig.settings.model_dump_json(), [*rig.measured.files, rig.model, rig.flux_table]
        ),
        "controller": _hash(controller.settings.model_dump_json(), [controller.model]),
        "variants": list(variants),
        "seed": seed,
    }


def _hash(settings: str, files: Sequence[Path | None]) -> str:
    total = hashlib.sha256(settings.encode())
    for path in files:
        total.update(b"" if path is None else hashlib.sha256(path.read_bytes()).digest())
    return total.hexdigest()
