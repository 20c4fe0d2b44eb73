"""Measure the simulation speed of a controlled bearing against SciPy and numba baselines.

All simulators run the bearing of ``examples/bearing`` through the same steps for the same simulated
time, one after the other on one core. The metric is processor time. ``python
benchmarks/closed_loop.py`` also prints the accuracies and the cost of each tolerance of
``solve_ivp``.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Protocol

import numpy as np

from anhyst.compensate.current_map import CurrentMap
from anhyst.control.controller_file import ControllerFile, read_controller
from anhyst.support.kinds import MethodName, NumberFormat
from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.bearing.loop import BearingSetup, make_setup
from anhyst_rigs.rig.bearing.scenario import ScenarioBuilder
from anhyst_rigs.rig.body import BodyRig, read_bearing, step_ends
from anhyst_rigs.rig.drift import change_rig
from anhyst_rigs.rig.fitting import IdentifiedMagnet
from anhyst_rigs.rig.loop import Scenario, SimulatedLoop
from anhyst_rigs.rig.parts.iron import CellSteel
from anhyst_rigs.rig.plant import STOP_RESONANCE_HZ, current_controller_gains, make_plant
from anhyst_rigs.study.bearing.inputs import check_inputs
from baseline_bearing import ByNumba, ByScipy, Control, LevitationRun, Method, Plant
from rows import ROOT, Row

Array = FloatArray
FOLDER = ROOT / "examples" / "bearing"

SECONDS = 0.2
"""Simulated time, s, equal for all simulators."""
HOLD_S = 0.02
HEIGHTS = (10e-6, 20e-6, 50e-6, 20e-6, 10e-6)
REPETITIONS = 40
METHODS: tuple[Method, ...] = ("RK23", "RK45", "LSODA", "Radau")
TOLERANCES = (1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 1e-5, 1e-6)


class Simulator(Protocol):
    """Interface of both baselines."""

    def start(self, gap: float, current: float, load: float) -> float:
        """Hold the position; return the magnet's force, N."""

    def advance(self, command: float, load: float) -> tuple[float, float]:
        """Advance by one tick; return gap, m, and force, N."""


@dataclass(frozen=True)
class Case:
    """The example with its unchanged files."""

    rig: BodyRig
    controller: ControllerFile
    knowledge: IdentifiedMagnet

    def setup(self, variant: MethodName, number_format: NumberFormat) -> BearingSetup:
        """Return the example's controller with a method from force to current."""
        return make_setup(self.rig, self.controller.settings, self.knowledge, variant, number_format)

    def scenario(self) -> Scenario:
        """Return steps up and down, without lift-off."""
        gap = self.rig.settings.gap_m
        script = ScenarioBuilder(self.rig, gap)
        for height in HEIGHTS:
            for end in step_ends(gap, height):
                script.step(end, HOLD_S)
        scenario = script.build()
        assert math.isclose(scenario.ticks * self.rig.dt, SECONDS)
        return scenario


@cache
def example() -> Case:
    """Read the example and identify its magnet."""
    rig = read_bearing(FOLDER / "rig.toml")
    controller = read_controller(FOLDER / "controller.toml")
    return Case(rig, controller, check_inputs(rig, controller).identify_magnet())


