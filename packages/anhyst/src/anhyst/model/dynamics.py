"""Model the dynamics of an actuator: lag, creep, eddy circuit, and layers of solid iron.

The effective field follows the delayed drive. Creep states ``s_j`` follow the flux density ``B`` of
the iron (for a piezo, its polarisation) slowly, and are added to it::

    output(t) = c_out * (B + sum_j w_j s_j)**power + out_0,    T_j ds_j/dt = B - s_j

A sample is held until the next one, so each ``s_j`` depends on earlier samples only. Therefore, the
inverse can subtract the creep from the demand, solve for ``B``, and then update the creep states.

Solid iron consists of ``N`` layers between which the field diffuses. Layer ``j``, counted from the
surface, has a fraction ``phi_j`` of the cross-section and its own field ``H_j``. The fractions are
a geometric series. ``S_j`` is the flux in layer ``j`` and all deeper layers, divided by the whole
cross-section. ``d_j`` is the distance between the middles of two layers, divided by that of the
first and the last layer::

    H_(j-1) = H_j + d_j*gamma * dS_j/dt,    j = 2..N
    c_H(gap) * (input - in_0) = l*H_l + (1 - l)*H_1 + rho(gap)*B/mu0,    B = S_1

A fraction ``l`` of the flux path is laminated, without eddy currents; its field is ``H_l``. At
rest, all fields are equal, and the model is that of one layer (docs/rate.md).

An eddy circuit describes rings around iron with one field. A fraction ``f`` of the eddy currents
flows in a ring with leakage flux, and domain walls cause an excess loss::

    c_H*(input - in_0) = H + rho*B/mu0 + (1 - f)*gamma*dB/dt + f*gamma*dZ/dt + k*sign*sqrt|dB/dt|
    T*dZ/dt = B - Z
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray

GAMMA_NAME = "gamma (A s/(m T))"
"""Name of gamma among the fitted quantities."""


@dataclass(frozen=True)
class Dynamics:
    """Lag and creep of an actuator."""

    lag: float = 0.0  # delay from the drive to the output, s, 0 or above
    times: tuple[float, ...] = ()  # time constants of the creep, s, above 0, ascending
    # final contribution of each creep component, relative to the immediate output; 0 or above
    shares: tuple[float, ...] = ()
    # highest cycle rate at which the model was validated, Hz; 0: unknown
    fastest: float = 0.0

    def __post_init__(self) -> None:
        values = (self.lag, self.fastest, *self.times, *self.shares)
        if not all(math.isfinite(value) and value >= 0.0 for value in values):
            text = "model dynamics: lag, times, shares and rate must be finite and not negative"
            raise InputError(text, code="out-of-range")
        if len(self.times) != len(self.shares):
            raise InputError(
                "model dynamics: give one creep share for each creep time", code="length-differs"
            )
        if any(time <= 0.0 for time in self.times) or list(self.times) != sorted(set(self.times)):
            raise InputError("model dynamics: creep times must be above 0 and ascend", code="not-ascending")

    @property
    def needs_time(self) -> bool:
        """Whether a run needs the times of its samples."""
        return self.lag > 0.0 or bool(self.times)

    def advance_creep(self, flux: float, creep_states: FloatArray, time_step: float) -> FloatArray:
        """Return the creep states after the flux density has been constant for a time, s."""
        return np.asarray(flux + np.exp(-time_step / np.array(self.times)) * (creep_states - flux))

    def apply_creep(
        self, inputs: FloatArray, time: FloatArray, creep_states: FloatArray, *, is_flux_known: bool
    ) -> tuple[FloatArray, FloatArray, float]:
        """Add creep to a known flux density, or subtract it from a flux density that includes it.

        Return the resulting record, the creep states at its last sample, and the flux density
        without creep there.
        """
        decay = np.exp(-np.diff(time, prepend=time[0])[:, None] / np.array(self.times))
        shares = np.array(self.shares)
        if is_flux_known:
            creep_rows = np.stack(
                [_follow_known_flux(inputs, *pair) for pair in zip(decay.T, creep_states, strict=True)]
            )
            return inputs + shares @ creep_rows, creep_rows[:, -1], float(inputs[-1])
        creep = np.empty(inputs.size)
        flux_before = 0.0
        for i, value in enumerate(inputs.tolist()):
            creep_states = flux_before + decay[i] * (creep_states - flux_before) if i else creep_states
            creep[i] = flux_before = value - float(shares @ creep_states)
        return creep, creep_states, flux_before

    def settled_creep(self, inputs: FloatArray, time: FloatArray, *, is_flux_known: bool) -> FloatArray:
        """Return the creep states at the start of a cycle in its steady state."""
        time_step = float(np.median(np.diff(time)))

        def run_cycle(states: FloatArray) -> FloatArray:
            _, end_states, last_flux = self.apply_creep(inputs, time, states, is_flux_known=is_flux_known)
            return self.advance_creep(last_flux, end_states, time_step)

        forced_states = run_cycle(np.zeros(len(self.times)))
        cycle_matrix = np.stack([run_cycle(unit) - forced_states for unit in np.eye(len(self.times))], axis=1)
        return np.asarray(np.linalg.solve(np.eye(len(self.times)) - cycle_matrix, forced_states))

    def delay_record(self, values: FloatArray, time: FloatArray) -> FloatArray:
        """Return a record delayed by the lag, with its first value before its start."""
        return np.interp(time - self.lag, time, values)


def _follow_known_flux(inputs: FloatArray, decay: FloatArray, start: float) -> FloatArray:
    """Return the state ``s_j`` of one creep time constant for a known flux density.

    Python floats are faster than arrays here.
    """
    creep_state, flux_before = float(start), 0.0
    creep_values: list[float] = []
    for step_decay, value in zip(decay.tolist(), inputs.tolist(), strict=True):
        creep_state = flux_before + step_decay * (creep_state - flux_before) if creep_values else creep_state
        creep_values.append(creep_state)
        flux_before = value
    return np.array(creep_values)


MAX_LAYERS = 16
_RATIO_BISECTIONS = 80


@dataclass(frozen=True)
class Layers:
    """Layers of solid iron; ``gamma`` of the model determines the delay of the inner layers."""

    count: int  # number of layers, 2 to 16
    surface: float  # fraction of the cross-section in the first layer, above 0 and below 1
    laminated: float = 0.0  # fraction of the path in sheets, 0 or above and below 1

    def __post_init__(self) -> None:
        for key, is_wrong, range_text in (
            ("count", not 2 <= self.count <= MAX_LAYERS, f"from 2 to {MAX_LAYERS}"),
            ("surface", not 0.0 < self.surface < 1.0, "above 0 and below 1"),
            ("laminated", not 0.0 <= self.laminated < 1.0, "from 0 to below 1"),
        ):
            if is_wrong:
                text = f"model layers: {key} is {getattr(self, key):g}; give a number {range_text}"
                raise InputError(text, code="out-of-range", key=key)

    @property
    def area_fractions(self) -> FloatArray:
        """Fraction of the cross-section of each layer: a geometric series from the surface."""
        exponents = np.arange(self.count)
        low, high = 0.0, 1.0 / self.surface
        for _ in range(_RATIO_BISECTIONS):
            ratio = 0.5 * (low + high)
            is_too_small = self.surface * np.sum(ratio**exponents) < 1.0
            low, high = (ratio, high) if is_too_small else (low, ratio)
        fractions = self.surface * low**exponents
        return np.asarray(fractions / fractions.sum())

    @property
    def state_copies(self) -> int:
        """Number of copies of the law's state: the layers, and the sheets."""
        return self.count + 1

    def __str__(self) -> str:
        """Return the layers in words."""
        return (
            f"{self.count}, {100.0 * self.surface:.3g} % of the section at the surface, "
            f"{100.0 * self.laminated:.3g} % of the path laminated"
        )


