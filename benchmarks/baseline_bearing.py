"""Simulate the bearing of ``examples/bearing`` with SciPy and with numba, as baselines.

Both simulators implement the equations from their description, independently of the C code: pinned
cells, one reluctance circuit, a PI current amplifier with limited supply voltage, the mechanics
with stops, the load drive, the gap sensor, and 20 kHz control by a PIDD2 and a map from force to
current. They omit parts that this case does not need: lift-off, controller states, other sensors,
the second magnet, eddy currents, and recordings other than gap and force. The noise is generated in
advance.

:class:`ByScipy` calls ``solve_ivp`` for each tick. Its state is the flux linkage, whose rate is
continuous when cells begin to move, so that the steps stay long. Newton's method finds the field,
starting from the last field. Plain Python floats are used, because they are faster than arrays for
so few moving cells. The first trial step is the whole tick. The cell states are updated at every
tick.

:class:`ByNumba` uses the scheme of the plant: half a step of velocity, the gap, the winding by the
trapezoidal rule, and the other half step of velocity. The whole loop is compiled for this machine,
without fast-math options. The sum over cells that do not move is computed once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numba import njit
from scipy.integrate import solve_ivp

from anhyst.support.numeric import FloatArray

Array = FloatArray
Method = Literal["RK23", "RK45", "LSODA", "Radau"]
MU_0 = 4e-7 * math.pi


class Plant(NamedTuple):
    """Parameters of a bearing, in SI units."""

    thresholds: Array  # A/m, ascending
    weights: Array
    sharp_saturation: float  # saturation of the sharp part, T
    knee_sharp: float  # A/m
    slow_saturation: float
    knee_slow: float
    turns: float
    resistance: float
    length: float  # length of the iron path, m
    area: float  # m^2
    width: float  # width of a pole, m
    depth: float
    leakage_permeance: float  # H
    supply_voltage: float  # V
    current_gain: float  # V/A
    current_integral_gain: float  # integral gain, V/(A s)
    mass_kg: float
    stop_low: float  # m
    stop_high: float
    stop_stiffness: float  # N/m
    stop_damping: float  # N s/m
    load_corner: float  # rad/s
    sensor_corner: float  # rad/s
    sensor_low: float  # m
    sensor_step: float  # m
    tick: float  # s


class Control(NamedTuple):
    """Constants of a PIDD2 for one tick, and a map from force and gap to current."""

    proportional: float
    integral: float
    derivative: float
    acceleration_gain: float
    anti_windup_gain: float
    smoothing: float
    smoothing_2: float
    set_point_weight: float
    demand_low: float  # N
    demand_high: float
    gap_middle: float  # gap at position 0, m
    currents: Array  # A, gaps x forces
    gap_low: float
    gap_high: float
    force_high: float
    current_high: float
    current_step: float  # step of the converter, A


@dataclass
class LevitationRun:
    """Gap and force, one value for each tick."""

    gap: Array
    force: Array


@njit(error_model="numpy")
def _controller(c: Control, memory: Array, set_point: float, gap_reading: float) -> float:
    """Return the current of this tick; `memory` contains position, velocity and integral."""
    wanted_position, position = c.gap_middle - set_point, c.gap_middle - gap_reading
    first_gap = c.smoothing * (position - memory[0])
    second_difference = c.smoothing_2 * (first_gap - memory[1])
    demand = (
        c.proportional * (c.set_point_weight * wanted_position - position)
        + memory[2]
        - c.derivative * first_gap
        - c.acceleration_gain * second_difference
    )
    force = min(max(demand, c.demand_low), c.demand_high)
    memory[0] += first_gap
    memory[1] += second_difference
    memory[2] += c.integral * (wanted_position - position) + c.anti_windup_gain * (force - demand)
    gaps, forces = c.currents.shape
    gap_index = min(max((gap_reading - c.gap_low) / (c.gap_high - c.gap_low), 0.0), 1.0) * (gaps - 1)
    force_index = min(max(force / c.force_high, 0.0), 1.0) * (forces - 1)
    i, j = min(int(gap_index), gaps - 2), min(int(force_index), forces - 2)
    row_part, column_part = gap_index - i, force_index - j
    nearer_current = c.currents[i, j] + column_part * (c.currents[i, j + 1] - c.currents[i, j])
    farther_current = c.currents[i + 1, j] + column_part * (c.currents[i + 1, j + 1] - c.currents[i + 1, j])
    current = min(max(nearer_current + row_part * (farther_current - nearer_current), 0.0), c.current_high)
    return float(math.floor(current / c.current_step + 0.5) * c.current_step)


class ByScipy:
    """Simulate each tick with ``solve_ivp``.

    Parameters
    ----------
    plant : Plant
    method : str
        Method of ``solve_ivp``.
    tolerance : float
        Relative tolerance. The absolute tolerance is this fraction of a typical value of each state.
    """

    def __init__(self, plant: Plant, method: Method, tolerance: float) -> None:
        self.plant = plant
        self._method, self._tolerance = method, tolerance
        self._cells = list(zip(plant.thresholds.tolist(), plant.weights.tolist(), strict=True))
        self._plays = [0.0] * len(self._cells)
        self._cell_sums = [0.0] * (len(self._cells) + 1)
        self._absolute_tolerance = tolerance * np.array([0.05, 3.0, 100.0, 1e-5, 1e-2, 1e-5])
        self._state = np.zeros(6)  # linkage, integral, load, gap, velocity, sensor
        self._field = 0.0
        self._command = self._next_command = 0.0

    def start(self, gap: float, current: float, load: float) -> float:
        """Hold the position; return the magnet's force, N."""
        p = self.plant
        self._plays = [0.0] * len(self._cells)
        self._cell_sums = [0.0] * (len(self._cells) + 1)
        low_current, high_current = -1e5, 1e5
        for _ in range(200):
            field = 0.5 * (low_current + high_current)
            needed = p.length * field + self._outer_circuit(gap)[0] * p.area * self._flux_density(field)[0]
            low_current, high_current = (
                (field, high_current) if needed < p.turns * current else (low_current, field)
            )
        self._move_cells(field)
        density = self._flux_density(field)[0]
        psi = p.turns * p.area * density
        self._field = field
        self._state = np.array([psi, p.resistance * current, load, gap, 0.0, gap])
        self._command = self._next_command = current
        return self._magnet_force(density, gap)

    def advance(self, command: float, load: float) -> tuple[float, float]:
        """Advance by one tick with the previous command; return gap, m, and force, N."""
        p = self.plant
        self._command, self._next_command = self._next_command, command
        solution = solve_ivp(
            self._state_rates,
            (0.0, p.tick),
            self._state,
            method=self._method,
            args=(load,),
            first_step=p.tick,
            rtol=self._tolerance,
            atol=self._absolute_tolerance,
        )
        self._state = solution.y[:, -1]
        density, gap = float(self._state[0]) / (p.turns * p.area), float(self._state[3])
        self._move_cells(self._field_for_density(density))
        return gap, self._magnet_force(density, gap)

    def run(
        self, control: Control, memory: Array, set_point: Array, load: Array, noise: Array
    ) -> LevitationRun:
        """Run the closed loop."""
        p, ticks = self.plant, set_point.size
        run = LevitationRun(np.empty(ticks), np.empty(ticks))
        for tick in range(ticks):
            gap_reading = float(self._state[5]) + float(noise[tick])
            step_count = math.floor((gap_reading - p.sensor_low) / p.sensor_step + 0.5)
            gap_reading = p.sensor_low + step_count * p.sensor_step
            command = _controller(control, memory, float(set_point[tick]), gap_reading)
            run.gap[tick], run.force[tick] = self.advance(command, float(load[tick]))
        return run

    def _state_rates(self, _: float, state: Array, load_command: float) -> list[float]:
        p = self.plant
        psi, integral, load, gap, velocity, sensor = state.tolist()
        density = psi / (p.turns * p.area)
        field = self._field_for_density(density)
        outer_reluctance = self._outer_circuit(gap)[0]
        current = (p.length * field + outer_reluctance * p.area * density) / p.turns
        error = self._command - current
        voltage = p.current_gain * error + integral
        is_within_supply = abs(voltage) <= p.supply_voltage
        if not is_within_supply:
            voltage = math.copysign(p.supply_voltage, voltage)
        stop_overrun = max(gap - p.stop_high, 0.0) + min(gap - p.stop_low, 0.0)
        net_force = load - self._magnet_force(density, gap) - p.stop_stiffness * stop_overrun
        if stop_overrun:
            net_force -= p.stop_damping * velocity
        return [
            voltage - p.resistance * current,
            p.current_integral_gain * error if is_within_supply else 0.0,
            p.load_corner * (load_command - load),
            velocity,
            net_force / p.mass_kg,
            p.sensor_corner * (gap - sensor),
        ]

    def _outer_circuit(self, gap: float) -> tuple[float, float, float]:
        """Return reluctance outside the iron, 1/H, flux fraction in the gaps, gap area, m^2."""
        p = self.plant
        area = (p.width + gap) * (p.depth + gap)
        gaps = MU_0 * area / (2.0 * gap)
        return 1.0 / (gaps + p.leakage_permeance), gaps / (gaps + p.leakage_permeance), area

    def _magnet_force(self, density: float, gap: float) -> float:
        p = self.plant
        _, gap_fraction, area = self._outer_circuit(gap)
        flux = density * p.area * gap_fraction
        fringe_factor = 1.0 - gap * (p.width + p.depth + 2.0 * gap) / area
        return flux * flux / (MU_0 * area) * fringe_factor

    def _field_for_density(self, density: float) -> float:
        """Return the field for a flux density, A/m, starting from the last result."""
        field, low_field, high_field = self._field, -math.inf, math.inf
        for _ in range(100):
            trial_density, slope = self._flux_density(field)
            density_error = density - trial_density
            if abs(density_error) <= 1e-10:
                break
            low_field, high_field = (field, high_field) if density_error > 0.0 else (low_field, field)
            field += density_error / slope
            if not low_field < field < high_field:
                is_bracketed = math.isfinite(low_field) and math.isfinite(high_field)
                field = 0.5 * (low_field + high_field) if is_bracketed else field
        self._field = field
        return field

    def _flux_density(self, field: float) -> tuple[float, float]:
        """Return flux density and slope for a move from the last tick to this field."""
        p, density, slope = self.plant, MU_0 * field, MU_0
        for number, (threshold, weight) in enumerate(self._cells):
            distance = field - self._plays[number]
            if abs(distance) < threshold:
                return density + self._cell_sums[number], slope
            h = field - math.copysign(threshold, distance)
            root = math.sqrt(h * h + p.knee_sharp * p.knee_sharp)
            polarisation = p.sharp_saturation * h / root + 2.0 / math.pi * p.slow_saturation * math.atan(
                h / p.knee_slow
            )
            polarisation_slope = p.sharp_saturation * p.knee_sharp**2 / root**3
            polarisation_slope += 2.0 / math.pi * p.slow_saturation * p.knee_slow / (p.knee_slow**2 + h * h)
            density += weight * polarisation
            slope += weight * polarisation_slope
        return density, slope

    def _move_cells(self, field: float) -> None:
        p = self.plant
        moved_count = 0
        for number, (threshold, _) in enumerate(self._cells):
            distance = field - self._plays[number]
            if abs(distance) < threshold:
                break
            self._plays[number] = field - math.copysign(threshold, distance)
            moved_count = number + 1
        for number in range(moved_count - 1, -1, -1):
            h = self._plays[number]
            polarisation = p.sharp_saturation * h / math.hypot(h, p.knee_sharp)
            polarisation += 2.0 / math.pi * p.slow_saturation * math.atan(h / p.knee_slow)
            self._cell_sums[number] = self._cell_sums[number + 1] + self._cells[number][1] * polarisation


