"""Identify, compile, verify and compare all magnets of a folder: the command ``anhyst fleet``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from anhyst.data.formats.text import write_csv
from anhyst.identification.space import coordinate_kind
from anhyst.support.atomic import PathLike, check_writable, write_json
from anhyst.support.errors import InputError, NegativeResult
from anhyst.support.jobs import Progress, map_ordered
from anhyst.support.numeric import FloatArray
from anhyst.support.result import Result, rows_to_columns
from anhyst_rigs.study.fleet_magnets import (
    MODEL_FILE,
    FleetSettings,
    Member,
    choose_law,
    evaluate_magnet,
    find_members,
    shared_model_error,
)
from anhyst_rigs.study.fleet_spread import FleetSpread, MagnetEstimate, estimate_spread

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MIN_MAGNETS_FOR_SPREAD = 3
"""Smallest number of magnets for the computation of a scatter."""
TABLE_FILE = "fleet.csv"
"""Name of the table with one row for each magnet."""
FIGURES_FILE = "fleet.json"
"""Name of the file with all metrics."""


@dataclass(frozen=True, repr=False)
class Fleet(Result):
    """Results of a fleet of magnets.

    Parameters
    ----------
    out : Path
        Folder with ``fleet.json``, ``fleet.csv`` and a folder for each magnet: ``model.toml``,
        ``controller/``, ``result.json``.
    settings : FleetSettings
        With the law and the gap map of all magnets.
    results : tuple of dict
        For each magnet; see :func:`anhyst_rigs.study.fleet_magnets.evaluate_magnet`.
    typical : str
        Name of the magnet nearest to the mean, whose model is the common model; empty if none.
    shared_errors : tuple of float
        Rms error of the common model on each magnet's loops, as a fraction of the largest output.
    spread : FleetSpread or None
        Scatter of the fitted quantities; None below :data:`MIN_MAGNETS_FOR_SPREAD` magnets.
    quantities : tuple of str
        Names of these quantities.
    """

    out: Path
    settings: FleetSettings
    results: tuple[dict[str, Any], ...]
    typical: str
    shared_errors: tuple[float, ...]
    spread: FleetSpread | None
    quantities: tuple[str, ...]

    @property
    def evaluated(self) -> list[dict[str, Any]]:
        """Results of the magnets that could be evaluated."""
        return [result for result in self.results if "error" not in result]

    @property
    def failed(self) -> dict[str, str]:
        """Errors of the magnets that could not be evaluated, by name."""
        return {result["name"]: result["error"] for result in self.results if "error" in result}

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the comparison."""
        histories = {tuple(result["histories"]) for result in self.evaluated}
        if len(histories) == 1:
            return ()
        return (
            "the history before the loops differs between magnets, which changes their parameters; "
            "state it with --history, or in sidecar files",
        )

    @property
    def own_errors(self) -> FloatArray:
        """Rms error of each evaluated magnet with its own controller.

        The error is relative to the largest output.
        """
        return np.array([math.hypot(magnet["fit_rms"], magnet["compiled_rms"]) for magnet in self.evaluated])

    @property
    def is_good(self) -> list[bool]:
        """For each evaluated magnet, whether its verified controller is within the tolerance."""
        limit = 0.01 * self.settings.tolerance
        return [
            bool(magnet["verified"] and magnet["passed_acceptance"] and error <= limit)
            for magnet, error in zip(self.evaluated, self.own_errors, strict=True)
        ]

    @property
    def is_good_shared(self) -> list[bool]:
        """For each evaluated magnet, whether the common model is within the tolerance."""
        limit = 0.01 * self.settings.tolerance
        return [bool(error <= limit) for error in self.shared_errors]

    @property
    def outliers(self) -> list[str]:
        """Names of the magnets that do not belong to the fleet."""
        if self.spread is None:
            return []
        names = [magnet["name"] for magnet in self.evaluated]
        return [name for name, is_outlier in zip(names, self.spread.outlier, strict=True) if is_outlier]

    def facts(self) -> dict[str, str]:
        """Return the number of good magnets, with their own models and with the common model."""
        count = len(self.results)
        return {
            "magnets": f"{count}, {len(self.failed)} could not be evaluated",
            "law": f"{self.settings.law}, gap map {self.settings.gap_map}",
            "good, each with its own controller": f"{sum(self.is_good)} of {count}",
            f"good, all with the model of '{self.typical}'": f"{sum(self.is_good_shared)} of {count}",
            "outliers": ", ".join(self.outliers) or "none",
        }

    def to_columns(self) -> dict[str, Any]:
        """Return a row for each evaluated magnet: its errors in per cent and its fitted quantities."""
        rows = []
        distance = self.spread.distance if self.spread else np.full(len(self.evaluated), np.nan)
        for index, magnet in enumerate(self.evaluated):
            rows.append(
                {
                    "magnet": magnet["name"],
                    "good": self.is_good[index],
                    "own_percent": 100.0 * float(self.own_errors[index]),
                    "shared_percent": 100.0 * self.shared_errors[index],
                    "distance": float(distance[index]),
                    "outlier": magnet["name"] in self.outliers,
                    **{name: magnet["values"][magnet["quantities"].index(name)] for name in self.quantities},
                    **self._pooled_columns(index),
                }
            )
        return rows_to_columns(rows)

    def _pooled_columns(self, index: int) -> dict[str, float]:
        if (spread := self.spread) is None:
            return {}
        pooled_values = zip(self.quantities, spread.values[index], spread.std[index], strict=True)
        return {
            f"{name}, {suffix}": float(pooled_value)
            for name, value, std in pooled_values
            for suffix, pooled_value in (("in the fleet", value), ("in the fleet, std", std))
        }

    def as_dict(self) -> dict[str, Any]:
        """Return the content of ``fleet.json``."""
        count = len(self.results)
        spread = self.spread
        return {
            "format": "anhyst-fleet",
            "magnets": count,
            "law": self.settings.law,
            "gap_map": self.settings.gap_map,
            "tolerance_percent": self.settings.tolerance,
            "yield": sum(self.is_good) / count,
            "yield_one_model_for_all": sum(self.is_good_shared) / count,
            "typical": self.typical,
            "outliers": self.outliers,
            "failed": self.failed,
            "quantities": None
            if spread is None
            else {
                name: {"mean": float(mean), "scatter": float(scatter)}
                for name, mean, scatter in zip(self.quantities, spread.mean, spread.scatter, strict=True)
            },
            "results": [
                {
                    "name": magnet["name"],
                    "good": self.is_good[index],
                    "own_rms_percent": 100.0 * float(self.own_errors[index]),
                    "shared_rms_percent": 100.0 * self.shared_errors[index],
                    "in_the_light_of_the_fleet": self._pooled_dict(index),
                }
                for index, magnet in enumerate(self.evaluated)
            ],
        }

    def _pooled_dict(self, index: int) -> dict[str, Any] | None:
        """Return the quantities of a magnet, estimated from its own loops and from the fleet."""
        if (spread := self.spread) is None:
            return None
        return {
            "values": spread.values[index].tolist(),
            "std": spread.std[index].tolist(),
            "correlation": spread.correlation[index].round(6).tolist(),
        }

    def draw(self, ax: Axes) -> None:
        """Draw the error of each magnet with its own controller and with the common model."""
        order = np.argsort(self.own_errors)
        positions = np.arange(len(order))
        ax.plot(positions, 100.0 * np.array(self.shared_errors)[order], "o", ms=4, label="common model")
        ax.plot(positions, 100.0 * self.own_errors[order], "o", ms=4, label="own model")
        ax.axhline(self.settings.tolerance, color="0.4", lw=0.9, ls="--", label="tolerance")
        ax.set_xlabel("magnets, by their own error")
        ax.set_ylabel("rms deviation [% of the largest output]")


