"""Calibrate sampled stages of other mass, rate, bandwidth and iron, and count wrong answers.

One half of the stages was used to choose the rules and thresholds of the calibration and of the
feedforward gains; the other half was not looked at before. Each stage has a plant with all errors
of its rig file. It is calibrated on one training set-point and evaluated on a test set-point.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any

import numpy as np

from anhyst import NegativeResult
from anhyst.support.jobs import map_ordered
from anhyst.support.kinds import MethodName
from anhyst_rigs import calibrate
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.calibration import CalibratedMethod
from anhyst_rigs.rig.drift import Drift, change_rig, sample_drift
from anhyst_rigs.rig.fitting import IdentifiedMagnet
from anhyst_rigs.rig.measuring import measure_loops
from anhyst_rigs.rig.recording import Recording
from anhyst_rigs.rig.stage.file import read_stage
from anhyst_rigs.rig.stage.fitted import identify_stage_magnet, make_stage
from anhyst_rigs.rig.stage.loop import Feedforward, StageSetup, track
from anhyst_rigs.rig.stage.setpoint import scan_motion
from anhyst_rigs.study.tracking.gains import find_gains, search_gains
from anhyst_rigs.study.tracking.measures import measure
from rows import Row
from tracking import RIG, with_iron

HALVES = {"used to choose the rules": (5102,), "not looked at before": (5103, 5104)}
"""Seeds of the stages in each half."""
STAGES = 12
"""Number of stages for each seed."""
GAIN_METHODS: tuple[MethodName, ...] = ("full", "play", "single-valued")
FAULT_METHODS: tuple[MethodName, ...] = ("single-valued", "play", "full", "fused")
TEST_SEEDS = (1, 2, 3)
MAX_MASS_ERROR = 0.02
"""Largest relative error of a mass that counts as right."""
FAULTS: Mapping[str, Mapping[str, float]] = {
    "no fault": {},
    "payload 4 %": {"mass": 0.04},
    "payload -4 %": {"mass": -0.04},
    "currents 3 % too large": {"first_scale": 0.03},
    "gaps 20 um too large": {"gap_offset": 20e-6},
    "gaps 20 um too small": {"gap_offset": -20e-6},
    "delay_ticks 1 too large": {"early_ticks": 1.0},
    "columns exchanged": {"exchanged": 1.0},
}
"""Faults of a recording that the rig file does not state."""


def sample_iron(rng: np.random.Generator) -> dict[str, Any]:
    """Sample an iron of play cells, of Preisach's relays or of Duhem's law."""
    curve = {
        "saturation_sharp_T": rng.uniform(1.1, 1.4),
        "knee_sharp_A_per_m": rng.uniform(80.0, 250.0),
        "saturation_slow_T": rng.uniform(0.5, 0.8),
        "knee_slow_A_per_m": rng.uniform(2000.0, 4000.0),
    }
    family = str(rng.choice(["cells", "cells", "preisach", "preisach", "duhem"]))
    if family == "cells":
        return {
            "family": family,
            "cells": 24,
            "reversible_fraction": rng.uniform(0.04, 0.36),
            "pinning_scale_A_per_m": rng.uniform(90.0, 260.0),
            "pinning_shape": rng.uniform(2.0, 4.0),
            **curve,
        }
    if family == "preisach":
        return {
            "family": family,
            "saturation_T": rng.uniform(1.05, 1.25),
            "pinning_A_per_m": rng.uniform(20.0, 200.0),
            "pinning_spread": rng.uniform(0.4, 0.6),
            "bias_A_per_m": rng.uniform(20.0, 110.0),
            "bias_by_pinning": rng.uniform(0.5, 0.9),
            "feedback_A_per_m_T": rng.uniform(3.0, 25.0),
            "saturation_sharp_T": rng.uniform(0.1, 0.2),
            "knee_sharp_A_per_m": rng.uniform(100.0, 600.0),
            "saturation_slow_T": 0.55,
            "knee_slow_A_per_m": rng.uniform(2500.0, 4500.0),
        }
    return {
        "family": family,
        "coercivity_A_per_m": rng.uniform(20.0, 120.0),
        "turning_T": rng.uniform(0.12, 0.22),
        "fading": rng.uniform(0.5, 0.7),
        "saturation_sharp_T": 1.3,
        "knee_sharp_A_per_m": rng.uniform(60.0, 200.0),
        "saturation_slow_T": 0.5,
        "knee_slow_A_per_m": rng.uniform(2000.0, 3500.0),
    }


def sample_stage(seed: int, number: int) -> tuple[BodyRig, Drift]:
    """Sample a stage of 4 to 18 kg at 10 to 25 kHz with its set-points, and the drift of its plant."""
    rng = np.random.default_rng([seed, number])
    iron: dict[str, object] = {
        key: value if isinstance(value, str | int) else float(value)
        for key, value in sample_iron(rng).items()
    }
    mass = round(float(np.exp(rng.uniform(np.log(4.0), np.log(18.0)))), 2)
    rate = float(rng.choice([10e3, 12.5e3, 16e3, 20e3, 25e3]))
    crossover = round(float(rng.uniform(90.0, min(160.0, rate / 100.0))))
    top = round(min(float(rng.uniform(0.6, 0.92)) * 240.0 / mass, 30.0), 1)
    fractions = 1.0, *(float(rng.uniform(low, high)) for low, high in ((0.3, 0.8), (0.3, 0.95), (0.3, 0.95)))
    train = [round(top * fraction, 1) for fraction in fractions][: int(rng.integers(3, 5))]
    if rng.uniform() < 0.5:
        rate, crossover = 10e3, round(float(rng.uniform(85.0, 100.0)))
    test = [round(top * fraction, 1) for fraction in (1.0, *rng.uniform(0.28, 1.0, 4).tolist())]
    speed = round(float(rng.uniform(0.3, 0.6)) * min(1.0, top / 14.0), 2)
    jerk_phase_s = 7.5e-3
    while speed / min(train + test) < jerk_phase_s:
        jerk_phase_s *= 0.8
    changes = {
        "name": f"sampled stage {seed}.{number}",
        "body.mass_kg": mass,
        "timing.rate_Hz": rate,
        "scan.train_m_per_s2": train,
        "scan.test_m_per_s2": test,
        "scan.speed_m_per_s": speed,
        "scan.jerk_phase_s": jerk_phase_s,
        "scan.snap_phase_s": min(2e-3, jerk_phase_s / 3.0),
        "scan.cruise_s": round(float(rng.uniform(0.03, 0.06)), 3),
        "scan.average_weight": float(rng.choice([0.0, 0.5])),
    }
    rig = change_rig(with_iron(read_stage(RIG), iron, float(crossover)), changes)
    return rig, sample_drift(rig.settings, rng)


@dataclass(frozen=True)
class SampledStage:
    """A sampled stage with its plant and its identified magnets."""

    rig: BodyRig
    drift: Drift
    magnet: IdentifiedMagnet

    def record_training(self, method: MethodName, fault: str = "no fault") -> Recording:
        """Return the recording of the training set-point with a fault, with mass feedforward."""
        changes, rig = dict[str, Any](FAULTS[fault]), self.rig
        early_ticks, is_exchanged = changes.pop("early_ticks", 0.0), changes.pop("exchanged", 0.0)
        mass = changes.pop("mass", 0.0)
        magnets = tuple(
            replace(magnet, **{name: getattr(magnet, name) + value for name, value in changes.items()})
            for magnet in self.drift.magnets
        )
        if early_ticks:
            rig = change_rig(rig, {"timing.delay_ticks": rig.settings.timing.delay_ticks - early_ticks})
        plant = replace(
            make_stage(self.rig, self.magnet, method),
            rig=rig,
            drift=replace(self.drift, mass=mass, magnets=magnets),
        )
        motion = scan_motion(rig.settings.scan, rig.settings.scan.train_m_per_s2)
        columns = dict(track(plant, motion, Feedforward(1.0, early_ticks * rig.dt), 100).columns)
        if is_exchanged:
            second_names = {"command_A": "command_2_A", "gap_read_m": "gap_read_2_m"}
            columns |= {first: columns[second] for first, second in second_names.items()} | {
                second: columns[first] for first, second in second_names.items()
            }
        return Recording(columns)

    def calibrate(self, method: MethodName) -> CalibratedMethod:
        """Return the calibration of a method from one recording with this method."""
        run = self.record_training(method)
        return calibrate(self.rig, run, magnet=self.magnet, methods=[method]).file.method[0]


@cache
def prepare_stage(seed: int, number: int) -> SampledStage:
    """Sample a stage, measure its loops and identify its magnets."""
    rig, drift = sample_stage(seed, number)
    return SampledStage(rig, drift, identify_stage_magnet(rig, measure_loops(rig)))


def measure_gains(setup: StageSetup) -> list[tuple[float, float]]:
    """Return average and peak, nm, with the mass alone, the searched gains and the used gains."""
    scan = setup.rig.settings.scan
    training, test = (scan_motion(scan, peaks) for peaks in (scan.train_m_per_s2, scan.test_m_per_s2))
    results = []
    for gains in (Feedforward(), search_gains(setup, training), find_gains(setup, training)):
        runs = [measure(track(setup, test, gains, seed), test, scan.slit_s) for seed in TEST_SEEDS]
        mean_errors = np.mean([(run.average_m, run.peak_m) for run in runs], axis=0)
        results.append((1e9 * float(mean_errors[0]), 1e9 * float(mean_errors[1])))
    return results


def run_gains(method: MethodName, stage: tuple[int, int]) -> dict[str, list[tuple[float, float]]]:
    """Return the errors of the nominal plant, and of the drifted plant before and after calibration."""
    sampled = prepare_stage(*stage)
    nominal = make_stage(sampled.rig, sampled.magnet, method)
    setups = {"nominal": nominal, "before": replace(nominal, drift=sampled.drift)}
    if (calibration := sampled.calibrate(method)).is_applied:
        corrected = make_stage(sampled.rig, sampled.magnet, method, calibration)
        setups["after"] = replace(corrected, drift=sampled.drift)
    return {name: measure_gains(setup) for name, setup in setups.items()}


def make_gain_rows(half: str, method: MethodName, results: Sequence[dict[str, Any]]) -> Iterator[Row]:
    """Yield the rows of a method: medians, and the error relative to the better gains of each stage."""
    for name in ("nominal", "before", "after"):
        errors = np.array([result[name] for result in results if name in result])  # stage, gains, metric
        if not errors.size:
            continue
        medians = np.median(errors, axis=0)
        ratios = errors / errors[:, :2].min(axis=1, keepdims=True)
        means = np.exp(np.log(ratios).mean(axis=(0, 2)))
        texts = [
            f"{title} {median[0]:.0f}/{median[1]:.0f} ({mean:.2f})"
            for title, median, mean in zip(
                ("mass alone", "searched", "used"), medians.tolist(), means.tolist(), strict=True
            )
        ]
        yield Row(
            f"sampled stages, {half}, {method}, {name}, {len(errors)} stages: median average/peak, nm "
            "(mean ratio to the better gains)",
            "used gains: ratio <= 1.1",
            ", ".join(texts),
            bool(means[2] <= 1.1),
        )


def run_fault(fault: str, stage: tuple[int, int]) -> tuple[int, bool, str]:
    """Return the number of applied methods, whether a wrong mass is advised, and the main message."""
    sampled = prepare_stage(*stage)
    run = sampled.record_training("full", fault)
    try:
        result = calibrate(sampled.rig, run, magnet=sampled.magnet, methods=FAULT_METHODS)
    except NegativeResult as error:
        return 0, False, "exchanged" if "exchanged" in str(error) else "refused"
    advice = result.file.mass_advice or ""
    true_mass = sampled.rig.settings.body.mass_kg * (1.0 + FAULTS[fault].get("mass", 0.0))
    masses = [method.mass_kg for method in result.file.method if method.mass_kg is not None]
    has_wrong_mass = "correct body.mass_kg" in advice and any(
        abs(mass / true_mass - 1.0) > MAX_MASS_ERROR for mass in masses
    )
    full = next(method for method in result.file.method if method.name == "full")
    kinds = {"payload": bool(masses), "not causal": "not causal" in full.summary, "taken": full.is_applied}
    message = next((name for name, holds in kinds.items() if holds), "rejected")
    return sum(method.is_applied for method in result.file.method), has_wrong_mass, message


EXPECTED_MESSAGES = {
    "no fault": "taken",
    "delay_ticks 1 too large": "not causal",
    "columns exchanged": "exchanged",
}
"""Message about ``full`` that each fault must cause; all others cause that of a payload."""


def make_fault_row(half: str, fault: str, results: Sequence[tuple[int, bool, str]]) -> Row:
    """Return the row of a fault: messages about ``full``, and wrong masses that are advised."""
    messages = Counter(message for _, _, message in results)
    wrong_masses = sum(has_wrong_mass for _, has_wrong_mass, _ in results)
    right_count = messages[EXPECTED_MESSAGES.get(fault, "payload")]
    counts = ", ".join(f"{message} {count}" for message, count in messages.items())
    return Row(
        f"sampled stages, {half}, {fault}: messages about full; wrong masses advised",
        f"'{EXPECTED_MESSAGES.get(fault, 'payload')}' on 90 %; 0",
        f"{counts}; {wrong_masses}",
        right_count >= 0.9 * len(results) and not wrong_masses,
    )


def rows() -> list[Row]:
    """Return the rows of both halves."""
    result_rows: list[Row] = []
    for half, seeds in HALVES.items():
        stages = [(seed, number) for seed in seeds for number in range(STAGES)]
        for method in GAIN_METHODS:
            results = map_ordered(partial(run_gains, method), stages)
            result_rows += make_gain_rows(half, method, results)
        result_rows += [
            make_fault_row(half, fault, map_ordered(partial(run_fault, fault), stages)) for fault in FAULTS
        ]
    return result_rows