@dataclass(frozen=True)
class EddyCircuit:
    """Eddy currents with a leakage flux, and excess loss, in iron with a uniform field."""

    leaky: float = 0.0  # fraction of gamma in a ring with leakage flux, 0 to 1
    delay: float = 0.0  # delay of the flux inside this ring, s, 0 or above
    excess: float = 0.0  # excess field at a rate of the flux density of 1 T/s, A/m, 0 or above

    def __post_init__(self) -> None:
        for key, is_wrong, range_text in (
            ("leaky", not 0.0 <= self.leaky <= 1.0, "from 0 to 1"),
            ("delay", not 0.0 <= self.delay < math.inf, "of 0 or above"),
            ("excess", not 0.0 <= self.excess < math.inf, "of 0 or above"),
        ):
            if is_wrong:
                text = f"model eddy circuit: {key} is {getattr(self, key):g}; give a number {range_text}"
                raise InputError(text, code="out-of-range", key=key)

    @property
    def state_numbers(self) -> int:
        """Number of states in addition to that of the law: the flux density inside the ring."""
        return int(self.leaky > 0.0)

    def core_settings(self, gamma: float) -> tuple[float, float, float]:
        """Return the numbers of `AnyIron.set_eddy_circuit`."""
        return self.leaky, self.delay / gamma, self.excess / math.sqrt(gamma)

    def __str__(self) -> str:
        """Return the eddy circuit in words."""
        parts = []
        if self.leaky > 0.0:
            parts.append(f"{100.0 * self.leaky:.3g} % in a ring with a delay of {1e3 * self.delay:.3g} ms")
        if self.excess > 0.0:
            parts.append(f"excess field of {self.excess:.3g} A/m at 1 T/s")
        return ", ".join(parts) or "none"