def plant_of(rig: BodyRig) -> Plant:
    """Convert the parameters of a rig file for the baselines."""
    magnet, mechanics = rig.settings.magnet, rig.settings.body
    poles = magnet.poles
    steel, sensor = rig.settings.steel, rig.settings.gap_sensor
    current_gain, integral_gain = current_controller_gains(rig)
    stop_rad_per_s = 2.0 * math.pi * STOP_RESONANCE_HZ
    assert isinstance(steel, CellSteel)
    return Plant(
        thresholds=steel.thresholds,
        weights=steel.weights,
        sharp_saturation=steel.saturation_sharp_T,
        knee_sharp=steel.knee_sharp_A_per_m,
        slow_saturation=steel.saturation_slow_T,
        knee_slow=steel.knee_slow_A_per_m,
        turns=float(poles.turns),
        resistance=poles.resistance,
        length=poles.iron_length,
        area=poles.area,
        width=poles.width,
        depth=poles.depth,
        leakage_permeance=poles.leakage,
        supply_voltage=rig.settings.amplifier.supply,
        current_gain=current_gain,
        current_integral_gain=integral_gain,
        mass_kg=mechanics.mass_kg,
        stop_low=mechanics.stop_low_m,
        stop_high=mechanics.stop_high_m,
        stop_stiffness=mechanics.mass_kg * stop_rad_per_s * stop_rad_per_s,
        stop_damping=mechanics.mass_kg * stop_rad_per_s,
        load_corner=2.0 * math.pi * rig.settings.load.bandwidth_Hz,
        sensor_corner=2.0 * math.pi * sensor.bandwidth_Hz,
        sensor_low=sensor.low_m,
        sensor_step=sensor.resolution,
        tick=rig.dt,
    )


def control_of(setup: BearingSetup) -> Control:
    """Convert gains and map for the baselines."""
    gains = setup.controller.pidd2().per_tick
    law, amplifier = setup.compensator.parameters, setup.rig.settings.amplifier
    assert isinstance(law, CurrentMap)
    p, k, d, e, _, back, s, t, weight, low, high = gains.tolist()
    return Control(
        proportional=p,
        integral=k,
        derivative=d,
        acceleration_gain=e,
        anti_windup_gain=back,
        smoothing=s,
        smoothing_2=t,
        set_point_weight=weight,
        demand_low=low,
        demand_high=high,
        gap_middle=setup.position_control.gap_middle,
        currents=law.entries,
        gap_low=law.scales.gap_low,
        gap_high=law.scales.gap_high,
        force_high=law.scales.demand,
        current_high=amplifier.current_high_A,
        current_step=amplifier.current_high_A / ((1 << amplifier.dac_bits) - 1),
    )


def memory_of(control: Control, gap: float, force: float) -> Array:
    """Return the state of a PIDD2 that holds a position and requests a force."""
    position = control.gap_middle - gap
    return np.array(
        [position, 0.0, force - control.proportional * (control.set_point_weight - 1.0) * position]
    )


def find_equilibrium(simulator: Simulator, gap: float, load: float) -> float:
    """Bring a baseline to equilibrium; return the current, A."""
    low_current, high_current = 0.0, 10.0
    for _ in range(60):
        current = 0.5 * (low_current + high_current)
        low_current, high_current = (
            (current, high_current) if simulator.start(gap, current, load) < load else (low_current, current)
        )
    return current


def processor_seconds(function: Callable[[], object]) -> float:
    """Return the processor time, s."""
    start_time = time.process_time()
    function()
    return time.process_time() - start_time


@dataclass(frozen=True)
class SpeedResult:
    """One simulator in the same loop."""

    name: str
    real_time_factor: float
    """Ratio of simulated time to processor time."""
    overshoot: float
    """Overshoot of the largest upward step, % of its height."""


def overshoot(case: Case, gap: Array) -> float:
    """Return the overshoot of the largest upward step, % of its height."""
    largest_index = int(np.argmax(HEIGHTS))
    ticks = round(HOLD_S / case.rig.dt)
    _, upper = step_ends(case.rig.settings.gap_m, HEIGHTS[largest_index])
    step_gaps = gap[(2 * largest_index + 1) * ticks : (2 * largest_index + 2) * ticks]
    return float(100.0 * (upper - np.min(step_gaps)) / HEIGHTS[largest_index])


def measure_project(case: Case, variant: MethodName, number_format: NumberFormat) -> SpeedResult:
    """Simulate with the complete plant of this project; lift-off is not counted."""
    setup, scenario = case.setup(variant, number_format), case.scenario()
    builder = ScenarioBuilder(case.rig, case.rig.settings.gap_m)
    lift = builder.lift_off(case.controller.settings).build()
    best_seconds, gap = math.inf, np.empty(0)
    for _ in range(REPETITIONS):
        loop = SimulatedLoop(setup)
        loop.run(lift)
        start_time = time.process_time()
        run = loop.run(scenario)
        best_seconds = min(best_seconds, time.process_time() - start_time)
        gap = run["gap_m"]
    return SpeedResult(f"{variant} in {number_format}", SECONDS / best_seconds, overshoot(case, gap))


