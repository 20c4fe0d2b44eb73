"""Compare models with and without eddy-current layers on magnets of solid iron.

The magnets are not simulated with the layer model. The static model is identified from the slow
loops only. The compared gaps and rates were not fitted. ``python benchmarks/solid.py FILE.png``
draws docs/img/rate.png.
"""

from __future__ import annotations

import sys
import time
import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from anhyst.compensate.force_controller import SignalFormat, make_twin
from anhyst.compensate.plan import CompileRequest, make_plan
from anhyst.data import Loop
from anhyst.data.speeds import group_by_speed
from anhyst.identification import identify
from anhyst.model.actuator import Model
from anhyst.support.figures import MEASURED_COLOUR, PALETTE
from anhyst.support.kinds import MethodName
from anhyst_rigs.rig.bearing.loop import make_setup
from anhyst_rigs.rig.drift import change_rig
from anhyst_rigs.rig.fitting import identify_magnet
from anhyst_rigs.rig.magnet_table import SolidTable
from anhyst_rigs.rig.measuring import measure_loops
from anhyst_rigs.rig.stage.file import read_stage
from anhyst_rigs.rig.stage.fitted import make_stage
from anhyst_rigs.rig.stage.loop import track
from anhyst_rigs.rig.stage.setpoint import scan_motion
from anhyst_rigs.study.bearing.inputs import read_files
from anhyst_rigs.study.bearing.responses import StepCell, compare_steps
from anhyst_rigs.study.tracking.gains import find_gains
from anhyst_rigs.study.tracking.measures import Measures, measure
from rows import ROOT, Row
from solid_magnets import FIRST_RINGED_MAGNET, MAGNET_COUNT, SolidMagnet, solid_magnet
from speed_magnets import SPEEDS, Deviations, find_deviations
from tracking import IRONS, RIG, with_iron

TICKS_PER_SECOND, CYCLES, FORCE_BAND = 20_000.0, 4, (0.1, 0.5)
"""Open loop: ticks per second, number of cycles, and force range relative to the largest static
force."""

DEVIATION_TARGETS = {"1 Hz": (0.12, 0.6), "20 Hz": (0.35, 1.2), "100 Hz": (0.9, 3.0), "random": (0.4, 2.5)}
"""Targets: mean and worst deviation, % of the largest force."""


STAGE_METHODS: tuple[MethodName, ...] = ("single-valued", "at-rest", "full", "flux")
"""Methods that are compared on a stage; the last method uses a flux probe in the gap."""
STAGE_IRONS = ("cells", "preisach-usual", "duhem-usual")
STAGE_SOLID = SolidTable(depth_m=4e-3, conductivity_S_per_m=2e6, path_m=0.05)
STAGE_FAST = [45.0, 450.0, 1350.0]  # A/s: full triangles of 5, 50 and 150 Hz
SOLID_BEARING_PARTS = ((4e-3, 0.05), (8e-3, 0.05), (6e-3, 0.1), (10e-3, 0.15))
"""Depth and path length of the solid part of the bearing's magnet, m; conductivity 2e6 S/m."""
BEARING_STEP, BEARING_SEEDS = 50e-6, (1, 2, 3)


@dataclass(frozen=True)
class MagnetResult:
    """Mean and worst deviation of one magnet, % of the largest force, without and with layers."""

    number: int
    static_deviations: Deviations
    layer_deviations: Deviations
    slow_rms_ratio: float  # ratio of the rms error of the slow loops with layers to that without
    seconds: float
    chosen_model: str
    open_loop_errors: tuple[float, float]  # worst open-loop error, % of F_max: with layers, static


def evaluate_magnet(number: int) -> MagnetResult:
    """Identify a magnet and evaluate both models on records that were not fitted."""
    magnet = solid_magnet(number)
    loops = magnet.measure_loops()
    speed_groups = group_by_speed(loops)
    assert speed_groups is not None
    start_time = time.process_time()
    model = identify(loops).model
    identify_seconds = time.process_time() - start_time
    static_model = identify(speed_groups.slow).model
    largest = max(float(np.max(loop.output)) for loop in loops.loops)
    records = magnet.comparison_records()
    static_deviations, layer_deviations = (
        find_deviations(candidate_model, records, largest) for candidate_model in (static_model, model)
    )
    assert model.fit is not None
    assert static_model.fit is not None
    with_layers = [loop.rms for loop in model.fit.loops if loop.label.startswith(f"{SPEEDS[0]:g} ")]
    slow_rms_ratio = float(np.sqrt(np.mean(np.square(with_layers))) / static_model.fit.rms)
    chosen_model = f"{model.law}, {model.gap_map}, layers {model.layers}"
    open_loop_errors = (
        open_loop(magnet, model, magnet.middle_gap),
        open_loop(magnet, model.at_rest, magnet.middle_gap),
    )
    return MagnetResult(
        number,
        static_deviations,
        layer_deviations,
        slow_rms_ratio,
        identify_seconds,
        chosen_model,
        open_loop_errors,
    )


