"""Simulate drifted plants with every method (Monte Carlo), for any kind of rig.

A plant depends only on the seed and on its number. A file stores the results, and an interrupted
run continues from this file.
"""

from __future__ import annotations

import glob
import hashlib
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from anhyst.support import running_version
from anhyst.support.atomic import PathLike, to_json_value
from anhyst.support.cache import ResultsFile
from anhyst.support.errors import InputError, Interrupted, NegativeResult, wrong_key
from anhyst.support.jobs import Progress, map_unordered
from anhyst.support.kinds import MethodName
from anhyst.support.result import rows_to_columns
from anhyst_rigs.rig.drift import Drift, sample_plant
from anhyst_rigs.rig.file import RigFile
from anhyst_rigs.study.engine.table import (
    ComparedFigure,
    Judgement,
    Metric,
    StudyResult,
    judge_against_baselines,
    mean_interval,
    strongest_baseline,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PERCENTILES = (5, 50, 95, 99)
"""Percentiles that the tables contain."""


@dataclass(frozen=True)
class PlantMetric(Metric):
    """A metric that is computed for each plant."""

    # cases in which the metric is computed; empty: one value for each plant
    cases: tuple[float | str, ...] = ()
    case_key: str = ""  # key of a case in files

    @property
    def case_names(self) -> tuple[str, ...]:
        """Names of the cases with a value of the metric."""
        if not self.cases:
            return ("",)
        return tuple(f"{1e6 * c:g} um" if isinstance(c, float) else c for c in self.cases)


@dataclass(frozen=True)
class Plants:
    """A rig with its controller, and the metrics that are computed for its plants."""

    file: RigFile  # rig file with the spread of the plants
    # function that simulates a plant with a method and a noise seed, possibly in another process;
    # it returns every metric (infinite or null if not reached), or only ``lost_s`` after a loss
    run: Callable[[MethodName, Drift, int], dict[str, Any]]
    methods: tuple[MethodName, ...]
    main_method: MethodName  # main method, which is compared with all others
    figures: tuple[PlantMetric, ...]
    input_files: tuple[Path, ...]  # files that affect the results
    setting_texts: Mapping[str, str]  # further settings that affect the results
    seed: int  # seed of all plants
    beneficial_condition: str  # sentence: where compensation would be beneficial
    # name of the only case in a benefit map; "": one case for each stage of the trials
    single_case: str = ""

    def draw_plant(self, number: int) -> tuple[Drift, int]:
        """Return the random drift of the plant with a number, and the seed of its noise."""
        return sample_plant(self.file, self.seed, number)

    def header(self) -> dict[str, Any]:
        """Return all data that affect the results, for the head of the results file."""
        return {
            "format": "anhyst-montecarlo",
            "version": 2,
            "anhyst": running_version(),
            "rig": _hash_inputs(self.file.model_dump_json(), self.input_files),
            **{name: _hash_inputs(text, ()) for name, text in self.setting_texts.items()},
            "variants": list(self.methods),
            "seed": self.seed,
        }


def _hash_inputs(settings: str, files: Sequence[Path]) -> str:
    input_hash = hashlib.sha256(settings.encode())
    for path in files:
        input_hash.update(hashlib.sha256(path.read_bytes()).digest())
    return input_hash.hexdigest()


@dataclass(frozen=True)
class PlantRun:
    """The result of one plant with one method."""

    # by metric: one value for each case, infinite if control was lost
    values: Mapping[str, tuple[float, ...]]
    lost_s: float | None  # time at which control was lost, s; None if it was not


@dataclass(frozen=True, repr=False)
class MonteCarlo(StudyResult):
    """Results of random plants.

    Parameters
    ----------
    plants : Plants
        The simulated rig and methods.
    drifts : tuple of Drift
        Drift of each plant.
    runs : mapping of str to tuple of PlantRun
        By method: results of all plants.
    """

    plants: Plants
    drifts: tuple[Drift, ...]
    runs: Mapping[MethodName, tuple[PlantRun, ...]]

    def values(self, method: MethodName, key: str, case: int = 0) -> list[float]:
        """Return a metric of every plant; infinite if control was lost.

        Parameters
        ----------
        method : str
        key : str
            Key of the metric.
        case : int, optional
            Number of the case.
        """
        return [run.values[key][case] for run in self.runs[method]]

    def lost_count(self, method: MethodName) -> int:
        """Return the number of plants that lost control with a method.

        Parameters
        ----------
        method : str
        """
        return sum(run.lost_s is not None for run in self.runs[method])

    @property
    def lost_in(self) -> list[str]:
        """Texts with the number of lost plants, one for each method that lost any."""
        return [
            f"{lost_plants} of {len(self.drifts)} plants with '{name}'"
            for name in self.runs
            if (lost_plants := self.lost_count(name))
        ]

    def refuse_losses(self) -> None:
        """Raise NegativeResult if a plant lost control with the compensator."""
        own_method = self.plants.main_method
        if self.lost_count(own_method):
            raise NegativeResult(
                f"{self.lost_count(own_method)} of {len(self.drifts)} plants were lost with '{own_method}'",
                code="plants-lost",
            )

    @property
    def verdict(self) -> Judgement:
        """Whether compensation is beneficial over all plants, for each metric and each case."""
        own_method = self.plants.main_method
        if self.lost_count(own_method):
            return Judgement(
                "unknown", f"'{own_method}' lost {self.lost_count(own_method)} of {len(self.drifts)} plants"
            )
        if len(self.drifts) < 2:
            return Judgement("unknown", "one plant is not sufficient; run more")
        compared = [
            comparison
            for figure in self.plants.figures
            for case in range(len(figure.case_names))
            if (comparison := self._compare_figure(figure, case)) is not None
        ]
        return judge_against_baselines(own_method, compared, "figures", self.plants.beneficial_condition)

    def _compare_figure(self, figure: PlantMetric, case: int) -> ComparedFigure | None:
        """Compare with the strongest baseline plant by plant, because both use the same plants."""
        survivors = [method for method in self.runs if not self.lost_count(method)]
        means = {method: mean_interval(self.values(method, figure.key, case)) for method in survivors}
        if (baseline := strongest_baseline(means)) is None:
            return None
        own_method = self.plants.main_method
        own_values, best_values = (
            np.array(self.values(method, figure.key, case)) for method in (own_method, baseline)
        )
        uncertainty = (
            mean_interval(own_values - best_values).half_width if np.isfinite(own_values).all() else 0.0
        )
        title = f"{figure.title} {figure.case_names[case]}".strip()
        return ComparedFigure(title, baseline, means[own_method].mean, means[baseline].mean, uncertainty)

    def facts(self) -> dict[str, str]:
        """Return the first metric of every method, and the verdict."""
        figure = self.plants.figures[0]
        facts = {"plants": str(len(self.drifts)), "seed": str(self.plants.seed)}
        for name in self.runs:
            median = figure.factor * percentile(self.values(name, figure.key), 50)
            facts[name] = f"{figure.title}, median {median:.3g} {figure.unit}"
        return facts | self.losses_fact() | {"verdict": self.verdict.sentence}

    def to_columns(self) -> dict[str, Any]:
        """Return every metric of every plant, one row for each plant, method and case."""
        rows = []
        for figure in self.plants.figures:
            for case, name in enumerate(figure.case_names):
                for method in self.runs:
                    for plant, value in enumerate(self.values(method, figure.key, case)):
                        figure_values = {"figure": figure.key, "case": name, "variant": method}
                        rows.append({**figure_values, "plant": plant, "value": value})
        return rows_to_columns(rows)

    def draw(self, ax: Axes) -> None:
        """Draw the cumulative distribution of the first metric."""
        figure = self.plants.figures[0]
        for name in self.runs:
            values = figure.factor * np.sort(self.values(name, figure.key))
            ax.plot(values, 100.0 * np.arange(1, values.size + 1) / values.size, label=name)
        ax.set_xlabel(f"{figure.title} [{figure.unit}]")
        ax.set_ylabel("plants below [%]")

    def as_dict(self) -> dict[str, Any]:
        """Return the percentiles and the worst plants in the form of ``montecarlo.json``."""
        variants = {method: self._variant_dict(method) for method in self.runs}
        worst_plants = {
            spread["worst_plant"]
            for variant in variants.values()
            for key, rows in variant.items()
            if key != "lost"
            for spread in (rows if isinstance(rows, list) else [rows])
        }
        verdict = self.verdict
        return {
            "format": "anhyst-montecarlo-figures",
            "rig": self.plants.file.name,
            "plants": len(self.drifts),
            "seed": self.plants.seed,
            "variants": variants,
            "worst_plants": {str(number): self.drifts[number].as_dict() for number in sorted(worst_plants)},
            "verdict": {"level": verdict.level, "text": verdict.sentence},
        }

    def _variant_dict(self, method: MethodName) -> dict[str, Any]:
        figures: dict[str, Any] = {"lost": self.lost_count(method)}
        for figure in self.plants.figures:
            rows = [
                {figure.case_key: case, **_spread_dict(self.values(method, figure.key, index))}
                for index, case in enumerate(figure.cases)
            ]
            figures[figure.key] = rows or _spread_dict(self.values(method, figure.key))
        return figures


def _spread_dict(values: Sequence[float]) -> dict[str, float | int | None]:
    """Return percentiles, the worst value and its plant; infinite values are None for JSON."""
    worst_index = int(np.argmax(values))
    spread = {f"p{percent}": percentile(values, percent) for percent in PERCENTILES}
    return {**to_json_value({**spread, "worst": values[worst_index]}), "worst_plant": worst_index}


def percentile(values: Sequence[float], percent: float) -> float:
    """Return the smallest value that at least `percent` per cent of all values do not exceed.

    >>> percentile([3.0, 1.0, 2.0, math.inf], 50), percentile([3.0, 1.0, 2.0, math.inf], 99)
    (2.0, inf)
    """
    return sorted(values)[max(math.ceil(0.01 * percent * len(values)), 1) - 1]


@dataclass(frozen=True)
class Shard:
    """Part I of N of a Monte Carlo run: the plants I - 1, I - 1 + N, ..."""

    numbers: range  # numbers of the plants
    path: Path  # results file, such as plants.2-of-8.jsonl

    @classmethod
    def parse(cls, text: str, count: int, path: Path) -> Self:
        """Return a shard, such as 2/8, of a run with a number of plants and a results file."""
        part, _, parts = text.partition("/")
        if not (part.isdecimal() and parts.isdecimal() and 1 <= int(part) <= int(parts) <= count):
            fault = f"'{text}' is not a part of {count} plants; give I/N, such as 2/8"
            raise wrong_key("--shard", fault, code="bad-shard")
        shard_path = path.with_name(f"{path.stem}.{int(part)}-of-{int(parts)}{path.suffix}")
        return cls(range(int(part) - 1, count, int(parts)), shard_path)

    def facts(self) -> dict[str, str]:
        """Return the number of plants."""
        return {"plants": f"{len(self.numbers)} of {self.numbers.stop}"}


def merge_shards(plants: Plants, path: Path, count: int) -> None:
    """Write the results of all shards to one file, as one run writes them."""
    fault, done = partial(find_fault, plants=plants), dict[int, dict[str, Any]]()
    for file in sorted(path.parent.glob(f"{glob.escape(path.stem)}.*-of-*{path.suffix}")):
        results = ResultsFile(file, plants.header(), "plant", fault, is_read_only=True).done
        if doubled := sorted(done.keys() & results.keys()):
            text = f"plant {doubled[0]} is in another shard too; remove the shards of the other run"
            raise InputError(f"{file}: {text}", code="shards-differ")
        done |= results
    if wrong := sorted(done.keys() ^ set(range(count))):
        text = f"has {sum(number < count for number in done)} of {count} plants in its shards"
        text += f" and {sum(number >= count for number in done)} others, plant {wrong[0]} is "
        text += "missing; run its shard again" if wrong[0] < count else "not expected; correct --monte-carlo"
        raise InputError(f"{path}: {text}", code="shards-differ")
    with ResultsFile(path, plants.header(), "plant", fault) as whole:
        whole.done.update(done)
        whole.sort()


def monte_carlo(
    plants: Plants, path: PathLike, count: int, progress: Progress | None = None, jobs: int | None = None
) -> MonteCarlo:
    """Simulate drifted plants; continue an existing file of results."""
    done = run_numbers(plants, path, range(count), progress, jobs)
    rows = [done[number]["variants"] for number in range(count)]
    return MonteCarlo(
        plants,
        tuple(plants.draw_plant(number)[0] for number in range(count)),
        {name: tuple(_plant_run(record[name], plants) for record in rows) for name in plants.methods},
    )


def run_numbers(
    plants: Plants, path: PathLike, numbers: range, progress: Progress | None = None, jobs: int | None = None
) -> Mapping[int, dict[str, Any]]:
    """Simulate the plants that a results file lacks; sort the file, and return all its results."""
    fault = partial(find_fault, plants=plants)
    with ResultsFile(path, plants.header(), "plant", fault) as results:
        remaining_numbers = [number for number in numbers if number not in results.done]
        try:
            for _, result in map_unordered(partial(run_plant, plants), remaining_numbers, progress, jobs):
                results.add(result)
        except KeyboardInterrupt:
            done_count = sum(number in results.done for number in numbers)
            raise Interrupted(
                f"{done_count} of {len(numbers)} plants are stored in {results.path}; the same command "
                "continues from there"
            ) from None
        results.sort()
        return results.done


def run_plant(plants: Plants, number: int) -> dict[str, Any]:
    """Simulate a plant with every method; return its line in the results file."""
    drift, noise = plants.draw_plant(number)
    variants = {
        method: to_json_value({"lost_s": None, **plants.run(method, drift, noise)})
        for method in plants.methods
    }
    return {"plant": number, "drift": drift.as_dict(), "variants": variants}


def _plant_run(result: Mapping[str, Any], plants: Plants) -> PlantRun:
    lost_s = result["lost_s"]
    values = {}
    for figure in plants.figures:
        lost_values = [None] * len(figure.case_names)
        entry = lost_values if lost_s is not None else result[figure.key]
        cases = entry if isinstance(entry, list) else [entry]
        values[figure.key] = tuple(math.inf if case is None else case for case in cases)
    return PlantRun(values, lost_s)


def find_fault(result: Mapping[str, Any], plants: Plants) -> str | None:
    """Return why a line of the results file is not the result of a plant, or None."""
    return next(_record_faults(result, plants), None)


def _record_faults(result: Mapping[str, Any], plants: Plants) -> Iterator[str]:
    """Yield the faults of a line of the results file; later checks may rely on the earlier ones."""
    plant_number = result.get("plant")
    if not isinstance(plant_number, int) or isinstance(plant_number, bool) or plant_number < 0:
        yield "plant: must be the number of a plant"
    for key in ("drift", "variants"):
        if not isinstance(result.get(key), dict):
            yield f"{key}: is missing"
    for name in plants.methods:
        run, prefix = result["variants"].get(name), f"variants.{name}"
        if not isinstance(run, dict):
            yield f"{prefix}: is missing"
        if not _is_valid_value(run.get("lost_s", math.nan)):
            yield f"{prefix}.lost_s: must be null or the time of the loss of the loop"
        for figure in plants.figures if run["lost_s"] is None else ():
            entry = run.get(figure.key, math.nan)
            values = entry if figure.cases else [entry]
            if not isinstance(values, list) or len(values) != len(figure.case_names):
                yield f"{prefix}.{figure.key}: must have {len(figure.case_names)} values, one for each case"
            for index, value in enumerate(values):
                if not _is_valid_value(value):
                    key = f"{figure.key}.{index}" if figure.cases else figure.key
                    yield f"{prefix}.{key}: must be null or a number that is not negative"


def _is_valid_value(value: Any) -> bool:
    if value is None:
        return True
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return is_number and math.isfinite(value) and value >= 0.0
