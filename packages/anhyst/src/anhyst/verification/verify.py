"""Run the C code of a compiled folder on all targets, and compare every bit with the host.

For each target, the C code is built together with a test harness. The harness runs the golden
vectors and random steps, and returns hashes, costs and stack use. The build for the host is the
reference.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from itertools import count
from pathlib import Path

from anhyst.compilation.toolchain import MissingTool
from anhyst.support.atomic import PathLike, check_path
from anhyst.support.errors import InputError, NegativeResult, wrong_key
from anhyst.support.jobs import Progress, core_count
from anhyst.verification import elf, targets
from anhyst.verification.bundle import (
    LEVITATION_FILE,
    PLAY_KIND,
    VECTORS_FILE,
    GoldenVectors,
    read_bundle,
    read_levitation,
    read_stage_vectors,
    read_vectors,
)
from anhyst.verification.compare import (
    PIDD2_SOURCE_PATHS,
    Answers,
    BuildFolder,
    Subject,
    Variant,
    compare_answers,
    run_program,
)
from anhyst.verification.emulators import CortexProgram
from anhyst.verification.protocol import RecordLayout, Reply
from anhyst.verification.result import Cost, TargetResult, Verification

DEFAULT_TARGETS = "host,cortex-m4"
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
    """Compare compiled C bit for bit on several targets, and measure its cost: `anhyst.verify`.

    Without `on`, the targets are :data:`DEFAULT_TARGETS` for which tools are installed.
    """
    check_path(folder, "verify: folder", "the path of a compiled folder")
    for name, number in (("host steps", host_steps), ("steps", target_steps), ("seed", seed)):
        if not 1 <= number < 1 << 32:
            raise wrong_key(name, f"{number} is not within 1 .. 2^32 - 1", code="out-of-range")
    folder = Path(folder)
    bundle = read_bundle(folder)
    names = targets.parse_targets(DEFAULT_TARGETS if on is None else on, bundle)
    with tempfile.TemporaryDirectory(prefix="anhyst-verify-") as scratch_folder:
        numbers = (host_steps, target_steps, seed)
        subject: Subject = "stage" if bundle.stage else "compensator"
        build_folder = BuildFolder.create(bundle, Path(scratch_folder), subject)
        if build_folder.stage_record is None:
            vectors = read_vectors(folder / VECTORS_FILE, bundle.io == "f32")
        else:
            vectors = read_stage_vectors(folder / VECTORS_FILE, build_folder.stage_record, bundle.io == "f32")
        builds_by_target, missing_tools = _collect_target_builds(build_folder, names)
        runnable_targets = {name for name, target_builds in builds_by_target.items() if target_builds.builds}
        whole_targets = [
            name for name in names if name in targets.WHOLE_TARGETS and not _missing_for_whole_target(name)
        ]
        runnable_targets.update(whole_targets)
        if not runnable_targets:
            texts = "; ".join(tool.text() for tool in missing_tools)
            raise InputError(f"no target can run; missing is {texts}", code="no-target")
        jobs = [(_VerificationJob(build_folder, vectors, *numbers), builds_by_target)]
        if bundle.manifest.get("controller") is not None:
            controller_folder = BuildFolder.create(bundle, Path(scratch_folder) / "controller", "controller")
            levitation = _VerificationJob(
                controller_folder, read_levitation(folder / LEVITATION_FILE), *numbers
            )
            jobs.append((levitation, _collect_target_builds(controller_folder, names)[0]))
        builds = sum(
            len(target_builds.builds) for _, job_builds in jobs for target_builds in job_builds.values()
        )
        counter = count(1)

        def report_build() -> None:
            if progress is not None:
                progress(next(counter), builds + len(whole_targets))

        results: list[TargetResult] = []
        for job, job_builds in jobs:
            results += job.run_all(job_builds, report_build)
        for name in whole_targets:
            target = targets.WHOLE_TARGETS[name]
            results.append(target.verify(bundle, Path(scratch_folder), target_steps, seed))
            report_build()
        estimated_jobs = jobs if elf.ESTIMATE_TARGET in runnable_targets else []
        estimates = tuple(estimate for job, _ in estimated_jobs for estimate in _estimate_dsc(job))
    header = (str(folder), bundle.kind, bundle.io, bundle.rate, seed)
    not_run = tuple(name for name in names if name not in runnable_targets)
    return Verification(*header, tuple(results), estimates, not_run, missing_tools)


def _collect_target_builds(
    build_folder: BuildFolder, names: Sequence[str]
) -> tuple[dict[str, targets.TargetBuilds], tuple[MissingTool, ...]]:
    """Return the possible builds of each target, and all missing tools."""
    builds_by_target = {
        name: targets.TARGETS[name](build_folder) for name in names if name in targets.TARGETS
    }
    missing_tools = [tool for target_builds in builds_by_target.values() for tool in target_builds.missing]
    return builds_by_target, (
        *missing_tools,
        *(tool for name in names for tool in _missing_for_whole_target(name)),
    )


def _missing_for_whole_target(name: str) -> tuple[MissingTool, ...]:
    """Return the missing tools of a target of another package."""
    return targets.WHOLE_TARGETS[name].missing_tools() if name in targets.WHOLE_TARGETS else ()


@dataclass
class _VerificationJob:
    """Data for all builds: the inputs, and the outputs of the host for them."""

    build_folder: BuildFolder
    vectors: GoldenVectors
    host_steps: int
    target_steps: int
    seed: int

    def __post_init__(self) -> None:
        self._reference = targets.build_reference(self.build_folder)
        self._answers: dict[int, Answers] = {}

    def step_count(self, target: str) -> int:
        """Return the number of random steps; one tick of a stage counts as one step per magnet."""
        steps = self.host_steps if target == "host" else self.target_steps
        stage = self.build_folder.bundle.stage
        return max(1, steps // stage["magnets"]) if stage else steps

    def run_all(
        self, builds_by_target: Mapping[str, targets.TargetBuilds], report_build: Callable[[], None]
    ) -> list[TargetResult]:
        """Build and run all targets, with as many threads as processors."""
        builds = [
            (name, pending_build)
            for name, target_builds in builds_by_target.items()
            for pending_build in target_builds.builds
        ]
        for steps in {self.step_count(name) for name, _ in builds}:
            self._answers[steps] = run_program(self._reference.program, self.vectors, steps, self.seed)
        results: list[TargetResult] = []
        with ThreadPoolExecutor(core_count()) as pool:
            for future in [pool.submit(partial(self._run_build, *pending_build)) for pending_build in builds]:
                results.append(future.result())
                report_build()
        return results

    def _run_build(self, target: str, pending_build: targets.PendingBuild) -> TargetResult:
        start_time = time.monotonic()
        steps = self.step_count(target)
        try:
            variant = pending_build()
        except NegativeResult as error:
            return TargetResult(target, "build", "", "", 0, 0, failure=str(error))
        name = variant.name
        if self.build_folder.subject == "controller":
            name = f"{name}, controller"
        identity = (target, name, variant.processor, variant.compiler)
        try:
            outcome = run_program(variant.program, self.vectors, steps, self.seed)
            programs = (self._reference.program, variant.program)
            answers = (self._answers[steps], outcome)
            difference = compare_answers(programs, answers, self.vectors, steps, self.seed)
        except NegativeResult as error:
            return TargetResult(*identity, 0, 0, failure=str(error))
        is_counted, sizes, bundle = bool(variant.unit), None, self.build_folder.bundle
        if variant.image is not None:
            sources = {Path(path).name for path in (*bundle.c_files, *PIDD2_SOURCE_PATHS)}
            sizes = elf.measure_sizes(variant.image, bundle.name, sources, target == "avr")
        return TargetResult(
            *identity,
            steps,
            len(self.vectors.inputs),
            warnings=variant.warnings,
            unit=variant.unit,
            costs=self._list_costs(outcome) if is_counted else (),
            sizes=sizes,
            state_bytes=outcome.random.state_bytes,
            control_bytes=outcome.random.control_bytes,
            stack_measured=outcome.stack if is_counted else None,
            stack_static=_static_stack(variant, self.build_folder),
            difference=difference,
            seconds=time.monotonic() - start_time,
        )

    def _list_costs(self, outcome: Answers) -> tuple[Cost, ...]:
        """Return the costs of the random steps; for a stage also those of its golden vectors."""
        net_sections = net_costs(outcome.random, self.vectors.layout)
        if self.build_folder.stage_record is not None:
            flight_costs = net_costs(outcome.golden, self.vectors.layout)[-1]
            net_sections = (*net_sections, replace(flight_costs, part="tick, in flight"))
        return net_sections


def _static_stack(variant: Variant, build_folder: BuildFolder) -> int | None:
    if variant.image is None or variant.target not in targets.CORTEX_PROCESSORS:
        return None
    if build_folder.subject != "compensator":
        return elf.worst_case_stack(variant.image, [f"{build_folder.bundle.name}_controller_tick"])
    io = build_folder.bundle.io
    object_of = "play_map" if build_folder.bundle.kind == PLAY_KIND else "compensator"
    roots = [f"anhyst_{object_of}_{part}_{io}" for part in ("solve", "commit")]
    return elf.worst_case_stack(variant.image, roots)


def net_costs(reply: Reply, layout: RecordLayout) -> tuple[Cost, ...]:
    """Subtract the cost of the clock itself from the counted costs."""
    net_sections = []
    for name, section in zip(layout.sections[1:], reply.sections[1:], strict=True):
        if section.count:
            clock_cost = layout.clock_calls.get(name, 1) * reply.sections[0].minimum
            mean = section.total / section.count - clock_cost
            net_sections.append(
                Cost(
                    name,
                    section.minimum - clock_cost,
                    mean,
                    section.maximum - clock_cost,
                    section.maximum_step,
                )
            )
    return tuple(net_sections)


def _estimate_dsc(job: _VerificationJob) -> tuple[elf.Estimate, ...]:
    """Run the Cortex-M0+ again for each list of prices."""
    try:
        program = targets.find_cortex_m_builds(elf.ESTIMATE_TARGET, job.build_folder).builds[0]().program
        assert isinstance(program, CortexProgram)
        priced_sections = [
            (name, replace(program, costs=partial(elf.instruction_prices, elf.PRICES[name])))
            for name in elf.PRICES
        ]
        replies = [
            (name, run_program(each, job.vectors, ESTIMATE_STEPS, job.seed).random)
            for name, each in priced_sections
        ]
    except NegativeResult:
        return ()  # the failure is reported with the target, if it was requested
    prefix = "controller: " if job.build_folder.subject == "controller" else ""
    return tuple(
        elf.Estimate(f"{prefix}{cost.part}", name, cost.most, elf.CLOCK_HZ / cost.most)
        for name, reply in replies
        for cost in net_costs(reply, job.vectors.layout)
    )
