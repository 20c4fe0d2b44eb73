"""Runs the C of a bundle on all targets and holds it against the host."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

from anhyst.errors import InputError, NegativeResult
from anhyst.verify.bundle import FLIGHT, VECTORS, read_bundle
from anhyst.verify.compare import Outcome, compare, run
from anhyst.verify.cortexm import CortexProgram
from anhyst.verify.elf import measure_sizes
from anhyst.verify.estimate import CLOCK_HZ, PRICES, SOURCE, Estimate, costs_of
from anhyst.verify.firmware import TARGET as FIRMWARE
from anhyst.verify.firmware import check_tools, verify_firmware
from anhyst.verify.protocol import Form, Reply
from anhyst.verify.result import Cost, TargetResult, Verification
from anhyst.verify.stackdepth import stack_below
from anhyst.verify.targets import CORTEX, TARGETS, cortex_m, parse_targets, reference
from anhyst.verify.vectors import GoldenVectors, read_flight, read_vectors
from anhyst.verify.workshop import Variant, Workshop

HOST_STEPS = 1_000_000
TARGET_STEPS = 10_000
ESTIMATE_STEPS = 2_000
SEED = 1

Progress = Callable[[float, float], None]


def verify(
    folder: Path,
    on: str = "host,cortex-m4",
    host_steps: int = HOST_STEPS,
    target_steps: int = TARGET_STEPS,
    seed: int = SEED,
    progress: Progress | None = None,
) -> Verification:
    """Compare compiled C bit for bit on several targets, and measure it there.

    The compensator, and the position controller where the folder holds one.

    Parameters
    ----------
    folder : Path
        What ``anhyst compile --out`` wrote.
    on : str
        Targets, separated by commas.
    host_steps, target_steps : int
        Random steps on the host and on each other target, at least 1.
    seed : int
        Of the random steps, 1 to 2^32 - 1.
    progress : callable or None
        Called with builds done and their number.

    Returns
    -------
    Verification
        Differences included: look at ``passed``.

    Raises
    ------
    InputError
        The folder is not what compile wrote, a target is unknown, its tools are not installed, or
        a number is out of range.
    """
    for name, number in (("host steps", host_steps), ("steps", target_steps), ("seed", seed)):
        if not 1 <= number < 1 << 32:
            raise InputError(f"{name}: {number} is not within 1 .. 2^32 - 1")
    bundle = read_bundle(folder)
    names = parse_targets(on, bundle)
    vectors = read_vectors(folder / VECTORS, bundle.io == "f32")
    with tempfile.TemporaryDirectory(prefix="anhyst-verify-") as scratch:
        numbers = (host_steps, target_steps, seed)
        workshop = Workshop.set_up(bundle, Path(scratch))
        job = _Job(workshop, vectors, *numbers)
        jobs = [job]
        if bundle.has_controller:
            place = Path(scratch) / "controller"
            around = Workshop.set_up(bundle, place, "controller")
            jobs.append(_Job(around, read_flight(folder / FLIGHT), *numbers))
        alone = [name for name in names if name in TARGETS]
        orders = [each.orders(alone) for each in jobs]
        if FIRMWARE in names:
            check_tools()
        results: list[TargetResult] = []
        for each, own in zip(jobs, orders, strict=True):
            results += each.run_all(alone, own, progress)
        if FIRMWARE in names:
            results.append(verify_firmware(bundle, Path(scratch), target_steps, seed))
        estimates = tuple(e for each in jobs for e in _estimates(each)) if SOURCE in names else ()
    return Verification(
        str(folder), bundle.kind, bundle.io, bundle.rate, seed, tuple(results), estimates
    )


class _Job:
    """What all builds have in common: the inputs, and the host's answers to them."""

    def __init__(
        self,
        workshop: Workshop,
        vectors: GoldenVectors,
        host_steps: int,
        target_steps: int,
        seed: int,
    ) -> None:
        self.workshop = workshop
        self.vectors = vectors
        self.seed = seed
        self.host_steps, self.target_steps = host_steps, target_steps
        self._reference = reference(workshop)
        self._answers: dict[int, Outcome] = {}

    def steps(self, target: str) -> int:
        return self.host_steps if target == "host" else self.target_steps

    def orders(self, names: Sequence[str]) -> list[tuple[str, Callable[[], Variant]]]:
        """Return the builds for these targets; tools that are missing are told now."""
        return [(name, order) for name in names for order in TARGETS[name](self.workshop)]

    def run_all(
        self,
        names: Sequence[str],
        orders: Sequence[tuple[str, Callable[[], Variant]]],
        progress: Progress | None,
    ) -> list[TargetResult]:
        """Build and run everything, as many at a time as there are processors."""
        for steps in {self.steps(name) for name in names}:
            self._answers[steps] = run(self._reference.program, self.vectors, steps, self.seed)
        results: list[TargetResult] = []
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            waiting = [pool.submit(partial(self._one, *order)) for order in orders]
            for done, future in enumerate(waiting):
                if progress:
                    progress(done, len(waiting))
                results.append(future.result())
        return results

    def _one(self, target: str, order: Callable[[], Variant]) -> TargetResult:
        began = time.monotonic()
        steps = self.steps(target)
        try:
            variant = order()
        except NegativeResult as error:
            return TargetResult(target, "build", "", "", 0, 0, failure=str(error))
        name = variant.name
        if self.workshop.subject == "controller":
            name = f"{name}, controller"
        head = (target, name, variant.processor, variant.compiler)
        try:
            outcome = run(variant.program, self.vectors, steps, self.seed)
            difference = compare(
                (self._reference.program, variant.program),
                (self._answers[steps], outcome),
                self.vectors,
                steps,
                self.seed,
            )
        except NegativeResult as error:
            return TargetResult(*head, 0, 0, failure=str(error))
        counted = bool(variant.unit)
        image = variant.image
        return TargetResult(
            *head,
            steps,
            len(self.vectors.inputs),
            warnings=variant.warnings,
            unit=variant.unit,
            costs=costs(outcome.random, self.vectors.form) if counted else (),
            sizes=measure_sizes(image, constants_in_data=target == "avr") if image else None,
            state_bytes=outcome.random.state_bytes,
            control_bytes=outcome.random.control_bytes,
            stack_measured=outcome.stack if counted else None,
            stack_static=_static_stack(variant, self.workshop),
            difference=difference,
            seconds=time.monotonic() - began,
        )