# State of the compiled baseline, in the order of these names.
(
    FIELD_INDEX,
    FIELD_STEP_INDEX,
    LINKAGE_INDEX,
    CURRENT_INDEX,
    INTEGRAL_INDEX,
    LOAD_INDEX,
    GAP_INDEX,
    VELOCITY_INDEX,
    FORCE_INDEX,
    SENSOR_INDEX,
    NEXT_COMMAND_INDEX,
    COMMAND_INDEX,
) = range(12)
TOLERANCE = 1e-7  # of the flux density, T


@njit(error_model="numpy")
def _polarisation(p: Plant, field: float) -> tuple[float, float]:
    inverse_root = 1.0 / math.sqrt(field * field + p.knee_sharp * p.knee_sharp)
    ratio = field / p.knee_slow
    slow_factor = 2.0 / math.pi * p.slow_saturation
    slope = p.sharp_saturation * p.knee_sharp * p.knee_sharp * inverse_root * inverse_root * inverse_root
    slope += slow_factor / (p.knee_slow * (1.0 + ratio * ratio))
    return p.sharp_saturation * field * inverse_root + slow_factor * math.atan(ratio), slope


@njit(error_model="numpy")
def _flux_density(p: Plant, plays: Array, cell_sums: Array, field: float) -> tuple[float, float]:
    density, slope = MU_0 * field, MU_0
    for k in range(p.thresholds.size):
        distance, r = field - plays[k], p.thresholds[k]
        if abs(distance) < r:
            return density + cell_sums[k], slope
        polarisation, polarisation_slope = _polarisation(p, field - r if distance > 0.0 else field + r)
        density += p.weights[k] * polarisation
        slope += p.weights[k] * polarisation_slope
    return density, slope


