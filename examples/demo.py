"""Run the bundled examples against their strongest baselines: ``make demo``.

- electromagnet: identify a model from loops at four gaps; evaluate it at two withheld gaps, and by a
  force demand whose current drives the simulated magnet
- controller: compile this model to 16-bit fixed-point C and run it on an emulated Cortex-M4
- bearing: four steps with position feedback, where compensation has no benefit
- stage: set-points with feedforward, where compensation has the largest benefit

The results form one table and one picture in ``demo/``, with longer tables as text files. The
baseline of the electromagnet is the best possible single-valued curve. It is fitted to true loops
of the gap at which it is evaluated, while the model is fitted only to loops of other gaps. Bearing
and stage use all noise seeds of their rig files. Only ``anhyst simulate`` runs all variants and
experiments.
"""

from __future__ import annotations

import argparse
import importlib.util
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from rich import box
from rich.console import Console
from rich.table import Table

from anhyst.compensate.plan import CompileRequest
from anhyst.compilation.output import compile_model
from anhyst.data import Loops
from anhyst.data.reading import read_loops
from anhyst.data.verdict import fit_monotone, single_valued_residuals
from anhyst.identification import identify
from anhyst.model.actuator import Model, read_model
from anhyst.model.writer import write_model
from anhyst.reports import write_report
from anhyst.support.jobs import map_ordered
from anhyst.support.kinds import MethodName
from anhyst.support.numeric import FloatArray
from anhyst.support.result import style_axes
from anhyst.verification import verify
from anhyst_rigs.reports.study.page import interval_text, line_style
from anhyst_rigs.rig.bearing.loop import make_setups
from anhyst_rigs.rig.bearing.scenario import plan_steps
from anhyst_rigs.rig.fitting import identify_magnet
from anhyst_rigs.rig.loop import SimulatedLoop
from anhyst_rigs.rig.recording import Recording
from anhyst_rigs.rig.stage.file import read_stage
from anhyst_rigs.rig.stage.loop import StageSetup, track
from anhyst_rigs.rig.stage.setpoint import scan_motion
from anhyst_rigs.study.bearing.inputs import check_inputs, read_files
from anhyst_rigs.study.bearing.responses import compare_steps, default_seeds, group_by_step, judge_steps
from anhyst_rigs.study.engine.beneficial_conditions import BENEFICIAL_CONDITIONS
from anhyst_rigs.study.engine.table import VERDICT_TITLES, Interval, mean_interval, strongest_baseline
from anhyst_rigs.study.tracking.gains import find_gains
from anhyst_rigs.study.tracking.measures import Measures, measure
from anhyst_rigs.study.tracking.simulate import make_variants

Array = FloatArray

EXAMPLES = Path(__file__).parent
ELECTROMAGNET = EXAMPLES / "electromagnet"
DEMAND_GAP_M = 0.45e-3
"""Gap of the force demand, m, as in Figs. 2 and 5 of the paper; no loop has this gap."""
BEARING_METHODS: tuple[MethodName, ...] = ("ratio", "linearised", "single-valued", "play", "full")
STAGE_METHODS: tuple[MethodName, ...] = ("single-valued", "play", "full", "flux")
CURVE_TITLE = "best curve without memory"
BASELINE_TITLES: Mapping[MethodName, str] = {
    "ratio": "constant ratio",
    "linearised": "two constants",
    "single-valued": CURVE_TITLE,
    "play": "map with one play",
    "flux": "measured flux (Hall)",
}


@dataclass(frozen=True)
class Deviation:
    """Mean and largest absolute deviation, N."""

    mean_deviation: float
    largest_deviation: float

    @classmethod
    def of(cls, residuals: list[Array]) -> Deviation:
        """Compute the metrics over all samples of several records."""
        magnitudes = np.abs(np.concatenate(residuals))
        return cls(float(magnitudes.mean()), float(magnitudes.max()))


def load_magnet() -> ModuleType:
    """Load the script that simulates the magnet."""
    name = "anhyst_example_magnet"
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, ELECTROMAGNET / "make_loops.py")
        assert spec is not None
        assert spec.loader is not None
        sys.modules[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules[name])
    return sys.modules[name]