def open_loop(magnet: SolidMagnet, model: Model, gap: float, io: SignalFormat = "f32") -> float:
    """Return the worst error of the last of several 50 Hz force triangles, % of the largest force.

    The armature is held, and the current equals the output of the compensator.
    """
    plan = make_plan(model, CompileRequest("full", io, TICKS_PER_SECOND), 0)
    static_force = float(
        model.at_rest.predict([0.0, magnet.largest_current], gap, history="demagnetised").output[-1]
    )
    ticks = round(TICKS_PER_SECOND / SPEEDS[-1])
    cycle_time = np.arange(CYCLES * ticks) / ticks
    force_fraction = FORCE_BAND[0] + (FORCE_BAND[1] - FORCE_BAND[0]) * (
        1.0 - np.abs(2.0 * (cycle_time % 1.0) - 1.0)
    )
    demand = static_force * force_fraction * np.minimum(2.0 * cycle_time, 1.0)
    current = make_twin(plan.block, io).run(demand, np.full(demand.size, gap))
    force = magnet.run(current, np.full(demand.size, gap), np.arange(demand.size) / TICKS_PER_SECOND)
    errors = np.abs(force - demand)[-ticks:]
    return 100.0 * float(errors.max()) / plan.reference_output


def run_on_stage(iron: str) -> dict[MethodName, Measures]:
    """Run the test set-point on a stage of solid iron, with gains of the training set-point."""
    rig = read_stage(RIG)
    if iron != "cells":
        rig = with_iron(rig, tomllib.loads(IRONS.read_text(encoding="utf-8"))[iron])
    rig = change_rig(
        rig,
        {
            "magnet.solid": STAGE_SOLID,
            "measurement.fast_A_per_s": STAGE_FAST,
            "force_sensor.bandwidth_Hz": 20e3,  # no sensor lag that could be attributed to the iron
            "control.format": "f64",
        },
    )
    magnet = identify_magnet(measure_loops(rig), rig.settings.loops)
    scan, errors_by_method = rig.settings.scan, {}
    train, test = (
        scan_motion(scan, accelerations) for accelerations in (scan.train_m_per_s2, scan.test_m_per_s2)
    )
    for name in STAGE_METHODS:
        setup = make_stage(rig, magnet, name)
        errors_by_method[name] = measure(track(setup, test, find_gains(setup, train), 1), test, scan.slit_s)
    return errors_by_method


def stage_rows() -> list[Row]:
    """Return the rows of the benefit of the layer model on a stage."""
    rows = []
    for iron in STAGE_IRONS:
        stage_errors = run_on_stage(iron)
        for title, name, factor, unit in (
            ("moving average", "average_m", 1e9, "nm"),
            ("peak", "peak_m", 1e9, "nm"),
            ("force, rms", "force_rms_N", 1.0, "N"),
        ):
            value = {method: factor * getattr(measures, name) for method, measures in stage_errors.items()}
            benefit_ratio = value["full"] / value["at-rest"]
            values_text = ", ".join(f"{method} {method_value:.3g}" for method, method_value in value.items())
            rows.append(
                Row(
                    f"stage on solid iron, {iron}: {title}",
                    "<= 1/3 times at-rest",
                    f"{benefit_ratio:.2g}; {values_text} {unit}",
                    benefit_ratio <= 1.0 / 3.0,
                )
            )
    return rows


def run_on_bearing(depth: float, path: float) -> dict[MethodName, StepCell]:
    """Run steps of the bearing with solid iron and its unchanged fixed-point controller."""
    rig, controller = read_files(ROOT / "examples" / "bearing" / "rig.toml", None)
    rig = change_rig(
        rig,
        {
            "magnet.solid": SolidTable(depth_m=depth, conductivity_S_per_m=2e6, path_m=path),
            "measurement.fast_A_per_s": STAGE_FAST,
            "force_sensor.bandwidth_Hz": 20e3,
        },
    )
    magnet = identify_magnet(measure_loops(rig), rig.settings.loops)
    setups = [make_setup(rig, controller.settings, magnet, name, "fixed") for name in STAGE_METHODS]
    cells = compare_steps(
        setups, [rig.settings.gap_m], [BEARING_STEP], [rig.static_load], BEARING_SEEDS, jobs=1
    )
    return dict(zip(STAGE_METHODS, cells, strict=True))


def bearing_rows() -> list[Row]:
    """Return the rows of the benefit of the layer model on a bearing."""
    rows = []
    for depth, path in SOLID_BEARING_PARTS:
        bearing_results = run_on_bearing(depth, path)
        force = {name: cell.interval("force_error_rms_N").mean for name, cell in bearing_results.items()}
        values_text = "; ".join(
            f"{name} {force[name]:.3g} N, {cell.interval('overshoot_percent').mean:.2g} %, "
            f"{1e9 * cell.interval('standstill_rms_m').mean:.3g} nm"
            for name, cell in bearing_results.items()
        )
        rows.append(
            Row(
                f"bearing, {1e3 * depth:g} mm deep, {1e3 * path:g} mm solid path, one step: "
                "rms force error; overshoot; standstill (nan: levitation lost)",
                "force error <= 0.8 times at-rest",
                values_text,
                force["full"] <= 0.8 * force["at-rest"],
            )
        )
    return rows


