"""Measure the time of one step of each law, and of its elementary functions alone.

Each time is the shortest processor time of several repetitions, because other work on the machine
can only add time. It is compared with the time of the same number of exponentials and Langevin
functions, evaluated over an array without the other operations of the law.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from anhyst._core import AnyIron, Iron, Operator, batch, batch_functions, batch_levels, demagnetised, langevin
from anhyst.laws.cells import Population, discretise_populations
from anhyst.laws.play_cells import make_iron
from anhyst.support.numeric import FloatArray
from rows import Row

Array = FloatArray

REPETITIONS = 15
KAPPA, REVERSIBILITY, OMEGA = 0.8, 0.2, -0.8
SAMPLES_A_LOOP = 200


def best_ns(function: Callable[[], object], items: int) -> float:
    """Return the processor time of one item, ns, as the shortest of several repetitions."""
    times = []
    for _ in range(REPETITIONS):
        start_time = time.process_time_ns()
        function()
        times.append((time.process_time_ns() - start_time) / items)
    return min(times)


def _drive_samples(samples: int) -> Array:
    return np.asarray(4.0 * np.sin(2.0 * np.pi * np.arange(samples) / SAMPLES_A_LOOP))


def measure_scalar_step() -> Row:
    """Measure one forward step of the implicit law, solved to rounding error."""
    n = 200_000
    r, omega = _drive_samples(n), np.full(n, OMEGA)
    law = Operator(KAPPA, REVERSIBILITY)
    state = demagnetised()
    step_time = best_ns(lambda: law.run(omega, r, state), n)
    arguments = np.linspace(-4.0, 4.0, n)
    langevin_time = best_ns(lambda: langevin(arguments), n)
    # A step has an initial guess and 3 to 4 iterates: 4 Langevin functions, 3 exponentials.
    exponential = best_ns(lambda: np.exp(-np.abs(arguments)), n)
    functions_time = 4.0 * langevin_time + 3.0 * exponential
    return Row(
        "forward step, implicit, scalar f64",
        "<= 150 ns",
        f"{step_time:.0f} ns; its 4 Langevin functions and 3 exponentials alone {functions_time:.0f} ns",
        step_time <= 150.0,
        1e-9 * step_time,
    )


def measure_cell_steps() -> list[Row]:
    """Measure one forward and one inverse step of play cells, and of Jiles-Atherton."""
    n = 200_000
    pinned = [Population(3e5, 40.0, 20.0, 1.5), Population(1e5, 120.0, 80.0, 2.0)]
    iron = make_iron(discretise_populations((3e4, 50.0), pinned), 0.0)
    jiles_atherton = Iron(4.3e5, 30.0, 25.0, 0.1, 0.0)
    drive, zero = 1500.0 * _drive_samples(n), np.zeros(n)
    rho = np.full(n, 0.01)

    def both(law: AnyIron, states: int) -> tuple[float, float]:
        start = np.zeros(states)
        flux = law.forward(drive, rho, zero, start)[0]
        return (
            best_ns(lambda: law.forward(drive, rho, zero, start), n),
            best_ns(lambda: law.inverse(flux, rho, zero, start), n),
        )

    play_cell_times, jiles_atherton_times = both(iron, 13), both(jiles_atherton, 3)
    return [
        Row(
            f"{direction} step of play cells, scalar f64",
            "<= 45 ns",
            f"{play_cell_ns:.0f} ns; Jiles-Atherton on the same drive {jiles_atherton_ns:.0f} ns",
            play_cell_ns <= 45.0,
            1e-9 * play_cell_ns,
        )
        for direction, play_cell_ns, jiles_atherton_ns in zip(
            ("forward", "inverse"), play_cell_times, jiles_atherton_times, strict=True
        )
    ]


def measure_batch_step(instruction_set: str) -> list[Row]:
    """Measure a batch step for each set and sample; only the best instruction set has a target."""
    has_target = instruction_set == batch_levels()[-1]
    sets, n = 256, SAMPLES_A_LOOP
    rng = np.random.default_rng(0)
    kappa, c = rng.uniform(0.3, 3.0, sets), rng.uniform(0.05, 0.6, sets)
    omega, scale = rng.uniform(-1.5, 5.0, sets), np.ones(sets)
    offset, drive = np.zeros(sets), _drive_samples(n)
    x, y = np.zeros(sets), np.zeros(sets)

    columns = (kappa, c, omega, scale, offset, drive, x, y)

    def follow(implicit: bool) -> None:
        for _ in range(10):
            batch(*columns, implicit=implicit, keep=False, level=instruction_set)

    arguments = np.linspace(0.0, 4.0, 2048)
    function_time = best_ns(
        lambda: [batch_functions(arguments, instruction_set) for _ in range(100)], 100 * arguments.size
    )
    rows = []
    for name, is_implicit, field_range, call_count in (
        ("implicit", True, 10.0, 3.0),
        ("explicit", False, 2.0, 1.0),
    ):
        step_time = best_ns(lambda: follow(is_implicit), 10 * sets * n)  # noqa: B023
        rows.append(
            Row(
                f"forward step, {name}, batched, {instruction_set}",
                f"<= {field_range:g} ns" if has_target else "reported",
                f"{step_time:.2f} ns per set; "
                f"{call_count:.0f} Langevin and exp alone {call_count * function_time:.2f} ns",
                step_time <= field_range if has_target else None,
                1e-9 * step_time,
            )
        )
    return rows


def rows() -> list[Row]:
    """Return all rows about speed."""
    return [
        measure_scalar_step(),
        *measure_cell_steps(),
        *(row for instruction_set in batch_levels() for row in measure_batch_step(instruction_set)),
    ]