def _static_stack(variant: Variant, workshop: Workshop) -> int | None:
    if variant.image is None or variant.target not in CORTEX:
        return None
    if workshop.subject == "controller":
        return stack_below(variant.image, ["anhyst_controller_tick"])
    io = workshop.bundle.io
    roots = [f"anhyst_compensator_{part}_{io}" for part in ("solve", "commit")]
    return stack_below(variant.image, roots)


def costs(reply: Reply, form: Form) -> tuple[Cost, ...]:
    """Take the clock's own share off what was counted."""
    clock = reply.sections[0].least
    found = []
    for name, section in zip(form.sections[1:], reply.sections[1:], strict=True):
        if section.count:
            own = form.calls.get(name, 1) * clock
            mean = section.total / section.count - own
            found.append(Cost(name, section.least - own, mean, section.most - own, section.most_at))
    return tuple(found)


def _estimates(job: _Job) -> tuple[Estimate, ...]:
    """Run the Cortex-M0+ once more for each list of prices."""
    try:
        program = cortex_m(SOURCE, job.workshop)[0]().program
        assert isinstance(program, CortexProgram)
        replies = {
            name: run(
                replace(program, costs=partial(costs_of, prices)),
                job.vectors,
                ESTIMATE_STEPS,
                job.seed,
            ).random
            for name, prices in PRICES.items()
        }
    except NegativeResult:
        return ()  # told as a failure of the target where it was asked for
    found: list[Estimate] = []
    whose = "controller: " if job.workshop.subject == "controller" else ""
    for name, reply in replies.items():
        found += [
            Estimate(f"{whose}{cost.part}", name, cost.most, CLOCK_HZ / cost.most)
            for cost in costs(reply, job.vectors.form)
        ]
    return tuple(found)