def fleet(
    folder: PathLike,
    out: PathLike,
    settings: FleetSettings,
    *,
    progress: Progress | None = None,
    jobs: int | None = None,
) -> Fleet:
    """Identify, compile, verify and evaluate all magnets of a folder.

    An interrupted run is continued. Magnets whose files or settings have changed are computed
    again. The same files, settings and version give the same result in any order of the work.
    """
    members = find_members(folder)
    out_folder = Path(out)
    if Path(folder).resolve() in {out_folder.resolve(), out_folder.resolve().parent}:
        raise InputError(
            f"{out}: is in the folder of the magnets; write to another folder", code="out-among-inputs"
        )
    out_folder.mkdir(parents=True, exist_ok=True)
    for name in (TABLE_FILE, FIGURES_FILE):
        check_writable(out_folder / name)
    choice = choose_law(members, settings, out_folder, jobs)
    tasks = [choice.task(member, settings, out_folder) for member in members]
    results = map_ordered(evaluate_magnet, tasks, progress, jobs)
    if all("error" in result for result in results):
        raise NegativeResult(
            f"none of {len(members)} magnets could be evaluated; the first: {results[0]['error']}",
            code="no-magnet-judged",
        )
    result = _compare_magnets(members, results, choice.settings, out_folder, jobs)
    write_csv(out_folder / TABLE_FILE, {name: _csv_column(col) for name, col in result.to_columns().items()})
    write_json(out_folder / FIGURES_FILE, result.as_dict())
    return result


def _csv_column(column: Sequence[Any]) -> Any:
    """Return a column as CSV files contain it: booleans as 0 and 1, text unchanged."""
    from anhyst.data.formats.channels import Texts

    if isinstance(column[0], str):
        values = tuple(dict.fromkeys(column))
        return Texts(values, np.array([values.index(text) for text in column], np.int32))
    return np.array(column, dtype=np.float64)


def _compare_magnets(
    members: Sequence[Member],
    results: Sequence[dict[str, Any]],
    settings: FleetSettings,
    out: Path,
    jobs: int | None,
) -> Fleet:
    """Compare the magnets that could be evaluated."""
    evaluated = [result for result in results if "error" not in result]
    # Some magnets may have an additional offset. Only quantities of all magnets are compared.
    quantity_sets = [set(result["quantities"]) for result in evaluated]
    names = tuple(
        name for name in evaluated[0]["quantities"] if all(name in result for result in quantity_sets)
    )
    spread = None
    if names and len(evaluated) >= MIN_MAGNETS_FOR_SPREAD:
        spread = estimate_spread(
            [
                MagnetEstimate.from_uncertainty(
                    result["values"], result["std"], result["correlation"]
                ).select([result["quantities"].index(name) for name in names])
                for result in evaluated
            ],
            [coordinate_kind(settings.law, name) for name in names],
        )
    index = 0 if spread is None else int(np.argmin(spread.distance))
    typical_name = evaluated[index]["name"]
    by_name = {member.name: member for member in members}
    shared_error = partial(shared_model_error, out / typical_name / MODEL_FILE, settings.history)
    shared = map_ordered(shared_error, [by_name[result["name"]] for result in evaluated], jobs=jobs)
    return Fleet(out, settings, tuple(results), typical_name, tuple(shared), spread, names)