@njit(error_model="numpy")
def _move_cells(p: Plant, plays: Array, cell_sums: Array, field: float) -> None:
    moved_count = 0
    for k in range(p.thresholds.size):
        distance, r = field - plays[k], p.thresholds[k]
        if abs(distance) < r:
            break
        plays[k] = field - r if distance > 0.0 else field + r
        moved_count = k + 1
    for k in range(moved_count - 1, -1, -1):
        cell_sums[k] = cell_sums[k + 1] + p.weights[k] * _polarisation(p, plays[k])[0]


@njit(error_model="numpy")
def _solve_field(
    p: Plant,
    plays: Array,
    cell_sums: Array,
    start_field: float,
    a: float,
    b: float,
    r: float,
    tolerance: float,
) -> tuple[float, float]:
    """Solve a*H + b*B = r by Newton's method within a bracket."""
    field, low, high, density = start_field, -np.inf, np.inf, 0.0
    for _ in range(100):
        density, slope = _flux_density(p, plays, cell_sums, field)
        residual = r - a * field - b * density
        if abs(residual) <= tolerance:
            break
        if residual > 0.0:
            low = field
            high = min(high, field + residual / a)
        else:
            high = field
            low = max(low, field + residual / a)
        field += residual / (a + b * slope)
        if not low < field < high:
            field = 0.5 * (low + high)
    return field, density


