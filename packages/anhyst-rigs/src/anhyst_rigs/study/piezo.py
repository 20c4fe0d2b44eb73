"""Simulate a piezo stage that follows a triangle, with and without hysteresis compensation.

Only the inverse from displacement to voltage differs: a constant, the best single-valued curve, or
the compiled fixed-point inverse of the model. All inverses are identified from loops of the virtual
stage, which are measured separately with sensor noise.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from anhyst.compensate.block import Block
from anhyst.compensate.current_map import CurrentMap
from anhyst.compensate.force_controller import ForceController
from anhyst.compensate.methods import HysteresisInverse
from anhyst.compensate.plan import CompileRequest, make_plan
from anhyst.data import Loop, Loops
from anhyst.data.path import History
from anhyst.identification import identify
from anhyst.identification.run import require_complete
from anhyst.model.actuator import Model
from anhyst.support.atomic import PathLike
from anhyst.support.block_words import Scales
from anhyst.support.errors import InputError, NegativeResult
from anhyst.support.numeric import FloatArray, rms
from anhyst.support.result import rows_to_columns
from anhyst.support.units import QUANTITIES
from anhyst_rigs.rig.measuring import measure_stack_displacement
from anhyst_rigs.rig.piezo import (
    NOISE_SEED,
    PiezoRig,
    copy_at_rest,
    find_piezo_loss,
    make_notch,
    round_corners,
    triangle_wave,
)
from anhyst_rigs.rig.recording import Recording, peak_deviation
from anhyst_rigs.study.engine.beneficial_conditions import BENEFICIAL_CONDITIONS
from anhyst_rigs.study.engine.table import (
    FIGURES_FILE,
    ComparedFigure,
    Judgement,
    Metric,
    StudyResult,
    judge_against_baselines,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LOOP_PERIOD_S = 1.0
"""Duration of a full cycle of the loops, s."""
LOOP_SAMPLE_S = 1e-3
"""Sample interval of the loops, s."""
LOOP_RANGES = ((0.0, 1.0), (0.0, 1.0), (0.0, 0.8), (0.1, 0.8), (0.1, 0.8), (0.2, 0.6), (0.0, 1.0))
"""Lower and upper ends of the loops, relative to the range of the amplifier."""
CURVE_SEGMENTS = 4096
"""Number of linear segments of a single-valued curve."""
SETTLING_CYCLES = 2
"""Number of cycles before the evaluation, during which the feedback settles."""
COMPENSATION_TITLES = {
    "none": "none (a constant)",
    "single-valued": "best single-valued curve",
    "full": "inverse of play cells, compiled",
}


DEVIATION_METRICS = (
    Metric("worst_m", "deviation, worst", "nm", 1e9),
    Metric("rms_m", "deviation, rms", "nm", 1e9),
)
"""Metrics of the deviation from the reference in the evaluated part of a run."""


@dataclass(frozen=True, repr=False)
class PiezoTracking(StudyResult):
    """How a piezo stage follows its reference with each compensation.

    Attributes
    ----------
    rig : PiezoRig
    runs : mapping of str to Recording
        Recordings by compensation.
    """

    kind: ClassVar = "displacement"
    rig: PiezoRig
    runs: Mapping[str, Recording]

    @property
    def first_evaluated_tick(self) -> int:
        """First tick that is evaluated."""
        return first_evaluated_tick(self.rig)

    @cached_property
    def errors(self) -> Mapping[str, Mapping[str, float]]:
        """Deviations by compensation and by metric of :data:`DEVIATION_METRICS`."""
        deviations = {name: run["error_m"][self.first_evaluated_tick :] for name, run in self.runs.items()}
        return {
            name: {"worst_m": peak_deviation(deviation), "rms_m": rms(deviation)}
            for name, deviation in deviations.items()
        }

    @property
    def lost_in(self) -> list[str]:
        """Compensations that lost control, with time and reason."""
        return [f"{name} {run.loss_text}" for name, run in self.runs.items() if run.loss_text]

    def refuse_losses(self) -> None:
        """Raise NegativeResult if control was lost with ``full``."""
        if loss_text := self.runs["full"].loss_text:
            raise NegativeResult(
                f"control was lost {loss_text}: a bandwidth of "
                f"{self.rig.settings.displacement.bandwidth_Hz:g} Hz is too high for this stage; "
                "the recording is kept",
                code="loop-lost",
            )

    def deviation_ratio(self, key: str = "rms_m") -> float:
        """Return the deviation with ``full`` divided by the same deviation with a constant."""
        return self.errors["full"][key] / self.errors["none"][key]

    @property
    def verdict(self) -> Judgement:
        """Whether compensation is beneficial, judged by the rms deviation."""
        if self.lost_in:
            return Judgement("unknown", f"the loop was lost: {'; '.join(self.lost_in)}")
        return judge_deviation_ratio(self.deviation_ratio())

    def facts(self) -> dict[str, str]:
        """Return the deviation with every compensation as text."""
        facts = {
            name: f"worst {1e9 * errors['worst_m']:.0f} nm, rms {1e9 * errors['rms_m']:.0f} nm"
            for name, errors in self.errors.items()
        }
        return facts | self.losses_fact()

    def to_columns(self) -> dict[str, Any]:
        """Return the deviation with every compensation, m."""
        return rows_to_columns([{"compensation": name, **errors} for name, errors in self.errors.items()])

    def draw(self, ax: Axes) -> None:
        """Draw the deviation with every compensation over time."""
        for name, run in self.runs.items():
            ax.plot(run["t_s"], 1e9 * run["error_m"], lw=0.9, label=name)
        ax.set_xlabel("time [s]")
        ax.set_ylabel("deviation [nm]")

    def save(self, path: PathLike) -> Path:
        """Write time, reference and the signals with each compensation, and ``figures.json``."""
        first_run = next(iter(self.runs.values()))
        columns = {name: first_run[name] for name in ("t_s", "reference_m")}
        for name, run in self.runs.items():
            key = name.replace("-", "_")
            columns |= {
                f"u_{key}_V": run["voltage_V"],
                f"x_{key}_m": run["position_m"],
                f"e_{key}_m": run["error_m"],
            }
        self.write_figures(Path(path).parent / FIGURES_FILE)
        return Recording(columns).save(path)

    def as_dict(self) -> dict[str, Any]:
        """Return the metrics for JSON."""
        return {
            "lost_in": self.lost_in,
            "rms_with_over_without": self.deviation_ratio("rms_m"),
            "worst_with_over_without": self.deviation_ratio("worst_m"),
            "errors": dict(self.errors),
        }


def simulate_tracking(rig: PiezoRig) -> PiezoTracking:
    """Identify and compile all inverses, and follow the triangle with each of them."""
    target, inverses = make_reference(rig), find_inverses(rig)
    return PiezoTracking(
        rig, {name: follow_reference(rig, target, inverse) for name, inverse in inverses.items()}
    )


def first_evaluated_tick(rig: PiezoRig) -> int:
    """Return the first tick that is evaluated."""
    return round(SETTLING_CYCLES * rig.settings.timing.rate_Hz / rig.settings.displacement_case.frequency_Hz)


def find_inverses(rig: PiezoRig, loops: Loops | None = None) -> dict[str, ForceController]:
    """Return all inverses from displacement to voltage, from given loops or from measured ones."""
    try:
        make_notch(rig.settings)  # report faults before the computation
    except InputError as error:
        raise error.with_location(rig.path) from error
    loops = loops or measure_stage_loops(rig)
    model = require_complete(identify(loops)).model
    target = make_reference(rig)
    max_displacement_m = float(loops.loops[0].output.max())
    if target.max() > max_displacement_m:
        raise InputError(
            f"{rig.path}: case: the triangle reaches {1e6 * target.max():.3g} um, the stack "
            f"{1e6 * max_displacement_m:.3g} um; lower low_m or stroke_m",
            code="reference-too-far",
            key="case",
        )
    return {
        "none": _constant_inverse(loops, rig),
        "single-valued": _single_valued_inverse(loops, rig),
        "full": _compiled_inverse(model, rig),
    }


def measure_stage_loops(rig: PiezoRig) -> Loops:
    """Measure loops of the virtual stage with its sensor, after a long rest at 0 V."""
    max_voltage = rig.settings.stack_amplifier.high_V
    rate_V_per_s = 2.0 * max_voltage / LOOP_PERIOD_S
    points = max_voltage * np.array(
        [0.0, *(end for low, high in LOOP_RANGES for end in (low, high, low)), 0.0]
    )
    point_times = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(points)) / rate_V_per_s)])
    time = np.arange(0.0, point_times[-1], LOOP_SAMPLE_S)
    drive = np.interp(time, point_times, points)
    displacement = measure_stack_displacement(rig, drive, LOOP_SAMPLE_S, NOISE_SEED)
    loop = Loop("loops", drive, displacement, None, time, History.parse("conditioned:0"))
    return Loops((loop,), QUANTITIES["voltage"], QUANTITIES["displacement"])


def make_reference(rig: PiezoRig) -> FloatArray:
    """Return the triangle with rounded corners, which begins at rest at its low end, m."""
    triangle_case, rate = rig.settings.displacement_case, rig.settings.timing.rate_Hz
    ticks = round(triangle_case.cycles * rate / triangle_case.frequency_Hz)
    displacement = triangle_case.low_m + triangle_case.stroke_m * triangle_wave(
        np.arange(ticks, dtype=np.float64) * triangle_case.frequency_Hz / rate
    )
    return round_corners(
        np.concatenate([np.full(rig.corner_ticks, displacement[0]), displacement]), rig.corner_ticks
    )


def _constant_inverse(loops: Loops, rig: PiezoRig) -> ForceController:
    drive, displacement = (np.concatenate([getattr(loop, name) for loop in loops.loops])
                     for name in ("input", "output"))  # fmt: skip
    slope, offset = np.polyfit(displacement, drive, 1)
    return _make_curve_inverse(rig, np.polynomial.Polynomial([offset, slope]), float(displacement.max()), 1)


def _single_valued_inverse(loops: Loops, rig: PiezoRig) -> ForceController:
    """Return the best curve without hysteresis: the voltage as a polynomial of degree 5."""
    loop = loops.loops[0]
    curve = np.polynomial.Polynomial.fit(loop.output, loop.input, 5)
    return _make_curve_inverse(rig, curve, float(loop.output.max()), CURVE_SEGMENTS)


def _make_curve_inverse(
    rig: PiezoRig, curve: np.polynomial.Polynomial, max_displacement_m: float, segments: int
) -> ForceController:
    """Return a curve for displacements from 0 to a maximum (m) as a monotone table."""
    voltages = np.maximum.accumulate(curve(np.linspace(0.0, max_displacement_m, segments + 1)))
    amplifier = rig.settings.stack_amplifier
    scales = Scales(max_displacement_m, amplifier.high_V, 0.0, 1.0)
    curves = CurrentMap(np.array([voltages, voltages]), scales, (amplifier.low_V, amplifier.high_V))
    return ForceController("ratio" if segments == 1 else "single-valued", "f64", curves)


def _compiled_inverse(model: Model, rig: PiezoRig) -> ForceController:
    """Return the compiled inverse of the model in fixed point, with signals of 32 bits."""
    request = CompileRequest("full", "q15", rig.settings.timing.rate_Hz)
    plan = make_plan(replace(model, dynamics=None), request, 0)
    assert isinstance(plan.block, Block)
    return ForceController("full", "fixed", HysteresisInverse(plan.block, plan.sizes.iterations))


def follow_reference(
    rig: PiezoRig,
    target: FloatArray,
    inverse: ForceController,
    plant: PiezoRig | None = None,
    noise_seed: int = NOISE_SEED,
) -> Recording:
    """Run the loop with feedforward of the reference, an integrator, and one sample of delay.

    ``plant`` replaces the nominal plant.
    """
    noise = rig.settings.position_sensor.noise_m * np.random.default_rng(noise_seed).standard_normal(
        target.size
    )
    time = rig.dt * np.arange(target.size, dtype=np.float64)
    expected_position = np.interp(time - rig.response_delay, time, target)
    loop = rig.make_loop(plant or rig, copy_at_rest(inverse))
    table = loop.run(target, expected_position, noise, np.zeros(target.size))
    position, _, controller_output, voltage = table.T.copy()
    error = position - expected_position
    columns = {
        "t_s": time,
        "reference_m": target,
        "position_m": position,
        "error_m": error,
        "voltage_V": voltage,
    }
    return Recording(columns, find_piezo_loss(rig, error, controller_output - target))


MAX_WORTHWHILE_DEVIATION_RATIO = 0.5
"""Ratio of the deviations with and without compensation, below which compensation is beneficial."""


def judge_deviation_ratio(deviation_ratio: float) -> Judgement:
    """Return the verdict for a ratio of the deviations with and without compensation."""
    compared_figure = ComparedFigure(
        "rms", "no compensation", deviation_ratio, 1.0, 1.0 - MAX_WORTHWHILE_DEVIATION_RATIO
    )
    return judge_against_baselines(
        "compensation", [compared_figure], "measures", BENEFICIAL_CONDITIONS["piezo"]
    )
