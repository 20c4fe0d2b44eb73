"""Measure the tracking error of a stage with feedforward for each compensation method.

Irons, settings and gain search were fixed before the first result; they are defined in
examples/stage/rig.toml and below. The baselines are the best single-valued curve, the map with one
play, and the measured flux. The same search finds separate gains for each method.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator

import numpy as np
from pydantic import TypeAdapter

from anhyst.support.kinds import MethodName
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.drift import change_rig
from anhyst_rigs.rig.fitting import IdentifiedMagnet
from anhyst_rigs.rig.measuring import measure_loops
from anhyst_rigs.rig.parts.iron import IronEntry, NamedIron
from anhyst_rigs.rig.stage.file import read_stage
from anhyst_rigs.rig.stage.fitted import identify_stage_magnet, make_stage
from anhyst_rigs.rig.stage.loop import track
from anhyst_rigs.rig.stage.setpoint import scan_motion
from anhyst_rigs.study.tracking.simulate import TrackingStudy, explore_stage
from rows import ROOT, Row

RIG = ROOT / "examples" / "stage" / "rig.toml"
IRONS = ROOT / "examples" / "irons" / "irons.toml"
REVERSIBLE = (0.05, 0.15, 0.3)
IRON_NAMES = ("preisach-soft", "preisach-usual", "preisach-hard", "duhem-usual")
"""Irons that are not laws of the package."""
CREEPING_IRON = "duhem-usual"
"""Iron without return-point memory: current ripple makes its force drift."""
VARIANTS: tuple[MethodName, ...] = ("single-valued", "play", "full", "flux")


def with_iron(rig: BodyRig, iron: dict[str, object], crossover: float = 130.0) -> BodyRig:
    """Return the stage with another iron and another crossover."""
    schema: TypeAdapter[NamedIron] = TypeAdapter(IronEntry)
    table = schema.validate_python({"name": "own", **iron})
    return change_rig(rig, {"iron": table, "control.crossover_Hz": crossover})


def without_noise(rig: BodyRig) -> BodyRig:
    """Return the stage with noise-free position and gap sensors, without current ripple."""
    return change_rig(rig, {"position_sensor.noise_m": 0.0, "gap_sensor.noise_m": 0.0})


def list_irons(rig: BodyRig) -> Iterator[tuple[str, dict[str, object]]]:
    """Yield the tested irons; the three irons with targets are first."""
    example_iron = rig.settings.steel.model_dump()
    for fraction in REVERSIBLE:
        yield f"cells, reversible part {fraction:g}", example_iron | {"reversible_fraction": fraction}
    families = tomllib.loads(IRONS.read_text(encoding="utf-8"))
    for name in IRON_NAMES:
        yield name, families[name]


def format_metric(study: TrackingStudy, name: str, factor: float) -> str:
    """Format a metric of all variants with its confidence interval."""
    metric_texts = []
    for variant in VARIANTS:
        interval = study.variants[variant].interval(name)
        metric_texts.append(f"{variant} {factor * interval.mean:.3g} ± {factor * interval.half_width:.2g}")
    return ", ".join(metric_texts)


def metric_ratio(study: TrackingStudy, name: str, baseline: MethodName = "single-valued") -> float:
    """Return the ratio of the mean metric of the compensator to that of a baseline."""
    return study.variants["full"].interval(name).mean / study.variants[baseline].interval(name).mean


def make_iron_rows(title: str, study: TrackingStudy) -> list[Row]:
    """Return the rows of one iron at the low crossover."""
    result_rows = []
    for metric_title, name, factor, unit, target_ratio in (
        ("peak", "peak_m", 1e9, "nm", 0.4),
        ("moving average", "average_m", 1e9, "nm", 0.2),
        ("settling to 50 nm", "settling_50_s", 1e3, "ms", 0.4),
    ):
        peak_ratio = metric_ratio(study, name)
        text = f"{peak_ratio:.3g}; {format_metric(study, name, factor)} {unit}"
        row = Row(
            f"tracking, {title}: {metric_title}",
            f"<= {target_ratio:g} times single-valued",
            text,
            peak_ratio <= target_ratio,
        )
        result_rows.append(row)
    full_interval, play_interval = (study.variants[name].interval("peak_m") for name in ("full", "play"))
    result_rows.append(
        Row(
            f"tracking, {title}: peak, ratio to the map with one play",
            "<= 1, with interval",
            f"{full_interval.mean / play_interval.mean:.3g}; "
            f"moving average {metric_ratio(study, 'average_m', 'play'):.3g}",
            full_interval.mean - full_interval.half_width <= play_interval.mean + play_interval.half_width,
        )
    )
    return result_rows


def make_high_crossover_row(title: str, study: TrackingStudy) -> Row:
    """Return the row of one iron at the high crossover."""
    settling_ratio = metric_ratio(study, "settling_10_s")
    return Row(
        f"tracking at 300 Hz, {title}: settling to 10 nm",
        "<= 0.5 times single-valued",
        f"{settling_ratio:.3g}; {format_metric(study, 'settling_10_s', 1e3)} ms; "
        f"peak {format_metric(study, 'peak_m', 1e9)} nm",
        settling_ratio <= 0.5,
    )


def make_learning_rows(study: TrackingStudy) -> list[Row]:
    """Return the rows of iterative learning control."""
    full_peaks, curve_peaks = (study.variants[name].learning_peaks_m for name in ("full", "single-valued"))
    return [
        Row(
            "learning control on full, eight trials: peak",
            "<= 1/5 of the first trial",
            f"{full_peaks[-1] / full_peaks[0]:.3g}; {1e9 * full_peaks[0]:.3g} to {1e9 * full_peaks[-1]:.3g} nm",
            5.0 * full_peaks[-1] <= full_peaks[0],
        ),
        Row(
            "learning control on single-valued, eight trials: peak",
            "does not converge: last peak above half of the first",
            f"{curve_peaks[-1] / curve_peaks[0]:.3g}; {1e9 * curve_peaks[0]:.4g} to {1e9 * curve_peaks[-1]:.4g} nm",
            2.0 * curve_peaks[-1] > curve_peaks[0],
        ),
    ]


def make_format_rows(rig: BodyRig, magnet: IdentifiedMagnet, study: TrackingStudy) -> list[Row]:
    """Return the effects of fixed point and of the plant's sub-steps, with the same noise."""
    table = rig.settings.scan
    motion = scan_motion(table, table.test_m_per_s2)
    gains = study.variants["full"].gains

    def tracking_error(format_: str, substeps: int) -> np.ndarray:
        changed_rig = change_rig(rig, {"timing.substeps": substeps, "control.format": format_})
        return track(make_stage(changed_rig, magnet, "full"), motion, gains, 1)["error_m"]

    substeps_of_rig = rig.settings.timing.substeps
    double_error = tracking_error("f64", substeps_of_rig)
    fixed_difference = float(np.abs(tracking_error("fixed", substeps_of_rig) - double_error).max())
    substep_difference = float(np.abs(tracking_error("f64", 2 * substeps_of_rig) - double_error).max())
    return [
        Row(
            "fixed point against f64 in the loop, largest difference of the error",
            "<= 10 nm",
            f"{1e9 * fixed_difference:.3g} nm",
            fixed_difference <= 10e-9,
        ),
        Row(
            "twice as many sub-steps of the plant, largest difference of the error",
            "<= 2 nm",
            f"{1e9 * substep_difference:.3g} nm",
            substep_difference <= 2e-9,
        ),
    ]


def rows() -> list[Row]:
    """Return the rows of all irons at 130 Hz, three at 300 Hz, formats and learning control."""
    rig = read_stage(RIG)
    result_rows: list[Row] = []
    for number, (title, iron) in enumerate(list_irons(rig)):
        low_crossover_rig = with_iron(rig, iron)
        magnet = identify_stage_magnet(low_crossover_rig, measure_loops(low_crossover_rig))
        study = explore_stage(low_crossover_rig, magnet)
        result_rows += make_iron_rows(title, study)
        if title == CREEPING_IRON:
            result_rows += make_iron_rows(
                f"{title}, no noise", explore_stage(without_noise(low_crossover_rig), magnet)
            )
        if number < len(REVERSIBLE):
            result_rows.append(
                make_high_crossover_row(title, explore_stage(with_iron(rig, iron, 300.0), magnet))
            )
        if iron.get("reversible_fraction") == rig.settings.steel.model_dump().get("reversible_fraction"):
            result_rows += [*make_format_rows(low_crossover_rig, magnet, study), *make_learning_rows(study)]
    return result_rows
