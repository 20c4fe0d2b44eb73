"""Models of simulated tables, alone and with one measured loop."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from anhyst import InputError, Loop, Loops, Model, identify
from anhyst.data.path import ANHYSTERETIC, SETTLED
from anhyst.support.numeric import FloatArray
from anhyst.support.units import QUANTITIES
from tests.data.simulated_tables import DrawnMagnet

UNSEEN_SEEDS = range(7000, 7015)


class HystereticMagnet:
    """A drawn magnet whose iron also has eight stop operators of the flux: no law of anhyst."""

    def __init__(self, magnet: DrawnMagnet, rng: np.random.Generator) -> None:
        self.magnet, coercivity = magnet, 10.0 ** rng.uniform(1.3, 2.3)
        self.limits = np.geomspace(0.005, 0.8, 8) * 0.6 * magnet.area * magnet.saturation
        shares = rng.dirichlet(np.ones(8))
        self.slopes = shares * coercivity * magnet.length / magnet.turns / self.limits

    def loop(self, largest: float, gap: float, samples: int = 50) -> tuple[FloatArray, FloatArray]:
        """Return current and force of the closed cycle between 0 and a current."""
        rise = np.linspace(0.0, largest, samples)
        cycle = np.concatenate([rise, rise[-2::-1]])
        stops, flux, fluxes = np.zeros(8), 0.0, np.empty(cycle.size)
        for current in (cycle[::3], cycle[::3], cycle):
            for n, value in enumerate(current):
                fluxes[n] = self._solve(value, gap, stops, flux)
                stops = np.clip(stops + fluxes[n] - flux, -self.limits, self.limits)
                flux = float(fluxes[n])
        return cycle, self.magnet.force_of_flux(fluxes, gap)

    def _solve(self, current: float, gap: float, stops: FloatArray, flux: float) -> float:
        unit = self.magnet.area * self.magnet.saturation
        low, high = -1.5 * unit, 4.0 * unit
        for _ in range(45):
            middle = 0.5 * (low + high)
            turned = np.clip(stops + middle - flux, -self.limits, self.limits)
            needed = float(self.magnet.current(np.array([middle]), gap)[0]) + float(self.slopes @ turned)
            low, high = (middle, high) if needed < current else (low, middle)
        return float(0.5 * (low + high))


@dataclass
class Case:
    """A table of a drawn magnet, simulated with small errors, and one measured loop."""

    magnet: HystereticMagnet
    table: tuple[Loop, ...]
    measured: Loop

    def errors(self, model: Model) -> FloatArray:
        """Return the errors of the force on large and small loops at all gaps, relative to the largest."""
        assert model.valid is not None
        assert model.valid.schedule is not None
        currents, errors, largest = self.table[0].input, [], 0.0
        for loop in self.table:
            gap = float(np.clip(loop.schedule_value or 0.0, *model.valid.schedule))
            for share in (1.0, 0.5):
                current, force = self.magnet.loop(share * currents[-1], gap, 25)
                predicted = model.predict(current, np.full(current.size, gap), history="settled").output
                errors.append(predicted - force)
                largest = max(largest, float(force.max()))
        return np.concatenate(errors) / largest


def draw_case(seed: int) -> Case:
    """Return a case: 1 % error of the gap's zero, 3 % of the force, 0.1 % noise of the loop."""
    rng, magnet = np.random.default_rng(seed + 7_000_000), DrawnMagnet(seed)
    truth, count = HystereticMagnet(magnet, rng), magnet.gaps.size
    factor, shift = 1.0 + 0.03 * rng.normal(), 0.01 * rng.normal() * magnet.gaps[count // 2]
    gap = float(magnet.gaps[rng.integers(1, max(2, count - 2))])
    table = tuple(
        Loop(
            "1", magnet.currents, factor * magnet.force(magnet.currents, node + shift),
            np.full(magnet.currents.size, node), history=ANHYSTERETIC, source="table.csv",
        )
        for node in magnet.gaps.tolist()
    )  # fmt: skip
    current, force = truth.loop(magnet.currents[-1], gap)
    force = force + 1e-3 * force.max() * rng.normal(size=force.size)
    measured = Loop("loop", current, force, np.full(current.size, gap), history=SETTLED, source="loop.csv")
    return Case(truth, table, measured)


def loops_of(*loops: Loop) -> Loops:
    """Return loops of a magnet."""
    return Loops(loops, QUANTITIES["current"], QUANTITIES["force"], QUANTITIES["gap"])


def test_table_gives_a_model_without_hysteresis() -> None:
    """The model follows the table, its branches coincide, and its file states the missing hysteresis."""
    case = draw_case(3)
    result = identify(loops_of(*case.table))
    model, fit = result.model, result.model.fit
    assert fit is not None
    assert fit.mean_abs < 0.005 * fit.largest_output
    assert str(model.provenance.settings["hysteresis"]).startswith("none: ")
    assert model.history == ANHYSTERETIC
    assert not result.rejection
    rise = np.linspace(0.0, case.table[0].input[-1], 50)
    cycle = np.concatenate([rise, rise[::-1]])
    force = model.predict(cycle, np.full(100, case.table[1].schedule_value)).output
    assert np.abs(force[:50] - force[:49:-1]).max() < 2e-3 * fit.largest_output


def test_measured_loop_adds_width_and_scale() -> None:
    """With a loop, the mean error at all gaps is less than a third of the error of the table alone."""
    case = draw_case(3)
    with_loop = identify(loops_of(*case.table, case.measured))
    alone = identify(loops_of(*case.table)).model
    assert np.abs(case.errors(with_loop.model)).mean() < np.abs(case.errors(alone)).mean() / 3.0
    assert str(with_loop.model.provenance.settings["hysteresis"]).startswith("from measured loops")
    assert [loop.label for loop in with_loop.loops.loops] == ["loop"]
    uncertainty = with_loop.model.uncertainty
    assert uncertainty is not None
    assert uncertainty.names == ("zero of the gap, m", "factor of the table")


def test_loop_outside_the_table_is_refused() -> None:
    """A loop at a gap that the table does not contain cannot get its shape from the table."""
    case = draw_case(3)
    outside = Loop("loop", case.measured.input, case.measured.output, np.full(case.measured.n, 5e-3))
    with pytest.raises(InputError, match="loops within its gaps, not at 5 mm"):
        identify(loops_of(*case.table, outside))


@pytest.mark.slow
@pytest.mark.parametrize("seed", UNSEEN_SEEDS)
def test_drawn_magnets_follow_their_tables(seed: int) -> None:
    """On magnets that were not used for the design, the mean error to the table is below 0.5 %."""
    case = draw_case(seed)
    fit = identify(loops_of(*case.table)).model.fit
    assert fit is not None
    assert fit.mean_abs < 0.005 * fit.largest_output
    errors = case.errors(identify(loops_of(*case.table, case.measured)).model)
    assert np.abs(errors).mean() < 0.006