@njit(error_model="numpy")
def _gap_circuit(p: Plant, gap: float) -> tuple[float, float, float, float]:
    area = (p.width + gap) * (p.depth + gap)
    gap_permeance = MU_0 * area / (2.0 * gap)
    outer_reluctance = 1.0 / (gap_permeance + p.leakage_permeance)
    return (
        outer_reluctance,
        gap_permeance * outer_reluctance,
        area,
        1.0 - gap * (p.width + p.depth + 2.0 * gap) / area,
    )


@njit(error_model="numpy")
def _advance_winding(p: Plant, s: Array, plays: Array, cell_sums: Array, time_step: float) -> None:
    half_step, error = 0.5 * time_step, s[COMMAND_INDEX] - s[CURRENT_INDEX]
    voltage = p.current_gain * error + s[INTEGRAL_INDEX]
    is_saturated = abs(voltage) > p.supply_voltage
    if is_saturated:
        voltage = math.copysign(p.supply_voltage, voltage)
    explicit_linkage = s[LINKAGE_INDEX] + half_step * (voltage - p.resistance * s[CURRENT_INDEX])
    total_gain = p.current_gain + half_step * p.current_integral_gain
    voltage_offset = (
        total_gain * s[COMMAND_INDEX] + s[INTEGRAL_INDEX] + half_step * p.current_integral_gain * error
    )
    outer_reluctance, gap_fraction, area, fringe_factor = _gap_circuit(p, s[GAP_INDEX])
    weight, per_field = p.turns * p.area, p.length / p.turns
    per_density = outer_reluctance * p.area / p.turns
    for _ in range(2):
        current_factor = half_step * (total_gain + p.resistance)
        field, density = _solve_field(
            p,
            plays,
            cell_sums,
            s[FIELD_INDEX] + s[FIELD_STEP_INDEX],
            current_factor * per_field,
            weight + current_factor * per_density,
            explicit_linkage + half_step * voltage_offset,
            weight * TOLERANCE,
        )
        current = per_field * field + per_density * density
        voltage = voltage_offset - total_gain * current
        if abs(voltage) <= p.supply_voltage:
            break
        is_saturated, total_gain, voltage_offset = True, 0.0, math.copysign(p.supply_voltage, voltage)
    s[LINKAGE_INDEX] = explicit_linkage + half_step * (voltage - p.resistance * current)
    if not is_saturated:
        s[INTEGRAL_INDEX] += half_step * p.current_integral_gain * (error + s[COMMAND_INDEX] - current)
    s[CURRENT_INDEX], s[FIELD_STEP_INDEX], s[FIELD_INDEX] = current, field - s[FIELD_INDEX], field
    _move_cells(p, plays, cell_sums, field)
    flux = (MU_0 * field + cell_sums[0]) * p.area * gap_fraction
    s[FORCE_INDEX] = flux * flux / (MU_0 * area) * fringe_factor