def baseline(case: Case, simulator: ByScipy | ByNumba, name: str, repetitions: int) -> SpeedResult:
    """Simulate with a baseline; compilation is not counted."""
    rig, scenario = case.rig, case.scenario()
    gap, load = float(scenario.target[0]), rig.settings.load.force_N
    control = control_of(case.setup("single-valued", "f64"))
    noise_rms = rig.settings.gap_sensor.noise_m
    sensor_noise = noise_rms * np.random.default_rng(0).standard_normal(scenario.ticks)
    current = find_equilibrium(simulator, gap, load)
    best_seconds, run = math.inf, LevitationRun(np.empty(0), np.empty(0))
    for _ in range(repetitions):
        simulator.start(gap, current, load)
        memory = memory_of(control, gap, load)
        start_time = time.process_time()
        run = simulator.run(control, memory, scenario.target, scenario.load, sensor_noise)
        best_seconds = min(best_seconds, time.process_time() - start_time)
    return SpeedResult(name, SECONDS / best_seconds, overshoot(case, run.gap))


def open_loop(simulator: Simulator, current: float, load: float, gap: float) -> Array:
    """Return gap and force at each tick of 3 ms of varying commands."""
    simulator.start(gap, current, load)
    commands = [current + 0.4 * math.sin(0.9 * tick) for tick in range(60)]
    return np.array([simulator.advance(command, load) for command in commands])


class ProjectPlant:
    """The plant of this project with the interface of the baselines."""

    def __init__(self, rig: BodyRig, substeps: int) -> None:
        rig_changes = {"timing.substeps": substeps, "amplifier.dac_bits": 24, "load.force_N": 0.0}
        self._rig = change_rig(rig, rig_changes)

    def start(self, gap: float, current: float, load: float) -> float:
        """Hold the position with the load as weight; return the magnet's force, N."""
        weight = {"body.gravity_m_per_s2": load / self._rig.settings.body.mass_kg}
        self._plant = make_plant(change_rig(self._rig, weight), 0)
        self._plant.place([gap], [0.0])
        self._plant.hold(current, 0)
        return self._plant.force

    def advance(self, command: float, load: float) -> tuple[float, float]:
        """Advance by one tick with the previous command; return gap, m, and force, N."""
        del load
        self._plant.advance([command], 0.0)
        return self._plant.gap, self._plant.force


def errors(rig: BodyRig, simulators: dict[str, Simulator]) -> dict[str, float]:
    """Return the rms force errors relative to the force range, against 64 sub-steps."""
    gap, load = rig.settings.gap_m, rig.settings.load.force_N
    reference_plant = ProjectPlant(rig, 64)
    current = find_equilibrium(reference_plant, gap, load)
    true_force = open_loop(reference_plant, current, load, gap)[:, 1]
    rms_errors = {}
    for name, simulator in simulators.items():
        force = open_loop(simulator, current, load, gap)[:, 1]
        rms_errors[name] = float(np.sqrt(np.mean((force - true_force) ** 2)) / np.ptp(true_force))
    return rms_errors


@dataclass(frozen=True)
class SolverTrial:
    """A setting of ``solve_ivp`` and its results."""

    method: Method
    tolerance: float
    error: float
    """Rms force error, relative to the force range."""
    seconds: float
    """Processor time for the same 3 ms, s."""


def try_all_settings(rig: BodyRig) -> list[SolverTrial]:
    """Try every method of ``solve_ivp`` at every tolerance."""
    plant = plant_of(rig)
    gap, load = rig.settings.gap_m, rig.settings.load.force_N
    current = find_equilibrium(ProjectPlant(rig, 64), gap, load)
    trials = []
    for method in METHODS:
        for tolerance in TOLERANCES:
            simulator = ByScipy(plant, method, tolerance)
            error = errors(rig, {"": simulator})[""]
            best_seconds = min(
                processor_seconds(lambda: open_loop(simulator, current, load, gap))  # noqa: B023
                for _ in range(3)
            )
            trials.append(SolverTrial(method, tolerance, error, best_seconds))
    return trials


