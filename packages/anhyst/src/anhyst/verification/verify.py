"""Runs the C of a bundle on all targets and holds it against the host."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from itertools import count
from pathlib import Path

from anhyst.compilation.toolchain import Missing
from anhyst.support.atomic import PathLike, check_path
from anhyst.support.errors import InputError, NegativeResult, wrong_key
from anhyst.support.jobs import Progress, cores
from anhyst.verification import elf, targets
from anhyst.verification.bundle import (
    LEVITATION,
    PLAY,
    VECTORS,
    GoldenVectors,
    read_bundle,
    read_flight,
    read_levitation,
    read_vectors,
)
from anhyst.verification.compare import (
    CONTROL_SOURCES,
    Answers,
    Subject,
    Variant,
    Workshop,
    compare,
    run,
)
from anhyst.verification.emulators import CortexProgram
from anhyst.verification.protocol import RecordForm, Reply
from anhyst.verification.result import Cost, TargetResult, Verification

DEFAULT = "host,cortex-m4"
HOST_STEPS = 1_000_000
TARGET_STEPS = 10_000
ESTIMATE_STEPS = 2_000
SEED = 1


def verify(
    folder: PathLike,
    on: str | None = None,
    host_steps: int = HOST_STEPS,
    target_steps: int = TARGET_STEPS,
    seed: int = SEED,
    progress: Progress | None = None,
) -> Verification:
    """Compare compiled C bit for bit on several targets, and measure it there: `anhyst.verify`.

    Left out, the targets are :data:`DEFAULT`, as far as there are tools.
    """
    check_path(folder, "verify: folder", "the path of a compiled folder")
    for name, number in (("host steps", host_steps), ("steps", target_steps), ("seed", seed)):
        if not 1 <= number < 1 << 32:
            raise wrong_key(name, f"{number} is not within 1 .. 2^32 - 1", code="out-of-range")
    folder = Path(folder)
    bundle = read_bundle(folder)
    names = targets.parse_targets(DEFAULT if on is None else on, bundle)
    with tempfile.TemporaryDirectory(prefix="anhyst-verify-") as scratch:
        numbers = (host_steps, target_steps, seed)
        subject: Subject = "stage" if bundle.stage else "compensator"
        workshop = Workshop.set_up(bundle, Path(scratch), subject)
        if workshop.form is None:
            vectors = read_vectors(folder / VECTORS, bundle.io == "f32")
        else:
            vectors = read_flight(folder / VECTORS, workshop.form, bundle.io == "f32")
        offers, missing = _offers(workshop, names)
        works = {name for name, offer in offers.items() if offer.orders}
        whole = [name for name in names if name in targets.WHOLE_TARGETS and not _lacks(name)]
        works.update(whole)
        if not works:
            texts = "; ".join(lack.text() for lack in missing)
            raise InputError(f"no target can run; missing is {texts}", code="no-target")
        jobs = [(_Job(workshop, vectors, *numbers), offers)]
        if bundle.manifest.get("controller") is not None:
            around = Workshop.set_up(bundle, Path(scratch) / "controller", "controller")
            levitation = _Job(around, read_levitation(folder / LEVITATION), *numbers)
            jobs.append((levitation, _offers(around, names)[0]))
        builds = sum(len(offer.orders) for _, some in jobs for offer in some.values())
        done = count(1)

        def one_more() -> None:
            if progress is not None:
                progress(next(done), builds + len(whole))

        results: list[TargetResult] = []
        for job, some in jobs:
            results += job.run_all(some, one_more)
        for name in whole:
            target = targets.WHOLE_TARGETS[name]
            results.append(target.verify(bundle, Path(scratch), target_steps, seed))
            one_more()
        priced = jobs if elf.SOURCE in works else []
        estimates = tuple(estimate for job, _ in priced for estimate in _estimates(job))
    what = (str(folder), bundle.kind, bundle.io, bundle.rate, seed)
    not_run = tuple(name for name in names if name not in works)
    return Verification(*what, tuple(results), estimates, not_run, missing)


def _offers(
    workshop: Workshop, names: Sequence[str]
) -> tuple[dict[str, targets.Offer], tuple[Missing, ...]]:
    """Return what can be built for each target, and all tools that are missing."""
    offers = {name: targets.TARGETS[name](workshop) for name in names if name in targets.TARGETS}
    missing = [lack for offer in offers.values() for lack in offer.missing]
    return offers, (*missing, *(lack for name in names for lack in _lacks(name)))


def _lacks(name: str) -> tuple[Missing, ...]:
    """Return what a target of another package would need and is not there."""
    return targets.WHOLE_TARGETS[name].missing_tools() if name in targets.WHOLE_TARGETS else ()


@dataclass
class _Job:
    """What all builds have in common: the inputs, and the host's answers to them."""

    workshop: Workshop
    vectors: GoldenVectors
    host_steps: int
    target_steps: int
    seed: int

    def __post_init__(self) -> None:
        self._reference = targets.reference(self.workshop)
        self._answers: dict[int, Answers] = {}

    def steps(self, target: str) -> int:
        """Return how many random steps there are; a tick of a stage is one of every magnet."""
        steps = self.host_steps if target == "host" else self.target_steps
        stage = self.workshop.bundle.stage
        return max(1, steps // stage["magnets"]) if stage else steps

    def run_all(
        self, offers: Mapping[str, targets.Offer], one_more: Callable[[], None]
    ) -> list[TargetResult]:
        """Build and run everything, as many at a time as there are processors."""
        orders = [(name, order) for name, offer in offers.items() for order in offer.orders]
        for steps in {self.steps(name) for name, _ in orders}:
            self._answers[steps] = run(self._reference.program, self.vectors, steps, self.seed)
        results: list[TargetResult] = []
        with ThreadPoolExecutor(cores()) as pool:
            for future in [pool.submit(partial(self._one, *order)) for order in orders]:
                results.append(future.result())
                one_more()
        return results

    def _one(self, target: str, order: targets.Order) -> TargetResult:
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
            programs = (self._reference.program, variant.program)
            answers = (self._answers[steps], outcome)
            difference = compare(programs, answers, self.vectors, steps, self.seed)
        except NegativeResult as error:
            return TargetResult(*head, 0, 0, failure=str(error))
        counted, sizes, bundle = bool(variant.unit), None, self.workshop.bundle
        if variant.image is not None:
            sources = {Path(path).name for path in (*bundle.c_files, *CONTROL_SOURCES)}
            sizes = elf.measure_sizes(variant.image, bundle.name, sources, target == "avr")
        return TargetResult(
            *head,
            steps,
            len(self.vectors.inputs),
            warnings=variant.warnings,
            unit=variant.unit,
            costs=self._costs(outcome) if counted else (),
            sizes=sizes,
            state_bytes=outcome.random.state_bytes,
            control_bytes=outcome.random.control_bytes,
            stack_measured=outcome.stack if counted else None,
            stack_static=_static_stack(variant, self.workshop),
            difference=difference,
            seconds=time.monotonic() - began,
        )

    def _costs(self, outcome: Answers) -> tuple[Cost, ...]:
        """Return what the random steps took; of a stage also what its flight did."""
        counted = costs(outcome.random, self.vectors.form)
        if self.workshop.form is not None:
            flown = costs(outcome.played, self.vectors.form)[-1]
            counted = (*counted, replace(flown, part="tick, in flight"))
        return counted


def _static_stack(variant: Variant, workshop: Workshop) -> int | None:
    if variant.image is None or variant.target not in targets.CORTEX:
        return None
    if workshop.subject != "compensator":
        return elf.stack_below(variant.image, [f"{workshop.bundle.name}_controller_tick"])
    io = workshop.bundle.io
    object_of = "play_map" if workshop.bundle.kind == PLAY else "compensator"
    roots = [f"anhyst_{object_of}_{part}_{io}" for part in ("solve", "commit")]
    return elf.stack_below(variant.image, roots)


def costs(reply: Reply, form: RecordForm) -> tuple[Cost, ...]:
    """Take the clock's own share off what was counted."""
    found = []
    for name, section in zip(form.sections[1:], reply.sections[1:], strict=True):
        if section.count:
            own = form.calls.get(name, 1) * reply.sections[0].least
            mean = section.total / section.count - own
            found.append(Cost(name, section.least - own, mean, section.most - own, section.most_at))
    return tuple(found)


def _estimates(job: _Job) -> tuple[elf.Estimate, ...]:
    """Run the Cortex-M0+ once more for each list of prices."""
    try:
        program = targets.cortex_m(elf.SOURCE, job.workshop).orders[0]().program
        assert isinstance(program, CortexProgram)
        priced = [
            (name, replace(program, costs=partial(elf.costs_of, elf.PRICES[name])))
            for name in elf.PRICES
        ]
        replies = [
            (name, run(each, job.vectors, ESTIMATE_STEPS, job.seed).random) for name, each in priced
        ]
    except NegativeResult:
        return ()  # reported as a failure of the target where it was asked for
    whose = "controller: " if job.workshop.subject == "controller" else ""
    return tuple(
        elf.Estimate(f"{whose}{cost.part}", name, cost.most, elf.CLOCK_HZ / cost.most)
        for name, reply in replies
        for cost in costs(reply, job.vectors.form)
    )
