"""Compare the errors of the laws on virtual magnets of three iron families and on real materials.

The irons and their loops are those of ``examples/irons``, which were fixed before any model was
identified from these loops. Every row gives the errors of play cells and Jiles-Atherton. For a
magnet, it also gives that of the best single-valued curve, which is fitted to the true loops of the
evaluation.
"""

from __future__ import annotations

import importlib.util
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import numpy as np

from anhyst.data import Loops
from anhyst.data.clean import thin_loops
from anhyst.data.reading import read_loops
from anhyst.data.verdict import single_valued_residuals
from anhyst.identification import identify
from anhyst.model.actuator import Model
from anhyst.support.numeric import FloatArray
from rows import ROOT, Row, Stopwatch, measurements

PAPER_LAW = "effective-field"
CHOSEN_LAW = "auto"

MEAN_TARGET, WORST_TARGET, SMALL_CYCLES_TARGET = 0.12, 0.8, 0.2
"""Targets, % of the largest force: mean and worst at unseen gaps, mean in small cycles about a
bias."""


def _load_irons_module() -> ModuleType:
    path = ROOT / "examples" / "irons" / "make_loops.py"
    spec = importlib.util.spec_from_file_location("anhyst_irons", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["anhyst_irons"] = module
    spec.loader.exec_module(module)
    return module


@dataclass(frozen=True)
class ForceErrors:
    """Absolute deviations: mean and largest, % of the largest force."""

    mean: float
    worst: float

    @classmethod
    def of(cls, deviation: list[FloatArray], largest: float) -> ForceErrors:
        """Compute the metrics from deviations and a largest force, N."""
        percentages = 100.0 * np.abs(np.concatenate(deviation)) / largest
        return cls(float(percentages.mean()), float(percentages.max()))

    def __str__(self) -> str:
        """Return both values as text."""
        return f"{self.mean:.3f} %, worst {self.worst:.2f} %"


def _unseen_residuals(model: Model, truth: Loops) -> list[FloatArray]:
    return [
        model.predict(loop.input, loop.schedule, loop.time, loop.history).output - loop.output
        for loop in truth.loops
    ]


def _largest_force(truth: Loops) -> float:
    return max(float(np.max(loop.output)) for loop in truth.loops)


def _unseen_row(name: str, models: dict[str, Model], truth: Loops) -> Row:
    largest = _largest_force(truth)
    errors = {law: ForceErrors.of(_unseen_residuals(model, truth), largest) for law, model in models.items()}
    curve_errors = ForceErrors.of([residuals for _, residuals in single_valued_residuals(truth)], largest)
    chosen_errors = errors[CHOSEN_LAW]
    return Row(
        f"{name}, unseen gaps: mean error",
        f"<= {MEAN_TARGET:g} %, worst {WORST_TARGET:g} % of F_max",
        f"{chosen_errors} ({models[CHOSEN_LAW].law}); {PAPER_LAW} {errors[PAPER_LAW]}; "
        f"best single-valued {curve_errors}",
        chosen_errors.mean <= MEAN_TARGET and chosen_errors.worst <= WORST_TARGET,
    )


def _path_rows(module: ModuleType, name: str, models: dict[str, Model], fixed_gap_errors: ForceErrors,
               largest: float) -> list[Row]:  # fmt: skip
    """Return the rows of a moving gap and of small cycles about a bias."""
    offset = module.SETTINGS["sensors"]["current_offset_A"]
    paths = {"moving gap": [module.moving(name)], "small cycles": list(module.small_cycles(name))}
    result_rows = []
    for title, truths in paths.items():
        errors = {}
        for law, model in models.items():
            deviations = []
            for truth in truths:
                modelled = model.predict(truth.current + offset, truth.gap, history="demagnetised").output
                deviations.append((modelled - truth.force)[truth.counted])
            errors[law] = ForceErrors.of(deviations, largest)
        chosen_errors, is_moving = errors[CHOSEN_LAW], title == "moving gap"
        result_rows.append(
            Row(
                f"{name}, {title}: mean error",
                "<= 1.25 times that at fixed gaps" if is_moving else f"<= {SMALL_CYCLES_TARGET:g} % of F_max",
                f"{chosen_errors}; {PAPER_LAW} {errors[PAPER_LAW]}",
                chosen_errors.mean <= (1.25 * fixed_gap_errors.mean if is_moving else SMALL_CYCLES_TARGET),
            )
        )
    return result_rows


def measure_magnets() -> list[Row]:
    """Measure the bundled magnet with its own iron and with six others."""
    module = _load_irons_module()
    bundled_folder = ROOT / "examples" / "electromagnet"
    result_rows = [_bundled_row(bundled_folder)]
    for name in module.tables():
        with tempfile.TemporaryDirectory(prefix="anhyst-bench-") as folder:
            for file, text in module.files(name).items():
                (Path(folder) / file).write_text(text, encoding="utf-8")
            loops = read_loops(Path(folder) / "loops.csv")
            truth = read_loops(Path(folder) / "unseen_truth.csv")
        models = {law: identify(loops, law=law).model for law in (PAPER_LAW, CHOSEN_LAW)}
        result_rows.append(_unseen_row(name, models, truth))
        largest = _largest_force(truth)
        fixed_gap_errors = ForceErrors.of(_unseen_residuals(models[CHOSEN_LAW], truth), largest)
        result_rows += _path_rows(module, name, models, fixed_gap_errors, largest)
    return result_rows


def _bundled_row(folder: Path) -> Row:
    loops, truth = (read_loops(folder / name) for name in ("loops.csv", "unseen_truth.csv"))
    watch = Stopwatch()
    chosen_model = identify(loops, law=CHOSEN_LAW).model
    identify_seconds = watch.processor
    models = {PAPER_LAW: identify(loops, law=PAPER_LAW).model, CHOSEN_LAW: chosen_model}
    row = _unseen_row("bundled magnet", models, truth)
    return Row(
        row.what,
        f"{row.reach}; identification <= 5 s of processor time",
        f"{row.measured}; {identify_seconds:.1f} s",
        bool(row.met) and identify_seconds <= 5.0,
        identify_seconds,
    )


def _joint_rms(loops: Loops, law: str, weights: str) -> list[float]:
    """Return the rms errors of one joint fit, %: of each loop, or one value with equal weights."""
    fit = identify(loops, law=law, weights=weights, offsets=False).model.fit
    assert fit is not None
    if weights == "points":
        return [100.0 * fit.rms / fit.largest_output]
    return [100.0 * row.rms / row.largest_output for row in fit.loops]


def _withheld_rms(loops: Loops, law: str) -> list[float]:
    """Return the rms error of each withheld inner loop, % of its largest output."""
    loops_by_size = sorted(loops.loops, key=lambda loop: float(np.max(np.abs(loop.output))))
    rms_errors = []
    for loop in loops_by_size[1:-1]:
        other_loops = loops.with_loops([other_loop for other_loop in loops.loops if other_loop is not loop])
        model = identify(other_loops, law=law, weights="relative", offsets=False).model
        residuals = model.predict(loop.input, loop.schedule, history=loop.history).output - loop.output
        rms_errors.append(100.0 * float(np.sqrt(np.mean(residuals**2)) / np.max(np.abs(loop.output))))
    return rms_errors


def _list_text(values: list[float]) -> str:
    return ", ".join(f"{value:.2f}" for value in values) + " %"


def measure_materials(folder: Path) -> list[Row]:
    """Measure joint fits of real materials, and errors at withheld loops for comparison."""
    ferrite = folder / "ferrite_mnzn" / "mnzn_hp_ferrite_4loops.csv"
    steel = folder / "steel_core1_dc" / "loops.csv"
    material_sets = (
        ("MnZn ferrite, 4 loops", read_loops(ferrite, history="settled"), "points", 0.6),
        (
            "solid steel, 4 loops, each",
            read_loops(steel, loop="nominal_Hmax_A_per_m", history="settled"),
            "relative",
            0.8,
        ),
    )
    material_rows = []
    for name, loops, weights, target_percent in material_sets:
        joint_errors = {law: _joint_rms(loops, law, weights) for law in (PAPER_LAW, CHOSEN_LAW)}
        withheld_errors = {law: _withheld_rms(loops, law) for law in (PAPER_LAW, CHOSEN_LAW)}
        material_rows.append(
            Row(
                f"{name}: rms of one set",
                f"<= {target_percent:g} % of B_max",
                f"{_list_text(joint_errors[CHOSEN_LAW])}; "
                f"withheld inner loops {_list_text(withheld_errors[CHOSEN_LAW])}; "
                f"{PAPER_LAW} {_list_text(joint_errors[PAPER_LAW])}; withheld {_list_text(withheld_errors[PAPER_LAW])}",
                max(joint_errors[CHOSEN_LAW]) <= target_percent,
            )
        )
    return [*material_rows, _gadolinium_row(folder / "gadolinium_temperature")]


def _gadolinium_row(folder: Path) -> Row:
    loops = thin_loops(read_loops(sorted(folder.glob("gd_*.csv")), file_name="gd_T{T_C}C"), 300)
    errors = {}
    for law in (PAPER_LAW, CHOSEN_LAW):
        deviations = []
        for value in loops.schedule_values[1:-1]:
            model = identify(loops.without(value), law=law, gap_map="free").model
            deviations += _unseen_residuals(model, loops.at(value))
        errors[law] = 1e3 * float(np.mean(np.abs(np.concatenate(deviations))))
    return Row(
        "gadolinium, withheld temperature: mean error",
        "<= 15 mT",
        f"{errors[CHOSEN_LAW]:.1f} mT; {PAPER_LAW} {errors[PAPER_LAW]:.1f} mT",
        errors[CHOSEN_LAW] <= 15.0,
    )


def rows() -> list[Row]:
    """Return all rows about the laws."""
    folder = measurements()
    return [*measure_magnets(), *(measure_materials(folder) if folder else [])]
