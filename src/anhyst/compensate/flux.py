"""The method that measures: current corrected until a Hall probe shows the wanted flux density."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anhyst.compensate.surface import Surface
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray, passed


@dataclass(frozen=True)
class FluxCalibration:
    """A static series with the probe in place, and how fast the current follows."""

    gap: FloatArray  # m, N, and T as the probe reads it; shape (n,)
    force: FloatArray
    flux_density: FloatArray
    delay: float  # from a sample to the output of the current found from it, s
    # of the flux density that is read behind the current's reference, s: amplifier, eddy currents
    # and probe together
    lag: float

    def __post_init__(self) -> None:
        for name in ("gap", "force", "flux_density"):
            values = np.asarray(getattr(self, name), dtype=np.float64)
            if values.ndim != 1 or values.size != np.size(self.force) or values.size == 0:
                raise InputError(
                    f"flux calibration: {name} must have one value a point",
                    code="length-differs",
                    key=name,
                )
            if not np.isfinite(values).all():
                raise InputError(
                    f"flux calibration: {name} holds what is no number", code="not-finite", key=name
                )
            object.__setattr__(self, name, values)
        if not (self.delay > 0.0 and self.lag >= 0.0):
            raise InputError(
                "flux calibration: the delay must be above zero, the lag not below",
                code="delay-not-above-zero",
            )

    def density_over(self, force: FloatArray, gap: FloatArray) -> FloatArray:
        """Return the flux density that belongs to a force, T.

        At each measured gap it is the root of the force times the best constant, least squares, or
        of what goes both ways the best straight line over it; straight lines between the gaps.
        """
        nodes = np.unique(self.gap)
        if force[0] < 0.0:
            fits = [np.polyfit(*self._at(node), 1) for node in nodes.tolist()]
            slope, rest = (np.interp(gap, nodes, column)[:, None] for column in np.transpose(fits))
            return np.asarray(rest + slope * force)
        constants = []
        for node in nodes.tolist():
            here = (self.gap == node) & (self.force > 0.0)
            root = np.sqrt(self.force[here])
            constant = float(root @ self.flux_density[here] / (root @ root)) if here.any() else 0.0
            if not constant > 0.0:
                raise InputError(
                    f"flux calibration: at gap {node:g} m no flux density grows with the force",
                    code="not-monotone",
                )
            constants.append(constant)
        return np.asarray(np.interp(gap, nodes, constants)[:, None] * np.sqrt(force)[None, :])

    def _at(self, gap: float) -> tuple[FloatArray, FloatArray]:
        here = self.gap == gap
        return self.force[here], self.flux_density[here]


@dataclass(frozen=True)
class FluxGains:
    """How the measured flux density corrects the current."""

    proportional: float  # A/T
    integral: float  # in a tick, A/T
    back: float  # share of a current beyond the limits which the integral takes back in a tick
    # share of a step of the wanted flux density that is expected to show a tick later
    smoothing: float
    crossover: float  # of the flux loop, rad/s

    @property
    def row(self) -> FloatArray:
        """As ``anhyst_flux_loop`` has them."""
        return np.array([self.proportional, self.integral, self.back, self.smoothing])


def design_flux_loop(
    calibration: FluxCalibration, surface: Surface, density: FloatArray, force: float, rate: float
) -> FluxGains:
    """Design the flux loop.

    The flux follows the current at once but for delay and lag, so an integral alone would close the
    loop. The proportional part takes the lag away, once; what is left is an integral behind the
    delay and half a tick, the integral's own. The crossover is half the inverse of these two. That
    leaves a phase margin of 61 degrees without lag. The proportional part takes the lag of several
    low-passes for that of one, which costs some: 52 degrees are left behind amplifier and probe of
    the bundled bearing, 34 where eddy currents of 100 us come on top. The gain is that of the gap
    where the flux answers most, so that no gap is faster than designed.
    """
    tick = 1.0 / rate
    column = int(np.clip(np.searchsorted(surface.force, force), 1, surface.force.size - 2))
    around = slice(column - 1, column + 2)
    answer = np.ptp(density[:, around], axis=1) / np.ptp(surface.current[:, around], axis=1)
    crossover = 0.5 / (calibration.delay + 0.5 * tick)
    integral = crossover / float(answer.max())
    return FluxGains(
        proportional=integral * calibration.lag,
        integral=integral * tick,
        back=min(1.0, crossover * tick),
        smoothing=passed(tick / (calibration.delay + calibration.lag)),
        crossover=crossover,
    )