@njit(error_model="numpy")
def _net_force(p: Plant, s: Array) -> tuple[float, float]:
    stop_overrun = max(s[GAP_INDEX] - p.stop_high, 0.0) + min(s[GAP_INDEX] - p.stop_low, 0.0)
    damping = p.stop_damping if stop_overrun != 0.0 else 0.0
    return s[LOAD_INDEX] - s[FORCE_INDEX] - p.stop_stiffness * stop_overrun, damping


@njit(error_model="numpy")
def _advance_tick(
    p: Plant, s: Array, plays: Array, cell_sums: Array, substeps: int, command: float, load: float
) -> None:
    time_step = p.tick / substeps
    velocity_per_force = 0.5 * time_step / p.mass_kg
    load_factor = -math.expm1(-p.load_corner * time_step)
    sensor_factor = -math.expm1(-p.sensor_corner * time_step)
    s[COMMAND_INDEX], s[NEXT_COMMAND_INDEX] = s[NEXT_COMMAND_INDEX], command
    for _ in range(substeps):
        previous_gap = s[GAP_INDEX]
        force, damping = _net_force(p, s)
        s[VELOCITY_INDEX] += velocity_per_force * (force - damping * s[VELOCITY_INDEX])
        s[GAP_INDEX] += time_step * s[VELOCITY_INDEX]
        _advance_winding(p, s, plays, cell_sums, time_step)
        s[LOAD_INDEX] += load_factor * (load - s[LOAD_INDEX])
        force, damping = _net_force(p, s)
        s[VELOCITY_INDEX] = (s[VELOCITY_INDEX] + velocity_per_force * force) / (
            1.0 + velocity_per_force * damping
        )
        s[SENSOR_INDEX] += sensor_factor * (0.5 * (previous_gap + s[GAP_INDEX]) - s[SENSOR_INDEX])