def select_setting(trials: list[SolverTrial], error: float) -> SolverTrial:
    """Return the fastest setting with at most this error, or the most accurate if there is none."""
    accurate_trials = [trial for trial in trials if trial.error <= error]
    if not accurate_trials:
        return min(trials, key=lambda trial: trial.error)
    return min(accurate_trials, key=lambda trial: trial.seconds)


def measure() -> tuple[list[SpeedResult], dict[str, float], list[SolverTrial], SolverTrial]:
    """Measure all simulators, errors and settings of SciPy, and select a setting."""
    case = example()
    substeps = case.rig.settings.timing.substeps
    plant = plant_of(case.rig)
    numba = ByNumba(plant, substeps)
    accuracy = errors(case.rig, {"ours": ProjectPlant(case.rig, substeps), "numba": numba})
    accuracy["numba, 64 sub-steps"] = errors(case.rig, {"": ByNumba(plant, 64)})[""]
    trials = try_all_settings(case.rig)
    selected_setting = select_setting(trials, accuracy["ours"])
    variants: list[tuple[MethodName, NumberFormat]] = [
        ("full", "fixed"),
        ("full", "f64"),
        ("simplified", "fixed"),
        ("single-valued", "f64"),
    ]
    project_results = [measure_project(case, *variant) for variant in variants]
    project_results.append(baseline(case, numba, "numba, map", REPETITIONS))
    scipy = ByScipy(plant, selected_setting.method, selected_setting.tolerance)
    project_results.append(
        baseline(case, scipy, f"SciPy {selected_setting.method} {selected_setting.tolerance:g}, map", 1)
    )
    return project_results, accuracy, trials, selected_setting


def rows() -> list[Row]:
    """Return the rows: this project with compiled `full`, and the baselines with a map."""
    project_results, accuracy, _, selected_setting = measure()
    full_result, *_, map_result, numba, scipy = project_results
    return [
        Row(
            "closed loop, 20 kHz, 4 sub-steps, 24 cells, `full` in fixed point: "
            "simulated time / processor time",
            ">= 25 (goal 50), with baselines",
            f"{full_result.real_time_factor:.1f}; with a map as the baselines {map_result.real_time_factor:.1f}, "
            f"numba {numba.real_time_factor:.1f}, SciPy ({selected_setting.method}, {selected_setting.tolerance:g}) "
            f"{scipy.real_time_factor:.3f}; "
            f"`full` against numba {full_result.real_time_factor / numba.real_time_factor:.2f}, "
            f"against SciPy {full_result.real_time_factor / scipy.real_time_factor:.0f}",
            full_result.real_time_factor >= 25.0,
        ),
        Row(
            "open-loop force error against 64 sub-steps",
            "SciPy as accurate as ours",
            f"ours {100 * accuracy['ours']:.4f} % of its range, numba "
            f"{100 * accuracy['numba']:.4f} %, SciPy {100 * selected_setting.error:.4f} %; overshoot with a "
            f"map {map_result.overshoot:.2f} %, {numba.overshoot:.2f} %, {scipy.overshoot:.2f} %",
            selected_setting.error <= accuracy["ours"],
        ),
    ]


if __name__ == "__main__":
    measured, accuracies, settings, chosen = measure()
    for one in settings:
        mark = "*" if one == chosen else " "
        print(
            f"{mark} {one.method:6s} {one.tolerance:.0e}  error {100 * one.error:.5f} %  "
            f"{1e3 * one.seconds:.1f} ms for 3 ms"
        )
    for name, value in accuracies.items():
        print(f"error of {name}: {100 * value:.5f} %")
    for simulator in measured:
        print(
            f"{simulator.name:28s} {simulator.real_time_factor:8.3f} times real time, overshoot "
            f"{simulator.overshoot:.2f} %"
        )