def unseen_deviation(model: Model, truth: Loops) -> Deviation:
    """Return the deviation of a model from noise-free loops at withheld gaps."""
    return Deviation.of(
        [
            model.predict(loop.input, loop.schedule, loop.time, loop.history).output - loop.output
            for loop in truth.loops
        ]
    )


def unseen_single_valued(truth: Loops) -> Deviation:
    """Return the deviation of the best single-valued curves, fitted to these loops themselves."""
    return Deviation.of([residual for _, residual in single_valued_residuals(truth)])


def triangle(low: float, high: float, samples: int = 400) -> Array:
    """Return one cycle of a triangular demand, from low to high and back."""
    rising_half = np.linspace(low, high, samples // 2, endpoint=False)
    return np.concatenate([rising_half, rising_half[::-1] + (high - low) / (samples // 2)])


def run_magnet(current: Array, gap: float) -> Array:
    """Return the true force, N, in the fourth cycle of a current minus the sensor's offset."""
    magnet, settings = load_magnet().load()
    true_current = np.maximum(current - settings["sensors"]["current_offset_A"], 0.0)
    cycles = settings["drive"]["conditioning_cycles"] + 1
    force = np.array([magnet.step(i, gap) for i in np.tile(true_current, cycles)])
    return force[-current.size :]


def single_valued_inverse(gap: float) -> tuple[Array, Array]:
    """Return the best single-valued inverse (force, current), fitted to true loops at a gap."""
    module = load_magnet()
    _, settings = module.load()
    largest = settings["drive"]["current_max_A"]
    offset = settings["sensors"]["current_offset_A"]
    loop_arrays = []
    for loop in settings["identification"]["loops"]:
        magnet, _ = module.load()
        current, force, _ = module.settled_loop(
            magnet, gap, loop["low"] * largest, loop["high"] * largest, settings
        )
        loop_arrays.append((force, current + offset))
    force, current = (np.concatenate(arrays) for arrays in zip(*loop_arrays, strict=True))
    order = np.argsort(force, kind="stable")
    return force[order], fit_monotone(current[order], np.ones(order.size))


def demand_deviation(model: Model) -> tuple[Deviation, Deviation, float]:
    """Compare the true force with an open-loop demand at a gap between the measured ones.

    Returns
    -------
    tuple
        Deviation with the model inverted, with the single-valued inverse, and the largest force at
        that gap, N.
    """
    force, current = single_valued_inverse(DEMAND_GAP_M)
    largest_force = float(force[-1])
    demand = triangle(0.05 * largest_force, 0.95 * largest_force)
    inverse = model.invert(demand, DEMAND_GAP_M, history="settled")
    model_error = run_magnet(inverse.drive, DEMAND_GAP_M) - demand
    curve_error = run_magnet(np.interp(demand, force, current), DEMAND_GAP_M) - demand
    return Deviation.of([model_error]), Deviation.of([curve_error]), largest_force


@dataclass(frozen=True)
class TableLine:
    """One row of the table: the errors with anhyst and with a baseline, and the baseline's name."""

    title: str
    anhyst_text: str
    baseline_text: str
    baseline_name: str
    ratio_text: str

    @classmethod
    def of(
        cls,
        title: str,
        anhyst_error: float,
        baseline_error: float,
        baseline_name: str,
        unit: str,
        decimal_places: int = 2,
    ) -> TableLine:
        """Compare two errors."""
        anhyst_text, baseline_text = (
            f"{value:.{decimal_places}f} {unit}" for value in (anhyst_error, baseline_error)
        )
        ratio_text = (
            f"1/{baseline_error / anhyst_error:.0f}" if baseline_error > 1.5 * anhyst_error else "no gain"
        )
        return cls(title, anhyst_text, baseline_text, baseline_name, ratio_text)


@dataclass(frozen=True)
class ExampleResult:
    """The results of one example: rows of the table, panel of the picture, and remark."""

    table_lines: list[TableLine]
    draw_panel: Callable[[Axes], None] | None = None
    remark: str = ""


@contextmanager
def print_step(title: str) -> Iterator[None]:
    """Print the name of a step and, at its end, its duration."""
    print(f"demo: {title} ...", end="", flush=True)
    start_time = time.perf_counter()
    yield
    print(f" {time.perf_counter() - start_time:.1f} s", flush=True)


def run_electromagnet(output_folder: Path) -> ExampleResult:
    """Identify a model from loops, write its report and evaluate it at withheld gaps."""
    with print_step("electromagnet: identify a model from 16 loops at four gaps"):
        identification = identify(read_loops(ELECTROMAGNET / "loops.csv"))
        write_model(identification.model, output_folder / "model.toml")
    with print_step("electromagnet: write a report, evaluate the model at withheld gaps"):
        write_report(output_folder / "model.toml", output_folder / "report.html")
        # The evaluation uses the model from the file, not the model in memory.
        model = read_model(output_folder / "model.toml")
        truth = read_loops(ELECTROMAGNET / "unseen_truth.csv")
        largest = max(float(np.max(loop.output)) for loop in truth.loops)
        model_deviation, curve_deviation = unseen_deviation(model, truth), unseen_single_valued(truth)
        inverse_deviation, curve_inverse_deviation, max_force = demand_deviation(model)
    lines = []
    for title, own_error, curve_error, reference_force in (
        ("force, unseen gaps, mean", model_deviation.mean_deviation, curve_deviation.mean_deviation, largest),
        (
            "force on demand, worst",
            inverse_deviation.largest_deviation,
            curve_inverse_deviation.largest_deviation,
            max_force,
        ),
    ):
        lines.append(
            TableLine.of(
                title,
                100 * own_error / reference_force,
                100 * curve_error / reference_force,
                CURVE_TITLE,
                "%",
            )
        )
    return ExampleResult(lines, lambda ax: draw_loop(ax, model, truth))


def draw_loop(ax: Axes, model: Model, truth: Loops) -> None:
    """Draw the errors of model and single-valued curve on the widest loops of a withheld gap."""
    loop, residual = max(single_valued_residuals(truth), key=lambda pair: float(np.ptp(pair[0].output)))
    predicted = model.predict(loop.input, loop.schedule, loop.time, loop.history).output
    ax.plot(loop.input, residual, label=CURVE_TITLE, **line_style("single-valued"))
    ax.plot(loop.input, loop.output - predicted, label="anhyst", **line_style("full"))
    gap = loop.schedule_value
    where = "" if gap is None else f" at {1e3 * gap:g} mm (withheld)"
    ax.set(title=f"electromagnet{where}", xlabel="current [A]", ylabel="force error [N]")


def compile_and_verify(model: Path, folder: Path) -> ExampleResult:
    """Compile a model to C and run the C on an emulated Cortex-M4."""
    with print_step("controller: compile the model to C, run it on an emulated Cortex-M4"):
        request = CompileRequest("full", "q15", rate=20e3, accuracy=0.2, name="electromagnet")
        compilation = compile_model(model, folder, request)
        verification = verify(folder, "cortex-m4")
    cost = verification.results[0].cost("solve")
    assert cost is not None
    worst = compilation.manifest["accuracy"]["worst_percent"]
    bits = "0 bits unlike the PC's" if verification.passed else "BITS UNLIKE THE PC'S"
    return ExampleResult(
        [
            TableLine("16-bit C, Cortex-M4, worst", f"{worst:.2f} %", "", bits, ""),
            TableLine("16-bit C, instructions", str(cost.most), "", "at most", ""),
        ]
    )


def run_bearing(output_folder: Path) -> ExampleResult:
    """Run steps of the bearing with position feedback and every compensation method."""
    with print_step(f"bearing: simulate steps with {len(BEARING_METHODS)} methods"):
        rig, controller = read_files(EXAMPLES / "bearing" / "rig.toml", None)
        inputs = check_inputs(rig, controller)
        rig, settings = inputs.rig, inputs.rig.settings
        setups = make_setups(rig, controller, inputs.identify_magnet(), BEARING_METHODS)
        load = rig.settings.load.force_N
        noise_seeds = default_seeds(rig)
        cells = compare_steps(
            list(setups.values()), [settings.gap_m], settings.step.heights_m, [load], noise_seeds
        )
    steps = group_by_step(cells)
    last_step = steps[-1]
    overshoot = last_step.figure("overshoot_percent")
    baseline_name = strongest_baseline(last_step.figure("overshoot_percent"))
    assert baseline_name is not None
    write_table(
        output_folder / "table.txt",
        f"overshoot, % of the step; {len(noise_seeds)} noise seeds",
        [f"{1e6 * cell.height:g} um" for cell in steps],
        {name: [interval_text(cell.figure("overshoot_percent")[name]) for cell in steps] for name in setups},
    )
    line = TableLine.of(
        f"bearing, {1e6 * last_step.height:g} um, overshoot",
        overshoot["full"].mean,
        overshoot[baseline_name].mean,
        BASELINE_TITLES[baseline_name],
        "%",
    )
    scenario = plan_steps(rig, controller.settings, settings.gap_m, settings.step.heights_m[-1:])
    runs = {name: SimulatedLoop(setups[name]).run(scenario) for name in (baseline_name, "full")}

    def draw(ax: Axes) -> None:
        first_tick, end = scenario.steps[0].begin, scenario.steps[0].end
        shown_range = slice(first_tick - 40, min(first_tick + 400, end))
        for name, run in runs.items():
            time = 1e3 * (run["t_s"][shown_range] - run["t_s"][first_tick])
            label = "anhyst" if name == "full" else BASELINE_TITLES[name]
            ax.plot(time, 1e3 * run["gap_m"][shown_range], label=label, **line_style(name))
        title = "bearing: feedback corrects the hysteresis"
        ax.set(title=title, xlabel="time [ms]", ylabel="gap [mm]")

    judgement = judge_steps(steps, "full")
    remark = (
        ""
        if judgement.level == "yes"
        else f"bearing: {VERDICT_TITLES[judgement.level].lower()}; {BENEFICIAL_CONDITIONS['feedback']}"
    )
    return ExampleResult([line], draw, remark)


@dataclass(frozen=True)
class TrackingResult:
    """A variant on the test set-point: metrics of each noise seed, recording of the first seed."""

    measures: list[Measures]
    shown_run: Recording

    def of(self, name: str) -> Interval:
        """Return the mean of a metric over the seeds, with its interval."""
        return mean_interval([getattr(measures, name) for measures in self.measures])


def track_test_set_point(setup: StageSetup) -> TrackingResult:
    """Find the feedforward gains on one set-point and follow another set-point with them."""
    table = setup.rig.settings.scan
    gains = find_gains(setup, scan_motion(table, table.train_m_per_s2))
    motion = scan_motion(table, table.test_m_per_s2)
    runs = [track(setup, motion, gains, seed) for seed in range(1, setup.rig.settings.noise_seeds + 1)]
    return TrackingResult([measure(run, motion, table.slit_s) for run in runs], runs[0])


def run_stage(output_folder: Path) -> ExampleResult:
    """Let a stage with feedforward follow set-points with every compensation method."""
    with print_step(f"stage: simulate set-points with feedforward and {len(STAGE_METHODS)} methods"):
        rig = read_stage(EXAMPLES / "stage" / "rig.toml")
        magnet = identify_magnet(rig.measured_loops.read(), rig.settings.loops)
        setups, _ = make_variants(rig, magnet, STAGE_METHODS)
        results = dict(zip(setups, map_ordered(track_test_set_point, list(setups.values())), strict=True))
    columns = {"peak, nm": ("peak_m", 1e9), "moving average, nm": ("average_m", 1e9)}
    columns |= {"50 nm, ms": ("settling_50_s", 1e3), "force rms, N": ("force_rms_N", 1.0)}
    write_table(
        output_folder / "table.txt",
        f"error on the test set-point; {rig.settings.noise_seeds} noise seeds",
        list(columns),
        {
            name: [
                interval_text(measures.of(key), factor=unit_factor) for key, unit_factor in columns.values()
            ]
            for name, measures in results.items()
        },
    )
    model_peak_nm = 1e9 * results["full"].of("peak_m").mean
    lines = [
        TableLine.of(
            "stage, peak error",
            model_peak_nm,
            1e9 * measures.of("peak_m").mean,
            BASELINE_TITLES[name],
            "nm",
            0,
        )
        for name, measures in results.items()
        if name != "full"
    ]

    def draw(ax: Axes) -> None:
        for name in ("single-valued", "play", "full"):
            run = results[name].shown_run
            label = "anhyst" if name == "full" else BASELINE_TITLES[name]
            ax.plot(1e3 * run["t_s"], 1e6 * run["error_m"], label=label, **line_style(name))
        title = "stage: feedforward does not correct it"
        ax.set(title=title, xlabel="time [ms]", ylabel="position error [um]")

    return ExampleResult(lines, draw)


def write_table(path: Path, title: str, columns: list[str], rows: Mapping[MethodName, list[str]]) -> None:
    """Write a table to a text file, because the common table has no space for it."""
    title += ", 95 % intervals; the method of anhyst is 'full'"
    table = Table("", *columns, title=title, title_justify="left", box=box.SIMPLE_HEAD)
    for name, values in rows.items():
        table.add_row(name, *values)
    with path.open("w", encoding="utf-8") as file:
        Console(file=file, width=110).print(table)


def make_results_table(results: list[ExampleResult]) -> Table:
    """Return the table with the rows of all examples."""
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False, show_edge=False)
    for name in ("error, simulated magnets", "anhyst", "baseline", "", "ratio"):
        is_number = name in {"anhyst", "baseline", "ratio"}
        table.add_column(name, justify="right" if is_number else "left", no_wrap=True)
    for line in (line for result in results for line in result.table_lines):
        table.add_row(line.title, line.anhyst_text, line.baseline_text, line.baseline_name, line.ratio_text)
    return table


def draw_picture(results: list[ExampleResult], path: Path) -> None:
    """Draw the panels of all examples side by side."""
    panels = [result.draw_panel for result in results if result.draw_panel is not None]
    figure = Figure(figsize=(4.6 * len(panels), 4.0), layout="constrained")
    for ax, draw_panel in zip(figure.subplots(1, len(panels)), panels, strict=True):
        draw_panel(ax)
        style_axes(ax)
        ax.legend(frameon=False, fontsize="small")
    figure.get_layout_engine().set(wspace=0.06)  # type: ignore[call-arg, union-attr]
    figure.savefig(path, dpi=130)


def main() -> None:
    """Run the demo."""
    parser = argparse.ArgumentParser(description="Run the bundled examples against baselines.")
    parser.add_argument("--out", type=Path, default=Path("demo"), help="folder to write to")
    output_folder = parser.parse_args().out
    folders = [output_folder / name for name in ("electromagnet", "bearing", "stage")]
    for folder in folders:
        folder.mkdir(parents=True, exist_ok=True)
    magnet_folder, bearing_folder, stage_folder = folders
    results = [
        run_electromagnet(magnet_folder),
        compile_and_verify(magnet_folder / "model.toml", magnet_folder / "controller"),
    ]
    results += [run_bearing(bearing_folder), run_stage(stage_folder)]
    draw_picture(results, output_folder / "demo.png")
    table = make_results_table(results)
    with (output_folder / "table.txt").open("w", encoding="utf-8") as file:
        Console(file=file, width=80).print(table)
    console = Console(width=80, highlight=False)
    console.print(table)
    for remark in (result.remark for result in results if result.remark):
        console.print(remark)
    print(
        f"picture: {output_folder / 'demo.png'}; report of the electromagnet: {magnet_folder / 'report.html'}"
    )
    print("next: model your magnet (docs/tutorial.md), or operate the bearing in a browser:")
    print("  .venv/bin/anhyst live examples/bearing/rig.toml")


if __name__ == "__main__":
    main()
