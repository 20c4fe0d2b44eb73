"""Compare all compensation methods on the magnetic bearing, for several irons and step heights.

``python benchmarks/bearing.py`` prints the tables of docs/results-bearing.md.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from anhyst.control.controller_file import ControllerFile, read_controller
from anhyst.support.kinds import MethodName, NumberFormat
from anhyst_rigs.rig.bearing.loop import BearingSetup, make_setup
from anhyst_rigs.rig.body import BodyRig, read_bearing
from anhyst_rigs.rig.case_table import TrajectoryCase
from anhyst_rigs.rig.drift import change_iron, change_rig
from anhyst_rigs.rig.fitting import IdentifiedMagnet, identify_magnet
from anhyst_rigs.rig.measuring import measure_loops
from anhyst_rigs.rig.parts.iron import CellSteel
from anhyst_rigs.rig.sensor_table import GapSensorTable
from anhyst_rigs.study.bearing import experiments
from anhyst_rigs.study.bearing.operating import OperatingPoint, find_operating_point
from anhyst_rigs.study.bearing.responses import StepCell, compare_steps, default_seeds
from anhyst_rigs.study.engine.table import CaseFigures
from rows import ROOT, Row

FOLDER = ROOT / "examples" / "bearing"
IRONS = (0.05, 0.15, 0.3)
HEIGHTS = (10e-6, 20e-6, 50e-6, 100e-6)
VARIANTS: tuple[MethodName, ...] = (
    "ratio",
    "secant",
    "linearised",
    "single-valued",
    "flux",
    "simplified",
    "full",
)


@dataclass(frozen=True)
class Iron:
    """One iron of the comparison, its identified model and its controllers."""

    rig: BodyRig
    operating_point: OperatingPoint
    knowledge: IdentifiedMagnet
    setups: Mapping[MethodName, BearingSetup]

    @property
    def title(self) -> str:
        """The reversible fraction, and whether the iron is pathological, for tables."""
        steel = self.rig.settings.steel
        assert isinstance(steel, CellSteel)
        fraction_text = f"{steel.reversible_fraction:g}"
        return (
            f"{fraction_text} (pathological)"
            if self.operating_point.slopes.label == "pathological"
            else fraction_text
        )


def read_example() -> tuple[BodyRig, ControllerFile]:
    """Read the rig and the controller of the example."""
    return read_bearing(FOLDER / "rig.toml"), read_controller(FOLDER / "controller.toml")


def make_iron(rig: BodyRig, controller: ControllerFile, fraction: float) -> Iron:
    """Measure the loops of an iron, identify its model and fit every variant."""
    iron_rig = change_iron(rig, fraction)
    knowledge = identify_magnet(measure_loops(iron_rig))
    setups = {
        variant: make_setup(iron_rig, controller.settings, knowledge, variant, "fixed")
        for variant in VARIANTS
    }
    return Iron(iron_rig, find_operating_point(iron_rig), knowledge, setups)


def run_same_gains(iron: Iron) -> list[StepCell]:
    """Run steps of every height with every variant and the same gains."""
    gap = iron.rig.settings.gap_m
    load = iron.rig.settings.load.force_N
    return compare_steps(list(iron.setups.values()), [gap], HEIGHTS, [load], default_seeds(iron.rig))


def mean_overshoots(cells: Sequence[StepCell], variant: MethodName) -> list[float]:
    """Return the mean overshoot of a variant at every height, %; NaN if a run was lost."""
    return [cell.interval("overshoot_percent").mean for cell in cells if cell.variant == variant]


def steps_table(irons: Sequence[Iron], results: Sequence[Sequence[StepCell]]) -> str:
    """Return the table of overshoots with confidence intervals, in Markdown."""
    header = "| iron | variant | " + " | ".join(f"{1e6 * h:.0f} um" for h in HEIGHTS)
    header += " | settling at 50 um | standstill |"
    lines = [header, "| --- | --- |" + " --- |" * (len(HEIGHTS) + 2)]
    for iron, cells in zip(irons, results, strict=True):
        for variant in VARIANTS:
            variant_cells = [cell for cell in cells if cell.variant == variant]
            overshoot_texts = [_overshoot_text(cell) for cell in variant_cells]
            settling, standstill_text = (
                _mean_text(variant_cells[2], *metric) for metric in (_SETTLING, _STANDSTILL)
            )
            lines.append(
                f"| {iron.title} | `{variant}` | {' | '.join(overshoot_texts)} | {settling} | {standstill_text} |"
            )
    return "\n".join(lines)


_SETTLING = "settling_in_noise_s", 1e3, ".2f", "ms"
_STANDSTILL = "standstill_rms_m", 1e9, ".0f", "nm"


def _overshoot_text(cell: StepCell) -> str:
    """Return overshoot and interval as text, and whether it is within the standstill noise."""
    if cell.lost:
        return f"{cell.lost} of {cell.runs} lost"
    interval = cell.interval("overshoot_percent")
    return f"{interval.mean:.2f} ± {interval.half_width:.2f} %{'' if cell.has_overshoot else ' ≤ noise'}"


def _mean_text(cell: CaseFigures, name: str, factor: float, number_format: str, unit: str) -> str:
    if cell.lost:
        return f"{cell.lost} of {cell.runs} lost"
    return f"{factor * cell.interval(name).mean:{number_format}} {unit}"


def with_quiet_sensor(rig: BodyRig) -> BodyRig:
    """Return the rig with a sensor of 5 nm rms instead of the encoder."""
    sensor = rig.settings.gap_sensor
    capacitive = GapSensorTable(
        of="gap",
        kind="capacitive",
        low_m=sensor.low_m,
        high_m=sensor.high_m,
        noise_m=5e-9,
        bandwidth_Hz=sensor.bandwidth_Hz,
    )
    return change_rig(rig, {"gap_sensor": capacitive})


def slow_table(irons: Sequence[Iron]) -> str:
    """Return the table of a triangle of 20 um at 1 Hz and steps of 1 um, in Markdown."""
    triangle = TrajectoryCase(kind="triangle", amplitude_m=20e-6, frequency_Hz=1.0)
    lines = [
        "| iron | variant | triangle, rms error | its force error | 1 um, overshoot | settling |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for iron in irons:
        rig = with_quiet_sensor(iron.rig)
        setups = {name: BearingSetup(rig, s.compensator, s.controller) for name, s in iron.setups.items()}
        seeds = default_seeds(rig)
        results = experiments.run_variants(experiments.run_trajectory, setups, seeds, triangle)
        gap, load = rig.settings.gap_m, rig.settings.load.force_N
        small_steps = compare_steps(list(setups.values()), [gap], [1e-6], [load], seeds)
        for name, cell in zip(setups, small_steps, strict=True):
            error_text = _mean_text(results[name], "tracking_rms_m", 1e9, ".0f", "nm")
            force = _mean_text(results[name], "force_error_rms_N", 1.0, ".2f", "N")
            lines.append(
                f"| {iron.title} | `{name}` | {error_text} | {force} | {_overshoot_text(cell)} | "
                f"{_mean_text(cell, *_SETTLING)} |"
            )
    return "\n".join(lines)


def make_setup_in_format(
    iron: Iron, controller: ControllerFile, variant: MethodName, name: NumberFormat
) -> BearingSetup:
    """Fit a variant of an iron in another number format."""
    return make_setup(iron.rig, controller.settings, iron.knowledge, variant, name)


def rows() -> list[Row]:
    """Return all rows of the bearing that have a target."""
    rig, controller = read_example()
    irons = [make_iron(rig, controller, fraction) for fraction in IRONS]
    return [
        *_overshoot_rows(irons, [run_same_gains(iron) for iron in irons]),
        *_standstill_rows(irons),
        *_format_rows(irons[1], controller),
        *_event_rows(irons[1]),
    ]


def _overshoot_rows(irons: Sequence[Iron], results: Sequence[Sequence[StepCell]]) -> list[Row]:
    result_rows = []
    for iron, cells in zip(irons, results, strict=True):
        full_overshoots = mean_overshoots(cells, "full")
        overshoots_by_variant = {name: mean_overshoots(cells, name) for name in VARIANTS}
        ratios = [
            full_overshoot / ratio_overshoot
            for full_overshoot, ratio_overshoot in zip(
                full_overshoots, overshoots_by_variant["ratio"], strict=True
            )
        ]
        result_rows.append(
            Row(
                f"bearing, same gains, iron {iron.title}: overshoot of full relative to the method ratio",
                "<= 0.5 at every height",
                f"{max(ratios):.2f} worst; "
                + ", ".join(f"{name} {max(values):.2f} %" for name, values in overshoots_by_variant.items()),
                all(ratio <= 0.5 for ratio in ratios),
            )
        )
    return result_rows


def _standstill_rows(irons: Sequence[Iron]) -> list[Row]:
    result_rows = []
    for iron in irons:
        setups = {
            name: BearingSetup(with_quiet_sensor(iron.rig), setup.compensator, setup.controller)
            for name, setup in iron.setups.items()
        }
        results = experiments.run_variants(experiments.run_standstill, setups, default_seeds(iron.rig), None)
        full_results = results["full"]
        metrics_text = ", ".join(_standstill_text(name, metrics) for name, metrics in results.items())
        is_met = (
            not full_results.lost and full_results.interval("rms_m").mean <= 10e-9 and not full_results.cycles
        )
        has_target = iron.rig.settings.iron is not None and iron is not irons[0]
        result_rows.append(
            Row(
                f"bearing, standstill with a 5 nm sensor, iron {iron.title}",
                "full <= 10 nm rms, no limit cycle" if has_target else "",
                metrics_text,
                is_met if has_target else None,
            )
        )
    return result_rows


def _standstill_text(name: str, metrics: experiments.ExperimentFigures) -> str:
    cycles = len(metrics.cycles or ())
    cycle_text = f" (limit cycle in {cycles} of {metrics.runs})" if cycles else ""
    return f"{name} {_mean_text(metrics, 'rms_m', 1e9, '.1f', 'nm')}{cycle_text}"


def _format_rows(iron: Iron, controller: ControllerFile) -> list[Row]:
    variants: tuple[MethodName, ...] = ("single-valued", "simplified", "full")
    formats: tuple[NumberFormat, ...] = ("f64", "f32", "fixed")
    gap, load = iron.rig.settings.gap_m, iron.rig.settings.load.force_N
    worst_ratio, result_texts = 0.0, []
    for variant in variants:
        setups = {name: make_setup_in_format(iron, controller, variant, name) for name in formats}
        seeds = default_seeds(iron.rig)
        cells = compare_steps(list(setups.values()), [gap], HEIGHTS, [load], seeds)
        cells_by_format = [cells[4 * index : 4 * index + 4] for index in range(len(formats))]
        overshoot_difference = max(
            abs(
                double_cell.interval("overshoot_percent").mean - fixed_cell.interval("overshoot_percent").mean
            )
            for double_cell, fixed_cell in zip(cells_by_format[0], cells_by_format[2], strict=True)
        )
        standstill_rms = [
            experiments.run_variants(experiments.run_standstill, {variant: setup}, seeds, None)[variant]
            .interval("rms_m")
            .mean
            for setup in (setups["f64"], setups["fixed"])
        ]
        worst_ratio = max(
            worst_ratio, overshoot_difference / 0.5, abs(standstill_rms[1] / standstill_rms[0] - 1.0) / 0.1
        )
        result_texts.append(
            f"{variant}: {overshoot_difference:.3f} points, "
            f"standstill {1e9 * standstill_rms[0]:.1f} and {1e9 * standstill_rms[1]:.1f} nm"
        )
    return [
        Row(
            "bearing, fixed point against f64 in the same loop",
            "overshoot within 0.5 points, standstill within 10 %",
            "; ".join(result_texts),
            worst_ratio <= 1.0,
        )
    ]


def _event_rows(iron: Iron) -> list[Row]:
    result_rows = []
    for event in experiments.EVENTS:
        seeds = default_seeds(iron.rig)
        results = experiments.run_variants(experiments.run_event, iron.setups, seeds, event)
        metric_name = "recovery_s" if event == "overload" else "excess_s"
        metrics_text = ", ".join(
            f"{name} {_mean_text(metrics, metric_name, 1e3, '.1f', 'ms')}"
            for name, metrics in results.items()
        )
        title_part = "back within 1 um after" if event == "overload" else "shows for"
        result_rows.append(
            Row(
                f"bearing, {event}: {title_part}",
                "no loss of levitation",
                metrics_text,
                all(metrics.lost == 0 for metrics in results.values()),
            )
        )
    return result_rows


def main() -> None:
    """Print the tables."""
    start_time = time.perf_counter()
    rig, controller = read_example()
    irons = [make_iron(rig, controller, fraction) for fraction in IRONS]
    print(steps_table(irons, [run_same_gains(iron) for iron in irons]))
    print()
    print(slow_table(irons))
    print(f"{time.perf_counter() - start_time:.0f} s", file=sys.stderr)


if __name__ == "__main__":
    main()
