"""Measure the cost of a wrong initial hysteresis state, to test a claim of the paper.

The claim is: "The simplified model is more stable and has no initial-value problem." A compensator
starts with the state after one history, and the iron with the state after another. Both then follow
the same demand. The metric is the number of samples until the force stays within 1 % of the largest
force, compared with the same compensator and the correct initial state. ``python
benchmarks/initial_state.py`` prints the table.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise, permutations, product

import numpy as np
from numpy.typing import NDArray

from anhyst.compensate.block import Block, Conditioning, DemandLimits, Kind, TableSizes
from anhyst.compensate.builder import build_block
from anhyst.compensate.force_controller import FixedTwin
from anhyst.compensate.simplified import fit_closed_form
from anhyst.data import read_loops
from anhyst.identification import identify
from anhyst.model.actuator import Model
from anhyst.support.block_words import Scales
from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0
from rows import ROOT, Row

sys.path.extend(map(str, (ROOT, *(ROOT / "packages").iterdir())))
from tests.oracles.explicit import ExplicitForm

Array = FloatArray

KINDS: tuple[Kind, ...] = ("full", "simplified", "euler")
SAMPLES_PER_CYCLE = 200
"""Samples per cycle of the demand."""

CYCLE_COUNT = 12

TOLERANCES = (0.01, 0.002)
"""Tolerances relative to the largest force: a small error, and an error of the size of rounding."""

HISTORIES: tuple[tuple[float, ...], ...] = (
    (0.0,),
    (1.0, 0.0),
    (-1.0, 0.0),
    (0.5, 0.0),
    (-0.5, 0.0),
    (1.0, -0.3, 0.0),
    (2.0, 0.0),
    (-2.0, 0.0),
    (1.0, 0.5),
    (0.5,),
    (1.0, 0.2, 0.5),
)
"""Reversal points of the current in each history, relative to the largest current. The last three
end at a nonzero current, as after a reset of the controller during operation."""

DEMAND_LIMITS = {"5-95 %": (0.05, 0.95), "30-70 %": (0.30, 0.70), "45-55 %": (0.45, 0.55)}
"""Reversal points of the triangles, relative to the largest force."""


@dataclass(frozen=True)
class Actuator:
    """A model at one gap, with its compensators.

    Parameters
    ----------
    model : Model
        The iron, in double precision.
    gap : float
        Gap of the whole study, m.
    current, force : float
        Largest current, A, and largest force, N.
    blocks : dict
        A parameter block for each kind.
    """

    model: Model
    gap: float
    current: float
    force: float
    blocks: dict[Kind, Block]

    def history_currents(self, turning_points: Sequence[float]) -> Array:
        """Return the currents of a history, A."""
        turning_currents = [0.0, *(turning_point * self.current for turning_point in turning_points)]
        ramps = [np.linspace(a, b, 101)[1:] for a, b in pairwise(turning_currents)]
        return np.concatenate([[0.0], *ramps])

    def state_after(self, kind: Kind, currents: Array) -> NDArray[np.int32]:
        """Return the state of a compensator after these currents."""
        compensator = FixedTwin(self.blocks[kind])
        for current in currents.tolist():
            compensator.commit(current, self.gap)
        return compensator.memory

    def force_after(self, history_currents: Array, currents: Array) -> Array:
        """Return the force of the iron under these currents after a history, N."""
        all_currents = np.concatenate([history_currents, currents])
        prediction = self.model.predict(
            all_currents, np.full(all_currents.size, self.gap), history="demagnetised"
        )
        return prediction.output[history_currents.size :]


def make_actuator(model: Model, gaps: tuple[float, float], gap: float, current: float) -> Actuator:
    """Compile a model to every kind, for triangles of a force that can be reached at every gap."""
    end_currents = np.array([0.0, current])
    largest_force, force = (
        float(model.predict(end_currents, np.full(2, evaluated_gap), history="demagnetised").output[-1])
        for evaluated_gap in (gaps[0], gap)
    )
    force *= 0.98  # keeps the demand within the range of every compensator
    # Twice the current, so that histories beyond the working range are within the number range.
    scales = Scales(1.2 * largest_force, 2.1 * current, *gaps)
    limits = DemandLimits((0.0, largest_force), (-0.2 * current, current))
    conditioning_plan = Conditioning(cycles=2, ramp_ticks=SAMPLES_PER_CYCLE)
    wide_limits = DemandLimits(limits.demand, (-2.0 * current, 2.0 * current))
    law = fit_closed_form(model, limits, np.linspace(*gaps, 5))
    table_sizes = TableSizes(iterations=8, octave_segments=4, curve_segments=8)
    blocks: dict[Kind, Block] = {
        "full": build_block(model, "full", scales, wide_limits, table_sizes, conditioning_plan),
        "simplified": build_block(
            model, "simplified", scales, wide_limits, table_sizes, conditioning_plan, closed_form=law
        ),
        "euler": build_block(
            model, "euler", scales, wide_limits, table_sizes, conditioning_plan, closed_form=law
        ),
    }
    return Actuator(model, gap, current, force, blocks)


def triangle_demand(low: float, high: float) -> Array:
    """Return the demand relative to the largest force."""
    phase = np.arange(SAMPLES_PER_CYCLE * CYCLE_COUNT) % SAMPLES_PER_CYCLE / SAMPLES_PER_CYCLE
    return np.asarray(low + (high - low) * (1.0 - np.abs(2.0 * phase - 1.0)))


def conditioning_currents(actuator: Actuator, cycles: int) -> Array:
    """Return triangles over the whole current range, as a controller runs them at start-up."""
    turning_currents = [-0.2 * actuator.current, actuator.current] * cycles + [0.0]
    ramps = [np.linspace(a, b, SAMPLES_PER_CYCLE + 1)[1:] for a, b in pairwise(turning_currents)]
    return np.concatenate(ramps)


def samples_until_near(deviation: Array, tolerance: float) -> int:
    """Return the number of samples after which the deviation stays within the tolerance permanently."""
    outside_indices = np.flatnonzero(np.abs(deviation) > tolerance)
    return int(outside_indices[-1]) + 1 if outside_indices.size else 0


@dataclass(frozen=True)
class Outcome:
    """Errors of one compensator with one demand after wrong initial states.

    Parameters
    ----------
    samples : ndarray of int, shape (p, 2)
        For every pair of histories and each of the tolerances `TOLERANCES`: number of samples until the
        difference from the force after a correct start stays within the tolerance.
    largest_error : float
        Largest difference from the force after a correct start, relative to the largest force.
    settled_error : float
        Largest error of the force relative to the demand in the last cycle after a correct start,
        as a fraction of the largest force.
    """

    samples: NDArray[np.int64]
    largest_error: float
    settled_error: float


def sample_random_states(kind: Kind) -> list[NDArray[np.int32]]:
    """Return random states, as a controller may find them in uninitialised memory."""
    bound = int(0.9 * 2**30)
    states = np.random.default_rng(1).integers(-bound, bound, (len(HISTORIES), 3))
    states[:, 2] = states[:, 0] if kind == "full" else 0
    return list(states.astype(np.int32))


def study(
    actuator: Actuator,
    kind: Kind,
    demand: Array,
    prelude: Array | None = None,
    from_random_states: bool = False,
) -> Outcome:
    """Start a compensator with the state of every history, on an iron with every other history.

    Parameters
    ----------
    actuator : Actuator
        The actuator that is driven.
    kind : str
        Kind of the compensator.
    demand : ndarray, shape (n,)
        Demand relative to the largest force.
    prelude : ndarray, optional
        Currents that are applied and committed first, for any initial state: the conditioning.
    from_random_states : bool, optional
        Whether to start with the states of `sample_random_states` instead of those of other histories.

    Returns
    -------
    Outcome
        Errors over all pairs of histories.
    """
    demanded_force = demand * actuator.force
    prelude_currents = np.empty(0) if prelude is None else prelude

    def run(memory: NDArray[np.int32]) -> Array:
        compensator = FixedTwin(actuator.blocks[kind])
        compensator.set_memory(memory)
        for current in prelude_currents.tolist():
            compensator.commit(current, actuator.gap)
        return compensator.run(demanded_force, actuator.gap)

    right_currents = [
        run(actuator.state_after(kind, actuator.history_currents(history))) for history in HISTORIES
    ]
    wrong_currents = (
        [run(memory) for memory in sample_random_states(kind)] if from_random_states else right_currents
    )
    records = [
        np.concatenate([actuator.history_currents(history), prelude_currents]) for history in HISTORIES
    ]
    right_forces = [actuator.force_after(*pair) for pair in zip(records, right_currents, strict=True)]
    samples, largest = [], 0.0
    for assumed_history, true_history in permutations(range(len(HISTORIES)), 2):
        force = actuator.force_after(records[true_history], wrong_currents[assumed_history])
        force_errors = (force - right_forces[true_history]) / actuator.force
        samples.append([samples_until_near(force_errors, tolerance) for tolerance in TOLERANCES])
        largest = max(largest, float(np.abs(force_errors).max()))
    settled_errors = [
        np.abs(force - demanded_force)[-SAMPLES_PER_CYCLE:].max() / actuator.force for force in right_forces
    ]
    return Outcome(np.array(samples), largest, float(max(settled_errors)))


def euler_error(actuator: Actuator, samples: int) -> float:
    """Return the largest force error in the fourth cycle of the full law with explicit Euler steps.

    Each sample takes one step of eqs. 13 to 15 of the paper, in double precision, from the correct
    initial state. The demand is a triangle of 5 to 95 % with `samples` per cycle; the error is
    relative to the largest force.
    """
    circuit = actuator.model.circuit(np.array([actuator.gap]), np.zeros(1))
    iron = actuator.model.parameters_at(actuator.gap)
    law = ExplicitForm(iron["M_s"], iron["a"], iron["k"], iron["c"], iron["alpha"])
    phase = np.arange(4 * samples) / samples
    demanded_force = (0.05 + 0.9 * (1.0 - np.abs(2.0 * (phase % 1.0) - 1.0))) * actuator.force
    flux_density = circuit.flux_density(demanded_force)[0]
    with np.errstate(all="ignore"):
        field = law.inverse(np.concatenate([[0.0], flux_density]), "euler")[1:]
        drive = circuit.drive(field + circuit.rho[0] * flux_density / MU_0)
    drive = np.nan_to_num(np.clip(drive, -10.0 * actuator.current, 10.0 * actuator.current))
    force = actuator.force_after(np.zeros(1), drive)
    return float(np.abs(force - demanded_force)[-samples:].max() / actuator.force)


def identify_bundled() -> Actuator:
    """Identify the bundled electromagnet from its loops."""
    loops = read_loops(ROOT / "examples" / "electromagnet" / "loops.csv")
    model = identify(loops).model
    gaps = (float(model.nodes[0]), float(model.nodes[-1]))
    current = max(float(np.max(loop.input)) for loop in loops.loops)
    return make_actuator(model, gaps, 0.45e-3, current)


def outcome_text(outcome: Outcome) -> str:
    """Return the size and the duration of the force error as text."""
    first_samples, second_samples = outcome.samples.T
    return (
        f"up to {100 * outcome.largest_error:.2g} % of F_max error; within {100 * TOLERANCES[0]:g} % after "
        f"{np.median(first_samples):.0f} samples (median), {first_samples.max()} (largest, "
        f"{first_samples.max() / SAMPLES_PER_CYCLE:.2f} cycles); within {100 * TOLERANCES[1]:g} % after "
        f"{second_samples.max() / SAMPLES_PER_CYCLE:.2f} cycles"
    )


def rows(make: Callable[[], Actuator] = identify_bundled) -> list[Row]:
    """Return all rows about wrong initial states."""
    actuator = make()
    lines = []
    for (name, (low, high)), kind in product(DEMAND_LIMITS.items(), KINDS):
        demand = triangle_demand(low, high)
        wrong_history = study(actuator, kind, demand)
        random_start = study(actuator, kind, demand, from_random_states=True)
        conditioned = study(
            actuator, kind, demand, conditioning_currents(actuator, 1), from_random_states=True
        )
        text = (
            f"state of another history: {outcome_text(wrong_history)}. Random state: "
            f"{outcome_text(random_start)}. After one cycle of conditioning: up to "
            f"{100 * conditioned.largest_error:.2g} %. Right start, steady state: "
            f"{100 * wrong_history.settled_error:.2f} % error"
        )
        lines.append(Row(f"wrong start, {kind}, triangle {name}", "reported", text, None))
    errors = {samples: euler_error(actuator, samples) for samples in (2000, 200, 50, 20, 10)}
    text = ", ".join(f"{n} samples {100 * error:.2f} %" for n, error in errors.items())
    title = "full law with the paper's explicit Euler steps: steady-state force error by samples per cycle"
    lines.append(Row(title, "reported", text, None))
    return lines


if __name__ == "__main__":
    for row in rows():
        print(f"{row.what}\n    {row.measured}")