def rows() -> list[Row]:
    """Evaluate all magnets; inspected and uninspected magnets have separate rows."""
    results = [evaluate_magnet(number) for number in range(MAGNET_COUNT)]
    lines = []
    for title, is_odd in (("looked at", 0), ("not looked at", 1)):
        group = [result for result in results if result.number % 2 == is_odd]
        for name, (mean, worst) in DEVIATION_TARGETS.items():
            lines.append(
                Row(
                    f"solid iron, {name}, magnets {title}: mean / worst, % of F_max",
                    f"<= {mean:g} / {worst:g}",
                    "; ".join(
                        f"{result.layer_deviations[name][0]:.2f} / {result.layer_deviations[name][1]:.2f} "
                        f"(at rest {result.static_deviations[name][0]:.2f} / {result.static_deviations[name][1]:.2f}"
                        f"{', rings' if result.number >= FIRST_RINGED_MAGNET else ''})"
                        for result in group
                    ),
                    all(
                        result.layer_deviations[name][0] <= mean and result.layer_deviations[name][1] <= worst
                        for result in group
                    ),
                )
            )
        lines.append(
            Row(
                f"slow loops, ratio of rms errors with layers / static, magnets {title}",
                "<= 1.2",
                "; ".join(f"{result.slow_rms_ratio:.2f} ({result.chosen_model})" for result in group),
                all(result.slow_rms_ratio <= 1.2 for result in group),
            )
        )
    for title, is_odd in (("looked at", 0), ("not looked at", 1)):
        pairs = [result.open_loop_errors for result in results if result.number % 2 == is_odd]
        lines.append(
            Row(
                f"50 Hz force triangle, ratio of errors with layers / static, compiled, magnets {title}",
                "<= 0.2",
                "; ".join(
                    f"{layers_error:.2f} / {static_error:.2f} %" for layers_error, static_error in pairs
                ),
                all(layers_error <= 0.2 * static_error for layers_error, static_error in pairs),
            )
        )
    largest_seconds = max(result.seconds for result in results)
    choice_text = (
        f"median {np.median([result.seconds for result in results]):.1f} s, worst {largest_seconds:.1f} s"
    )
    lines.append(
        Row("identify, nine records", "<= 10 s", choice_text, largest_seconds <= 10.0, largest_seconds)
    )
    return lines + stage_rows() + bearing_rows()


def draw(path: Path, magnet: SolidMagnet) -> None:
    """Draw loops at three rates with the model, and the flux of the layers at the highest rate."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    model = identify(magnet.measure_loops()).model
    gap = magnet.gaps[0]
    figure, (loop_axes, layer_axes) = plt.subplots(1, 2, figsize=(9.0, 3.8), layout="constrained")
    for rate, colour in zip(
        (0.5, 20.0, 100.0), (MEASURED_COLOUR, PALETTE["blue"], PALETTE["vermilion"]), strict=True
    ):
        loop = magnet.cycle(rate, gap)
        predicted_force = model.predict(loop.input, gap, loop.time, "settled").output
        loop_axes.plot(loop.input, loop.output, color=colour, lw=2.5, alpha=0.5, label=f"{rate:g} Hz")
        loop_axes.plot(loop.input, predicted_force, color=colour, lw=1.0)
    loop_axes.set(xlabel="current, A", ylabel="force, N")
    loop_axes.legend(title="wide: magnet, thin: model")
    _draw_layers(layer_axes, model, magnet.cycle(50.0, gap), gap)
    figure.savefig(path, dpi=110)


def _draw_layers(axes: object, model: Model, loop: Loop, gap: float) -> None:
    """Draw the field of each layer over two cycles, the surface first."""
    from matplotlib.axes import Axes

    assert isinstance(axes, Axes)
    assert model.layers is not None
    assert loop.time is not None
    step = float(loop.time[1])
    drive = np.tile(loop.input, 3)
    stepper = model.stepper(gap, "demagnetised")
    fields = []
    for amperes in drive:
        stepper.commit(float(amperes), gap, step)
        memories = stepper.state.reshape(model.layers.state_copies, -1)
        fields.append(memories[:-1, 0])
    clock = 1e3 * step * np.arange(loop.n)
    for layer, field in enumerate(np.array(fields)[-loop.n :].T):
        name = (
            "surface" if layer == 0 else "middle" if layer == model.layers.count - 1 else f"layer {layer + 1}"
        )
        axes.plot(clock, field, color=list(PALETTE.values())[layer], lw=1.4, label=name)
    axes.set(xlabel="time, ms", ylabel="field in the layer, A/m (model's gauge)", title="50 Hz")
    axes.legend()


if __name__ == "__main__":
    draw(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs/img/rate.png", solid_magnet(0))
