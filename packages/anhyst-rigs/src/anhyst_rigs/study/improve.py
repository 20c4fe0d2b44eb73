"""Monitor the model of a running bench, and improve it step by step.

The prediction of the model is compared with the rows of the bench. If the model no longer fits,
loops can be measured, a new model identified, and a parameter block compiled. Each step reads and
writes files, so that it can run while the bench runs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from anhyst.compensate.budget import measure_budget
from anhyst.data import Loops
from anhyst.data.loops import Loop
from anhyst.data.path import thin_rows
from anhyst.data.reading import read_loops
from anhyst.model.actuator import Model, read_model
from anhyst.model.writer import write_model
from anhyst.support.errors import InputError
from anhyst.support.jobs import Progress
from anhyst.support.numeric import FloatArray, rms
from anhyst_rigs.rig.bench.protocol import Signal
from anhyst_rigs.rig.recording import peak_deviation
from anhyst_rigs.study.excite.design import Bound, Specimen
from anhyst_rigs.study.excite.excite import measure_gaps, write_excitation
from anhyst_rigs.study.excite.on_board import DrivenBoard, measure_on_board
from anhyst_rigs.study.prepared_benches import Improvable, fixed_point_block
from anhyst_rigs.study.watch import DEFAULT_RUN_LENGTH, LEARNING_CYCLES, DriftMonitor

MONITOR_RATE_HZ = 250.0
"""Number of rows per second that are monitored."""

_MONITORED_SIGNALS = (("current_read",), ("gap_read",), ("force_read", "force"))
"""Signals that are compared with the model. A levitated armature has no force sensor, so the exact
force of the virtual armature is used."""


class BenchMonitor:
    """Monitor of one model, which compares it with the rows of a bench from the first row on."""

    def __init__(self, model: Model, signals: Sequence[Signal], rate: float) -> None:
        names = [signal.name for signal in signals]
        self._columns = [_find_column(names, choice) for choice in _MONITORED_SIGNALS]
        # The monitored rows are too far apart for a model with eddy-current lag.
        self._model, self._rate = model.at_rest, rate
        self._tick_interval = max(1, round(rate / MONITOR_RATE_HZ))
        self._monitor: DriftMonitor | None = None
        self._error_text = ""

    def add_rows(self, rows: FloatArray) -> None:
        """Process rows of the bench; it does not matter how they are divided into calls."""
        samples = rows[rows[:, 0] % self._tick_interval == 0]
        if not len(samples) or self._error_text:
            return
        current, gap, force = (samples[:, column] for column in self._columns)
        try:
            if self._monitor is None:
                self._monitor = DriftMonitor(self._model, float(gap[0]))
            self._monitor.add_samples(samples[:, 0], current, gap, force)
        except InputError as error:
            self._error_text = str(error)

    def status(self) -> Mapping[str, Any]:
        """Return the status that the page shows."""
        if self._error_text:
            return {"state": "ended", "text": self._error_text}
        if self._monitor is None:
            return {"state": "learning", "text": "no rows yet"}
        finding = self._monitor.finding
        has_drifted = finding.drift is not None
        state = "drifted" if has_drifted else "learning" if finding.is_learning else "fits"
        return {
            "state": state,
            "text": finding.text(self._rate),
            "cycles": finding.cycles,
            "learn": LEARNING_CYCLES + 1,
            "run_length": DEFAULT_RUN_LENGTH,
            "least_N": self._monitor.min_drift,
            "usual_N": finding.usual_residual,
            "left_N": finding.residual,
            "gain_N": finding.error_reduction if has_drifted else 0.0,
        }


def _find_column(names: Sequence[str], choice: Sequence[str]) -> int:
    for name in choice:
        if name in names:
            return 1 + names.index(name)
    raise InputError(
        f"monitor: the bench has no signal {' or '.join(choice)}", code="no-such-signal", key="watch"
    )


_DRAWN_POINTS = 200
"""Number of drawn points in each loop of a record."""
_COMPARED_POINTS = 100
"""Number of drawn points in each loop of a record, for a comparison of two models."""
_MAX_DRAWN_LOOPS = 60


class DrawnLoop(NamedTuple):
    """The points of a loop in a drawing."""

    kind: str  # ``measured`` or ``model``
    gap: float | None  # gap, m
    current: list[float]  # currents, A, and forces, N
    force: list[float]


def make_drawn_loops(loops: Loops, model: Model | None = None) -> tuple[DrawnLoop, ...]:
    """Return loops of force against current with fewer points, and loops of a model if given."""
    if (loops.input.name, loops.output.name) != ("current", "force"):
        return ()
    curves = []
    for loop in loops.loops[:_MAX_DRAWN_LOOPS]:
        curves.append(_make_drawn_loop("measured", loop, loop.output))
        if model is not None:
            curves.append(_make_drawn_loop("model", loop, model.predict_loop(loop)))
    return tuple(curves)


def _make_drawn_loop(kind: str, loop: Loop, force: FloatArray) -> DrawnLoop:
    indices = thin_rows(loop.input, _DRAWN_POINTS * max(1, loop.reversals // 2))
    return DrawnLoop(kind, loop.schedule_value, loop.input[indices].tolist(), force[indices].tolist())


class ModelWithLoops(NamedTuple):
    """A model of a bench, and the loops for its identification."""

    model: Model
    curves: tuple[DrawnLoop, ...]


def make_model_with_loops(loops: Loops, model: Model) -> ModelWithLoops:
    """Return a model together with its loops."""
    return ModelWithLoops(model, make_drawn_loops(loops, model))


@dataclass(frozen=True, eq=False)
class ModelComparison:
    """An old and a new model that are compared on the same loops."""

    loops: Loops  # measured loops
    old_outputs: tuple[FloatArray, ...]  # predictions of the old and the new model, loop by loop
    new_outputs: tuple[FloatArray, ...]

    def residual_figures(
        self, predicted: tuple[FloatArray, ...], gap: float | None = None
    ) -> dict[str, float]:
        """Return the rms and peak residual of all loops or of one gap, including sensor noise."""
        residual = np.concatenate(
            [
                force - loop.output
                for force, loop in zip(predicted, self.loops.loops, strict=True)
                if gap is None or loop.schedule_value == gap
            ]
        )
        return {"rms_N": rms(residual), "worst_N": peak_deviation(residual)}

    def as_dict(self) -> dict[str, Any]:
        """Return the metrics, and the loops for the drawing."""
        rows = [
            {"gap_m": gap, "old": self.residual_figures(self.old_outputs, gap),
             "new": self.residual_figures(self.new_outputs, gap)}
            for gap in self.loops.schedule_values
        ]  # fmt: skip
        return {
            "old": self.residual_figures(self.old_outputs),
            "new": self.residual_figures(self.new_outputs),
            "gaps": rows,
            "loops": [
                _comparison_dict(loop, old, new)
                for loop, old, new in zip(self.loops.loops, self.old_outputs, self.new_outputs, strict=True)
            ],
        }


def compare_models(old: Model, new: Model, loops: Loops) -> ModelComparison:
    """Compare two models on the same loops."""
    return ModelComparison(
        loops, tuple(map(old.predict_loop, loops.loops)), tuple(map(new.predict_loop, loops.loops))
    )


def _comparison_dict(loop: Loop, old_prediction: FloatArray, new_prediction: FloatArray) -> dict[str, Any]:
    indices = thin_rows(loop.input, _COMPARED_POINTS * max(1, loop.reversals // 2))
    columns = {"current": loop.input, "force": loop.output, "old": old_prediction, "new": new_prediction}
    rounded = {name: [float(f"{value:.5g}") for value in values[indices]] for name, values in columns.items()}
    return {"label": loop.label, **rounded}


LOOPS_FILE = "loops.csv"
"""File with the measured loops; its sidecar is next to it."""
MODEL_FILE = "model.toml"
_MAX_DRIVE_POINTS = 1500
"""Maximum number of drawn points of a drive."""


def excitation_limits(prepared: Improvable) -> dict[str, Any]:
    """Return the limits of a drive that the rig file sets."""
    specimen = prepared.specimen()
    winding = specimen.winding
    return {
        **{name: asdict(bound) for name, bound in _adjustable_limits(specimen).items()},
        "gaps_m": list(specimen.gaps),
        "operating_N": asdict(specimen.operating_force),
        "winding": None
        if winding is None
        else {"continuous_A": winding.continuous_current, "thermal_s": winding.time_constant},
    }


def measure_loops(
    progress: Progress,
    prepared: Improvable,
    folder: Path,
    operator_limits: Mapping[str, float],
    bench: DrivenBoard | None = None,
) -> dict[str, Any]:
    """Design a drive, run it with the armature held, and write the measured loops.

    The drive runs on the virtual rig, or through a running controller.
    """
    specimen = tighten_limits(prepared.specimen(), operator_limits)
    if bench is None:
        excitation = measure_gaps(specimen, progress)
    else:
        excitation = measure_on_board(specimen, bench, progress)
    write_excitation(excitation, prepared.rig, folder / LOOPS_FILE)
    drive_history = excitation.drive_history
    interval = max(1, drive_history.time.size // _MAX_DRIVE_POINTS)
    columns = {"time": drive_history.time, "current": drive_history.current, "warmth": drive_history.warmth}
    return {
        **excitation.as_dict(),
        "played": {name: values[::interval].tolist() for name, values in columns.items()},
    }


_LIMIT_WORDS = {"current_A": ("current", "A"), "rate_A_per_s": ("rate", "A/s"), "force_N": ("force", "N")}
"""Name and unit of each limit that an operator may tighten."""


def tighten_limits(specimen: Specimen, operator_limits: Mapping[str, float]) -> Specimen:
    """Return a specimen with the limits of the operator, if they are tighter."""
    bounds = _adjustable_limits(specimen)
    for name, value in operator_limits.items():
        if name not in bounds:
            raise InputError(
                f"limits: unknown limit '{name[:40]}'; choose from {', '.join(bounds)}",
                code="unknown-limit",
                key="limits",
            )
        bound = bounds[name]
        quantity, unit = _LIMIT_WORDS[name]
        if not 0.0 < value <= bound.value:
            raise InputError(
                f"{quantity}: {value:g} {unit} is not above 0 and at most {bound.value:.4g} {unit}, "
                "the limit of the rig file",
                code="out-of-range",
                key=name,
            )
        if value < bound.value:
            bounds[name] = Bound(value, f"{name} of the operator")
    return replace(
        specimen,
        max_current=bounds["current_A"],
        max_rate=bounds["rate_A_per_s"],
        max_force=bounds["force_N"],
    )


def _adjustable_limits(specimen: Specimen) -> dict[str, Bound]:
    """Return the limits that an operator may tighten."""
    return {
        "current_A": specimen.max_current,
        "rate_A_per_s": specimen.max_rate,
        "force_N": specimen.max_force,
    }


def identify_model(progress: Progress, prepared: Improvable, folder: Path, old: Model) -> dict[str, Any]:
    """Identify a model from measured loops, as the rig file specifies; write and compare it."""
    loops = read_loops(folder / LOOPS_FILE)
    new_model = prepared.identify(loops, progress)
    write_model(new_model, folder / MODEL_FILE)
    return {"law": new_model.law, **compare_models(old, new_model, loops).as_dict()}


def read_identified_model(folder: Path) -> ModelWithLoops:
    """Read the identified model and its loops."""
    return make_model_with_loops(read_loops(folder / LOOPS_FILE), read_model(folder / MODEL_FILE))


def compile_block(progress: Progress, prepared: Improvable, folder: Path) -> dict[str, Any]:
    """Compile the model for the running board, and measure the error of the parameter block."""
    model = read_model(folder / MODEL_FILE)
    plan = prepared.compile(model)
    progress(1.0, 2.0)
    budget = measure_budget(plan)
    progress(2.0, 2.0)
    return {
        "words": fixed_point_block(plan).words.tolist(),
        "worst_N": budget.compiled.worst,
        "rms_N": budget.compiled.rms,
        "drift_N": budget.drift.worst,
        "largest_N": plan.reference_output,
    }