@njit(error_model="numpy")
def _run_ticks(
    p: Plant,
    c: Control,
    s: Array,
    plays: Array,
    cell_sums: Array,
    memory: Array,
    substeps: int,
    set_point: Array,
    load: Array,
    noise: Array,
    gap_and_force: Array,
) -> None:
    for tick in range(set_point.size):
        gap_reading = s[SENSOR_INDEX] + noise[tick]
        gap_reading = (
            p.sensor_low + math.floor((gap_reading - p.sensor_low) / p.sensor_step + 0.5) * p.sensor_step
        )
        command = _controller(c, memory, set_point[tick], gap_reading)
        _advance_tick(p, s, plays, cell_sums, substeps, command, load[tick])
        gap_and_force[tick, 0], gap_and_force[tick, 1] = s[GAP_INDEX], s[FORCE_INDEX]


class ByNumba:
    """Simulate the whole loop in compiled code.

    Parameters
    ----------
    plant : Plant
    substeps : int
        Number of sub-steps per tick.
    """

    def __init__(self, plant: Plant, substeps: int) -> None:
        self.plant, self._substeps = plant, substeps
        self._state = np.zeros(12)
        self._plays = np.zeros(plant.thresholds.size)
        self._cell_sums = np.zeros(plant.thresholds.size + 1)

    def start(self, gap: float, current: float, load: float) -> float:
        """Hold the position; return the magnet's force, N."""
        p, s = self.plant, self._state
        self._plays[:] = 0.0
        self._cell_sums[:] = 0.0
        outer_reluctance, gap_fraction, area, fringe_factor = _gap_circuit(p, gap)
        density_factor = outer_reluctance * p.area
        field, _ = _solve_field(
            p,
            self._plays,
            self._cell_sums,
            0.0,
            p.length,
            density_factor,
            p.turns * current,
            density_factor * 1e-12,
        )
        _move_cells(p, self._plays, self._cell_sums, field)
        density = MU_0 * field + self._cell_sums[0]
        s[:] = 0.0
        s[FIELD_INDEX], s[LINKAGE_INDEX], s[CURRENT_INDEX] = field, p.turns * p.area * density, current
        s[INTEGRAL_INDEX], s[LOAD_INDEX], s[GAP_INDEX], s[SENSOR_INDEX] = (
            p.resistance * current,
            load,
            gap,
            gap,
        )
        s[COMMAND_INDEX] = s[NEXT_COMMAND_INDEX] = current
        flux = density * p.area * gap_fraction
        s[FORCE_INDEX] = flux * flux / (MU_0 * area) * fringe_factor
        return float(s[FORCE_INDEX])

    def advance(self, command: float, load: float) -> tuple[float, float]:
        """Advance by one tick with the previous command; return gap, m, and force, N."""
        s = self._state
        _advance_tick(self.plant, s, self._plays, self._cell_sums, self._substeps, command, load)
        return float(s[GAP_INDEX]), float(s[FORCE_INDEX])

    def run(
        self, control: Control, memory: Array, set_point: Array, load: Array, noise: Array
    ) -> LevitationRun:
        """Run the closed loop."""
        gap_and_force = np.empty((set_point.size, 2))
        _run_ticks(
            self.plant,
            control,
            self._state,
            self._plays,
            self._cell_sums,
            memory,
            self._substeps,
            set_point,
            load,
            noise,
            gap_and_force,
        )
        return LevitationRun(gap_and_force[:, 0].copy(), gap_and_force[:, 1].copy())
