"""What a verification found."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from anhyst.compilation.toolchain import Missing
from anhyst.support.result import Result, columns_of
from anhyst.verification.compare import Difference
from anhyst.verification.elf import ProgramSizes
from anhyst.verification.estimate import Estimate

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, slots=True)
class Cost:
    """What one part of a step takes on a target, in the target's unit."""

    # ``solve``; ``commit, solved`` with the solved current, ``commit, rounded`` with that on a
    # converter's grid, ``commit, limited`` with a limit instead of it, ``commit, other`` with
    # another current; ``pidd2``; ``tick, rounded`` and ``tick``, all of a step
    part: str
    least: int  # over all steps
    mean: float  # over all steps
    most: int
    most_at: int  # step with the most, from 0


@dataclass(frozen=True, slots=True)
class TargetResult:
    """One build on one target."""

    target: str  # where, and what sets this build apart
    build: str
    processor: str  # what it ran on and what made it
    compiler: str
    steps: int  # random steps and golden vectors compared
    vectors: int
    warnings: int = 0  # the compiler's
    # of the costs: ``instructions``, ``cycles``, or nothing where they are not counted
    unit: str = ""
    costs: tuple[Cost, ...] = ()  # by part of a step
    sizes: ProgramSizes | None = None  # of code and constants; None on the host
    state_bytes: int = 0  # mutable state of one compensator and of one PIDD2
    control_bytes: int = 0
    # deepest painted stack below a call of solve or commit, bytes
    stack_measured: int | None = None
    stack_static: int | None = None  # deepest path through the machine code from there, bytes
    difference: Difference | None = None  # the first one
    failure: str = ""  # why there is no comparison: it does not compile, a sanitizer stopped it
    seconds: float = 0.0  # build and run

    @property
    def passed(self) -> bool:
        """Whether every bit was the same."""
        return self.difference is None and not self.failure

    @property
    def label(self) -> str:
        """Target and build in one."""
        return f"{self.target} ({self.build})"

    def verdict(self) -> str:
        """Report in one line what came out."""
        if self.failure:
            return self.failure
        if self.difference is not None:
            return f"target {self.label}: {self.difference.text()}"
        return "identical"

    def cost(self, part: str) -> Cost | None:
        """Return the costs of one part, if it was counted."""
        return next((cost for cost in self.costs if cost.part == part), None)


@dataclass(frozen=True, slots=True, repr=False)
class Verification(Result):
    """A bundle on all targets that were asked for.

    Parameters
    ----------
    folder : str
        The bundle.
    kind, io : str
        Of the compensator and its signals.
    rate : float or None
        Ticks a second it was made for, Hz.
    seed : int
        Of the random steps.
    results : tuple of TargetResult
        One for each build.
    estimates : tuple of Estimate
        For a 16-bit digital signal controller, by part of the step.
    not_run : tuple of str
        Targets that were asked for and could not run: their tools are missing.
    missing : tuple of Missing
        Tools that are missing, those without which a target ran with fewer builds included.
    """

    folder: str
    kind: str
    io: str
    rate: float | None
    seed: int
    results: tuple[TargetResult, ...]
    estimates: tuple[Estimate, ...]
    not_run: tuple[str, ...] = ()
    missing: tuple[Missing, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether every bit was the same wherever it ran."""
        return all(result.passed for result in self.results)

    def first_failure(self) -> str:
        """Return the verdict of the first build that differs, or nothing."""
        return next((result.verdict() for result in self.results if not result.passed), "")

    def as_dict(self) -> dict[str, Any]:
        """Return everything as plain data, for JSON."""
        return {"format": 1, "passed": self.passed, **asdict(self)}

    def facts(self) -> dict[str, str]:
        """Return where every bit was the same, and what a tick costs there."""
        facts = {"passed": "yes" if self.passed else "no"}
        for result in self.results:
            cost = result.cost("tick")
            price = f", a tick takes {cost.mean:.0f} to {cost.most} {result.unit}" if cost else ""
            facts[result.label] = result.verdict() + price
        return facts | ({"not run": ", ".join(self.not_run)} if self.not_run else {})

    def to_columns(self) -> dict[str, Any]:
        """Return the cost of each part of a step on each target, in the target's unit."""
        return columns_of(
            [
                {
                    "target": result.target,
                    "build": result.build,
                    "passed": result.passed,
                    "unit": result.unit,
                    **asdict(cost),
                }
                for result in self.results
                for cost in result.costs
            ]
        )

    def draw(self, ax: Axes) -> None:
        """Draw mean and largest cost of a tick on each target that counts it."""
        costs = [(run, cost) for run in self.results if (cost := run.cost("tick")) is not None]
        places = range(len(costs))
        ax.barh(places, [cost.most for _, cost in costs], color="0.85", label="largest")
        ax.barh(places, [cost.mean for _, cost in costs], height=0.5, label="mean")
        ax.set_yticks(places, [f"{run.label}, {run.unit}" for run, _ in costs])
        ax.set_xlabel("cost of a tick")
