"""Integrate the voltage of a coil, or of a sense coil, to the flux linkage.

The flux linkage is the integral of ``u - R*i - u_0``. The flux linkage is the same in equal states
(`recurrence`) and constant at rest. These equations determine the resistance, its warming and the
offset of the voltage. Weak priors keep the warming and the offset small. The covariance of the
parameters gives the uncertainty of the flux linkage. If the uncertainty is too large, the record is
refused, and the error states the change that would help.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from operator import itemgetter

import numpy as np

from anhyst.data.estimates import estimate_noise, estimate_offsets
from anhyst.data.holes import find_holes
from anhyst.data.loops import Loop, replace_columns
from anhyst.data.path import DEMAGNETISED, SETTLED, find_runs, find_turning_points, is_bipolar
from anhyst.data.recurrence import compare_states
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray

UNKNOWN_ZERO_NOTE = (
    "the flux linkage counts from the first sample, and the remanent flux there is unknown; begin with a "
    "demagnetising (decaying alternating) current, or record both signs of the current"
)
"""Note for records whose zero of the flux linkage is neither measured nor given by symmetry."""
_MAX_UNCERTAINTY = 2e-3
"""Largest accepted standard uncertainty, as a fraction of the largest flux linkage."""
_CLOSING_ERROR = 5e-4
"""Assumed difference of equal states, as a fraction of the flux linkage: iron closes no better."""
_REST_ERROR = 1e-4
"""Assumed change of the flux linkage during a rest without noise, as such a fraction."""
_RESISTANCE_SHARE = 10.0
"""Standard deviation of the resistance before the record, relative to the largest voltage over
the largest current."""
_MIN_RESISTANCE_SHARE = 2e-3
"""Smallest resistance of a coil, relative to the same ratio. A sense coil carries no current."""
_HEAT_SHARE = 0.05
"""Standard deviation of the warming by heat that stays in the coil, relative to the resistance."""
_COOLED_SHARE = 0.02
"""Standard deviation of the warming by heat that leaves the coil, relative to the resistance."""
_COOLING_CONSTANTS = 2.0
"""Number of time constants of the cooling in a record."""
_OFFSET_V = 0.01
_OFFSET_SHARE = 0.002
"""Standard deviation of the offset: the larger of 10 mV and this fraction of the voltage."""
_HALF_RATE_RATIO = 3.0
"""Ratio of the error of an integral over every second sample to the error of the integral."""
_PASSES = 3
"""Number of solutions; each updates the weights, which depend on the largest flux linkage."""
_SMALLEST_FLUX = 1e-30
"""Smallest flux linkage, Wb, so that a voltage without an inductive part has an uncertainty."""
_REST_BLOCKS = 1000
"""Number of blocks of a record whose mean inputs show rests."""
_MIN_REST_BLOCKS = 6
_MAX_REST_STEP = 3e-4
"""Maximum difference of the input of successive blocks at rest, as a fraction of the range."""
_SETTLING_SHARE = 0.25
"""Part at the beginning of a rest that is not used: the current and eddy currents settle."""
_MIN_DECAYING_REVERSALS = 6
_DECAYS = (0.4, 0.995)
"""Range of the ratio of successive reversals of a demagnetising sine."""
_MAX_DECAYED_SHARE = 0.15
"""Largest last reversal of a demagnetising sine, relative to the first."""


@dataclass(frozen=True, slots=True)
class _Record:
    """A voltage, its integral, and the integrals that are subtracted from it to give the flux."""

    loop: Loop
    clock: FloatArray  # time since the first sample, s
    volts: FloatArray  # integral of the voltage, Wb
    basis: FloatArray  # integral for each parameter, shape (parameters, n); the last is the clock

    @classmethod
    def of(cls, loop: Loop, *, has_resistance: bool) -> _Record:
        """Return the integrals of a loop whose output is a voltage.

        With a resistance, the parameters are R, its increase with the heat that stays in the coil,
        its increase with the heat that leaves the coil, and the offset. A sense coil has an offset.
        """
        assert loop.time is not None
        clock = _even_clock(loop.time)
        basis = [clock]
        if has_resistance:
            power = (loop.input / np.max(np.abs(loop.input))) ** 2
            cooling = np.exp(_COOLING_CONSTANTS * clock / clock[-1])
            heats = (_integrate(clock, power), _integrate(clock, power * cooling) / cooling)
            factors = (np.ones(loop.n), *(heat / (heat.max() or 1.0) for heat in heats))
            basis = [*(_integrate(clock, factor * loop.input) for factor in factors), clock]
        return cls(loop, clock, _integrate(clock, loop.output), np.array(basis))

    @property
    def has_resistance(self) -> bool:
        """Whether the current flows in the coil whose voltage is measured."""
        return len(self.basis) > 1

    def prior_sigmas(self, resistance: float) -> FloatArray:
        """Return the standard deviations of the parameters before the record, Ohm and V."""
        largest_u, largest_i = (float(np.max(np.abs(v))) for v in (self.loop.output, self.loop.input))
        offset, bound = max(_OFFSET_V, _OFFSET_SHARE * largest_u), largest_u / largest_i
        resistance = min(abs(resistance), bound) or bound
        sigmas = [_RESISTANCE_SHARE * bound, _HEAT_SHARE * resistance, _COOLED_SHARE * resistance, offset]
        return np.array(sigmas if self.has_resistance else sigmas[-1:])


@dataclass(frozen=True, slots=True)
class _Fit:
    """Parameters of a record with their information matrix, and the resulting flux linkage."""

    record: _Record
    values: FloatArray
    information: FloatArray  # inverse of the covariance of the parameters
    sampling_error: float  # error of the integral from the distance of the samples, Wb

    @property
    def flux(self) -> FloatArray:
        """Flux linkage, Wb; zero at the first sample."""
        return np.asarray(self.record.volts - self.values @ self.record.basis)

    @property
    def sigmas(self) -> FloatArray:
        """Standard deviations of the parameters."""
        return np.sqrt(np.maximum(0.0, np.diag(_invert(self.information))))

    def flux_uncertainty(self, known: tuple[int, ...] = ()) -> float:
        """Return the uncertainty of the flux as a fraction of its largest magnitude.

        A constant error does not count. Parameters in ``known`` are assumed to be exact.
        """
        unknown = [n for n in range(self.values.size) if n not in known]
        deviations = self.record.basis[unknown]
        deviations = deviations - deviations.mean(axis=1, keepdims=True)
        moments = deviations @ deviations.T / self.record.clock.size
        covariance = _invert(self.information[np.ix_(unknown, unknown)])
        variance = max(0.0, float(np.trace(covariance @ moments))) + self.sampling_error**2
        return float(np.sqrt(variance)) / _largest_flux(self.record.loop.input, self.flux)


def integrate_voltage(loop: Loop, *, has_resistance: bool) -> tuple[Loop, str]:
    """Return a loop of the flux linkage from a loop of the voltage, and a note with the estimates.

    The voltage of a sense coil, which has no resistance, refers to the turns of the coil. If the flux
    linkage would not be accurate, an error states the reason and the remedy.
    """
    if np.ptp(loop.output) == 0.0:
        raise InputError(
            f"the voltage is constant ({loop.output[0]:g} V); correct the channel, or leave it out",
            code="voltage-inaccurate",
        )
    for hole in find_holes(loop.time):
        raise InputError(
            f"{hole}, but the flux linkage is the integral of all samples of the voltage; record "
            "without a pause, or label each part",
            code="voltage-hole",
        )
    fit = _fit_record(_Record.of(loop, has_resistance=has_resistance))
    _refuse_inaccurate(fit)
    return _set_zero(replace(loop, output=fit.flux)), _describe_fit(fit)


def has_known_zero(loop: Loop) -> bool:
    """Whether the history or the symmetry gives the zero of an integrated flux linkage."""
    return loop.history.kind == "demagnetised" or estimate_offsets(loop) is not None


def _fit_record(record: _Record) -> _Fit:
    """Estimate the parameters from states that recur and from rests."""
    loop, clock = record.loop, record.clock
    signals = np.concatenate([record.volts[None], record.basis])
    differences, count = compare_states(loop.input, signals)
    rests = [signals[:, rows.stop - 1] - signals[:, rows.start] for rows in _find_rests(loop.input)]
    equations = np.concatenate([differences, np.reshape(rests, (-1, signals.shape[0]))])
    noise, step = estimate_noise(loop.output), clock[-1] / (loop.n - 1)
    resolution = float(np.min(np.diff(np.unique(loop.output))))
    # Without noise, the converter rounds a constant voltage always to the same side.
    rounding = resolution / 12.0**0.5 if noise < 0.5 * resolution else 0.0
    rest_times = equations[len(differences) :, -1]
    rest_errors = _rest_error(loop.input, rest_times / step)
    period = clock[-1] / (1 + count / 2)
    values, information = np.zeros(len(record.basis)), np.eye(len(record.basis))
    for _ in range(_PASSES):
        priors = np.diag(1.0 / record.prior_sigmas(values[0]))
        largest = _largest_flux(loop.input, record.volts - values @ record.basis)
        closing_sigma = float(np.hypot(_CLOSING_ERROR * largest, noise * (period * step) ** 0.5))
        rest_sigmas = np.sqrt(
            noise**2 * step * rest_times + (rounding * rest_times) ** 2 + (rest_errors * largest) ** 2
        )
        weights = 1.0 / np.concatenate([np.full(len(differences), closing_sigma), rest_sigmas])
        weighted = equations * weights[:, None]
        rows = np.concatenate([weighted[:, 1:], priors])
        target = np.concatenate([weighted[:, 0], np.zeros(len(priors))])
        values = _invert(rows.T @ rows) @ (rows.T @ target)
        residual_ratio = np.sum((rows @ values - target) ** 2) / max(1, count + len(rests) - values.size + 1)
        information = rows.T @ rows / max(1.0, residual_ratio)
    half_rate_error = _integrate(clock[::2], loop.output[::2]) - record.volts[::2]
    return _Fit(record, values, information, float(np.std(half_rate_error)) / _HALF_RATE_RATIO)


def _refuse_inaccurate(fit: _Fit) -> None:
    """Raise an error if the flux linkage is not accurate, with the change that would help."""
    uncertainty = fit.flux_uncertainty()
    if fit.record.has_resistance and fit.values[0] + 4.0 * fit.sigmas[0] < 0.0:
        raise InputError(
            f"the resistance of the coil would be {fit.values[0]:.4g} Ohm; current and "
            "voltage have opposite signs: --flip u_V",
            code="voltage-sign",
            key="u_V",
        )
    largest_u, largest_i = (float(np.max(np.abs(v))) for v in (fit.record.loop.output, fit.record.loop.input))
    resistance_limit = min(4.0 * fit.sigmas[0], _MIN_RESISTANCE_SHARE * largest_u / largest_i)
    is_accurate = uncertainty <= _MAX_UNCERTAINTY
    if is_accurate and fit.record.has_resistance and fit.values[0] < resistance_limit:
        raise InputError(
            f"the resistance of the coil would be 0 ± {fit.sigmas[0]:.2g} Ohm, as if the voltage were that of a "
            'sense coil; map it, and state the turns: --columns "u_V=u_sense_V"',
            code="voltage-of-sense-coil",
            key="u_V",
        )
    if is_accurate:
        return
    all_values = tuple(range(fit.values.size))
    sampling = fit.flux_uncertainty(known=all_values)
    if sampling > 0.5 * _MAX_UNCERTAINTY:
        cause = "the samples are too far apart or too noisy; sample faster, and filter the voltage"
    elif fit.flux_uncertainty(known=all_values[-1:]) <= _MAX_UNCERTAINTY:
        cause = (
            "the offset of the voltage is not separable; record a rest at zero current, as long as a "
            "cycle, before and after the cycles"
        )
    elif fit.record.has_resistance and fit.flux_uncertainty(known=all_values[:-1]) <= _MAX_UNCERTAINTY:
        cause = (
            "the resistance is not separable; hold the largest current for half a cycle, or add cycles "
            "of another mean current, such as from zero to the largest current"
        )
    else:
        cause = (
            "the cycles are too slow or do not repeat; run at least three faster cycles of each size, "
            "with a rest at zero current before and after the cycles"
        )
    raise InputError(
        f"the flux linkage from this voltage is uncertain by {100.0 * min(uncertainty, 1.0):.2g} % of its "
        f"largest value ({_MAX_UNCERTAINTY:.2%} is required): {cause}",
        code="voltage-inaccurate",
    )


def _describe_fit(fit: _Fit) -> str:
    """Return the estimates of a record as a note."""
    values, sigmas = fit.values, fit.sigmas
    texts = [f"offset {1e3 * values[-1]:.3g} mV"]
    if fit.record.has_resistance:
        texts = [
            f"resistance {values[0]:.5g} ± {sigmas[0]:.2g} Ohm at the start",
            f"warming {100.0 * (values[1] + values[2]) / (values[0] or 1.0):.2g} %",
            *texts,
        ]
    drift = 100.0 * abs(values[-1]) * fit.record.clock[-1] / _largest_flux(fit.record.loop.input, fit.flux)
    return (
        f"flux linkage integrated from the voltage: {', '.join(texts)} (a drift of {drift:.2g} % of "
        f"the largest flux linkage), uncertainty {fit.flux_uncertainty():.2%}"
    )


def _set_zero(loop: Loop) -> Loop:
    """Return a loop whose flux linkage is zero where the iron is demagnetised, if that is known.

    A demagnetising sine at the beginning is removed. Cycles that are symmetric about zero are
    centred. Otherwise, the flux linkage begins at zero.
    """
    row = _find_demagnetised_row(loop.input)
    if row is not None and loop.history == SETTLED:
        rows = slice(row, None)
        output = loop.output[rows] - loop.output[row]
        return replace_columns(loop, itemgetter(rows), output=output, history=DEMAGNETISED)
    if loop.history == DEMAGNETISED or not is_bipolar(loop.input):
        return loop
    offsets = estimate_offsets(loop)
    return loop if offsets is None else replace(loop, output=loop.output - offsets[1])


def _find_demagnetised_row(drive: FloatArray) -> int | None:
    """Return the last row of a decaying alternating drive at the beginning; ``None`` without one."""
    rows = find_turning_points(drive)
    tips = drive[rows[1:-1]]
    products = -tips[1:] * tips[:-1]
    is_decaying = (products > _DECAYS[0] * tips[:-1] ** 2) & (products < _DECAYS[1] * tips[:-1] ** 2)
    count = is_decaying.size if is_decaying.all() else int(np.argmin(is_decaying))
    if count + 1 < _MIN_DECAYING_REVERSALS or abs(tips[count]) > _MAX_DECAYED_SHARE * abs(tips[0]):
        return None
    last_tip, next_tip = rows[count + 1], rows[count + 2]
    row = int(last_tip + np.flatnonzero(drive[last_tip:next_tip] * drive[last_tip] > 0.0)[-1])
    return row if np.ptp(drive[row:]) > 0.5 * abs(tips[0]) else None


def _find_rests(drive: FloatArray) -> list[slice]:
    """Return the rows where the input is constant, without the time in which it settles."""
    size = max(4, drive.size // _REST_BLOCKS)
    means = drive[: drive.size // size * size].reshape(-1, size).mean(axis=1)
    max_step = _MAX_REST_STEP * float(np.ptp(drive)) + 4.0 * estimate_noise(drive) / size**0.5
    rests = []
    for run in find_runs(np.abs(np.diff(means)) <= max_step):
        start = run.start + 1 + int(_SETTLING_SHARE * (run.stop - run.start))
        rows = slice(start * size, run.stop * size)
        if run.stop - run.start < _MIN_REST_BLOCKS:
            continue
        change = float(np.ptp([part.mean() for part in np.array_split(drive[rows], 3)]))
        if change <= _rest_error(drive, rows.stop - rows.start) * float(np.ptp(drive)):
            rests.append(rows)
    return rests


def _rest_error(drive: FloatArray, count: float | FloatArray) -> float | FloatArray:
    """Return the change of the input during a rest that noise can hide, relative to its range.

    In noise, the tip of a sine looks like a rest. The relative change of the flux linkage is similar.
    """
    return _REST_ERROR + 5.0 * estimate_noise(drive) / (float(np.ptp(drive)) * np.sqrt(count))


def _largest_flux(drive: FloatArray, flux: FloatArray) -> float:
    """Return the range of a flux linkage, or half the range if the drive has both signs."""
    return max(float(np.ptp(flux)), _SMALLEST_FLUX) * (0.5 if is_bipolar(drive) else 1.0)


def _even_clock(time: FloatArray) -> FloatArray:
    """Return the time since the first sample; a clock coarser than the sampling becomes even."""
    clock = time - time[0]
    steps = np.diff(clock)
    even_clock: FloatArray = np.linspace(0.0, clock[-1], clock.size)
    is_coarse = steps.min() == 0.0 and np.max(np.abs(clock - even_clock)) <= 2.0 * steps.max()
    return even_clock if is_coarse else clock


def _invert(information: FloatArray) -> FloatArray:
    """Return the covariance of parameters of very different sizes."""
    scale = np.sqrt(np.diag(information))
    return np.asarray(np.linalg.inv(information / np.outer(scale, scale)) / np.outer(scale, scale))


def _integrate(clock: FloatArray, values: FloatArray) -> FloatArray:
    """Return the integral from the first sample to each sample."""
    integral = np.zeros_like(values)
    np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(clock), out=integral[1:])
    return integral
