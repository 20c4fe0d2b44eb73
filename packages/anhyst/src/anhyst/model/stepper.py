"""Run a model sample by sample: solve for the drive, then commit the applied drive."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anhyst.data.path import History, HistoryLike
from anhyst.model.model_data import ModelData
from anhyst.model.parameters import Circuit
from anhyst.model.predict import as_history, as_samples, check_status, initial_state, run_record
from anhyst.model.prediction import flag_samples, warn_if_far
from anhyst.support.errors import InputError, wrong_key
from anhyst.support.numeric import FloatArray


@dataclass(frozen=True, slots=True)
class Candidate:
    """Result of a trial step that has not been committed."""

    drive: float  # drive for the demanded output, in units of the input
    output: float  # output for that drive: the demand, unless the demand has no solution
    flux_density: float  # T
    valid: bool  # whether demand, drive and schedule are inside the valid range of the model


class Stepper:
    """A model with a state, for use sample by sample.

    ``solve`` returns the drive for a demand without changing the state, any number of times.
    ``commit`` advances the state with the drive that was really applied, after limits and the
    amplifier.

    >>> from anhyst.support.units import QUANTITIES
    >>> from anhyst.model.actuator import Model
    >>> iron = dict(M_s=4e5, a=30.0, k=20.0, c=0.2, c_H=1.0, c_out=1.0)
    >>> model = Model("core", QUANTITIES["field"], QUANTITIES["flux_density"], iron)
    >>> stepper = model.stepper()
    >>> wanted = stepper.solve(0.3).drive
    >>> round(stepper.commit(min(wanted, 50.0)), 3) < 0.3  # the amplifier gave less
    True
    """

    def __init__(
        self, model: ModelData, schedule: float | None = None, history: HistoryLike | None = None
    ) -> None:
        self.model = model
        self._schedule = schedule = model.schedule_or_default(schedule)
        warn_if_far(model, model.input, np.zeros(1), self._schedule)
        self._iron = model.iron_at(self._schedule)
        history_before = as_history(history, model)
        if history_before.kind == "settled":
            if model.valid is None:
                raise InputError(
                    "a stepper cannot start settled: the model has no valid range of the input for "
                    "the cycle; pass history='demagnetised' or 'conditioned:...'",
                    code="no-valid-range",
                    key="valid",
                )
            low, high = model.valid.input
            slow_times = [0.0, 1e9, 2e9]  # eddy currents are negligible
            cycle = [low, high, low]
            self._state = run_record(model, "drive", cycle, schedule, slow_times, "settled").state
        else:
            self._state = initial_state(model, self._iron, history_before, self._schedule)
        self._output: float | None = None
        # cache of the last step: schedule, time step, whether a step was committed, and circuit
        self._circuit_cache: tuple[float, float | None, bool, Circuit] | None = None
        dynamics = model.dynamics
        self._dynamics = dynamics if dynamics is not None and dynamics.times else None
        self._flux = self._flux_at_rest(history_before)
        self._creep_state = np.full(len(self._dynamics.times) if self._dynamics else 0, self._flux)

    def _flux_at_rest(self, initial_history: History) -> float:
        """Return the flux density before the first step, after creep has settled, T."""
        if self._dynamics is None or initial_history.kind == "demagnetised":
            return 0.0
        points = initial_history.turning_points
        if initial_history.kind == "settled" and self.model.valid is not None:
            points = self.model.valid.input[:1]
        circuit = self._present_circuit(self._schedule, None)
        core = circuit.magnetomotive(np.array(points[-1:]))
        return float(self._iron.forward(core, circuit.rho, circuit.eddy, self._state)[0][0])

    def _present_creep(self, dt: float | None) -> tuple[float, FloatArray]:
        """Return the present contribution of creep to the flux density, T, and the creep states."""
        if self._dynamics is None:
            return 0.0, self._creep_state
        creep_state = self._creep_state
        if self._output is not None:
            if dt is None:
                text = "the model has creep ([dynamics]); give the time step dt"
                raise wrong_key("dt", text, code="time-missing")
            creep_state = self._dynamics.advance_creep(self._flux, creep_state, dt)
        return float(np.array(self._dynamics.shares) @ creep_state), creep_state

    @property
    def state(self) -> FloatArray:
        """A copy of the state of the iron, in the format of its law."""
        return self._state.copy()

    @property
    def schedule(self) -> float:
        """Scheduling variable at the last commit, SI."""
        return self._schedule

    @property
    def output(self) -> float | None:
        """Output after the last commit, in units of the output; None before the first commit."""
        return self._output

    def solve(self, demand: float, schedule: float | None = None, dt: float | None = None) -> Candidate:
        """Return the drive for a demanded output; the state does not change."""
        demands = as_samples([demand], "demand")
        gap = self._check_schedule(schedule)
        circuit = self._present_circuit(gap, dt)
        flux, reachable = circuit.flux_density(demands)
        flux = flux - self._present_creep(dt)[0]
        drive, _, _, status, _ = self._iron.inverse(flux, circuit.rho, circuit.eddy, self._state)
        check_status(status, "demand", 0, demands)
        applied_drive = circuit.drive(drive)
        is_valid, _ = flag_samples(self.model, "demand", applied_drive, demands, np.array([gap]), reachable)
        return Candidate(
            drive=float(applied_drive[0]),
            output=float(demand if reachable[0] else circuit.output(flux)[0]),
            flux_density=float(flux[0]),
            valid=bool(is_valid[0]),
        )

    def commit(self, applied: float, schedule: float | None = None, dt: float | None = None) -> float:
        """Advance the state with the applied drive; return the output."""
        drive = as_samples([applied], "applied drive")
        gap = self._check_schedule(schedule)
        circuit = self._present_circuit(gap, dt)
        core = circuit.magnetomotive(drive)
        flux, _, state, status, _ = self._iron.forward(core, circuit.rho, circuit.eddy, self._state)
        check_status(status, "applied drive", 0, drive)
        added_flux, self._creep_state = self._present_creep(dt)
        self._state, self._schedule, self._flux = state, gap, float(flux[0])
        self._output = float(circuit.output(flux + added_flux)[0])
        return self._output

    def follow(self, applied: FloatArray, schedule: FloatArray) -> FloatArray:
        """Advance the state along a row of drives, as repeated calls of :meth:`commit`."""
        drive = as_samples(applied, "applied drive")
        schedules = as_samples(schedule, "schedule", drive.size)
        if self._dynamics is not None or np.any(self.model.interpolate_parameter("gamma", schedules) > 0.0):
            reason = "creeps ([dynamics])" if self._dynamics else "has eddy currents (gamma)"
            raise InputError(
                f"the model {reason}; commit each sample with dt", code="time-missing", key="t_s"
            )
        for end in (schedules.min(), schedules.max()):
            self._check_schedule(float(end))
        circuit = self.model.circuit(schedules, np.zeros(drive.size))
        flux, _, state, status, index = self._iron.forward(
            circuit.magnetomotive(drive), circuit.rho, circuit.eddy, self._state
        )
        check_status(status, "applied drive", index, drive)
        output = circuit.output(flux)
        self._state, self._schedule, self._output = state, float(schedules[-1]), float(output[-1])
        return output

    def _check_schedule(self, schedule: float | None) -> float:
        if schedule is None:
            return self._schedule
        value = float(as_samples([schedule], "schedule")[0])
        if self.model.needs_fixed_gap and value != self._schedule:
            raise InputError(
                "the schedule moved, but in this model (gap map 'free') the iron itself varies "
                "with it; start another stepper, or identify with the gap map scaling or reluctance",
                code="schedule-moves",
            )
        return value

    def _present_circuit(self, schedule: float, dt: float | None) -> Circuit:
        if dt is not None and not dt > 0.0:
            raise wrong_key("dt", f"is {dt:g} s; give a time above 0", code="not-above-zero")
        is_started = self._output is not None  # the first commit has no time step
        if self._circuit_cache is not None and self._circuit_cache[:3] == (schedule, dt, is_started):
            return self._circuit_cache[3]  # at a constant gap, the cache is used in every step
        if dt is None and is_started and np.any(self.model.interpolate_parameter("gamma", [schedule]) > 0.0):
            text = "the model has eddy currents (gamma); give the time step dt"
            raise wrong_key("dt", text, code="time-missing")
        rate = 0.0 if dt is None else 1.0 / dt
        circuit = self.model.circuit(np.array([schedule]), np.array([rate]))
        self._circuit_cache = schedule, dt, is_started, circuit
        return circuit
