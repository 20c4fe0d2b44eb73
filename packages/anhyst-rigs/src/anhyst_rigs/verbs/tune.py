"""The command ``tune``: find the gains of a rig for stated requirements."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from anhyst.cli.shared import OutputPart
    from anhyst.support.atomic import PathLike
    from anhyst.support.jobs import Progress
    from anhyst_rigs.study.tuning.result import Tuning

PLACE = 33, "Rigs, simulated and real"
PROGRESS = "tuning"


def tune(
    rig: PathLike,
    out: PathLike,
    controller: PathLike | None = None,
    *,
    all_variants: bool = False,
    overshoot: float | None = None,
    peak: float = 3.0,
    settling: float | None = None,
    average: float | None = None,
    error: float | None = None,
    standstill: float | None = None,
    effort: float | None = None,
    crossover: float | None = None,
    budget: int = 240,
    seed: int = 0,
    scheduler: str | None = None,
    jobs: int | None = None,
    progress: Progress | None = None,
) -> Tuning:
    """Find the gains of a rig for stated requirements, and what limits them.

    For a bearing, the settling time is minimised. Each set of gains must suit all gaps and steps of
    the rig file, with the full load and with two thirds of it. Gains are tested first in linear
    loops, then in the nonlinear loop with hysteresis, noise, delay and limits. The best set is
    tested with every noise seed and with a stepped sine. The command writes the new controller
    file, tuning.json, tuning.md and pareto.png.

    For a stage, the command finds the corner frequencies of its PID that minimise the moving
    average on the training set-point. It evaluates them on the test set-point and on random plants,
    as defined in [spread]. It writes a new rig file instead of a controller file.

    For a piezo stage, the command finds the integrator and the notch filter that minimise the rms
    error on the triangle, also for random plants as defined in [spread].

    The exit code is 1 if no gains fulfil the requirements. Ctrl-C writes the best gains so far.

    Parameters
    ----------
    rig : path-like
        Rig file of a bearing, a stage or a piezo stage.
    out : path-like, ``DIR``
        Output folder.
    controller : path-like, ``FILE``, optional
        Initial controller file of a bearing. [default: 'controller.toml' next to the rig file]
    all_variants : bool
        Tune every kind of compensation separately, and compare them.
    overshoot : float, ``PERCENT``, optional
        Largest overshoot of any step of a bearing, % of the step height. [default: 2]
    peak : float, ``RATIO``
        Largest peak of the sensitivity.
    settling : float, ``SECONDS``, optional
        Longest settling time (for a stage, to 50 nm). For a bearing, it is always minimised.
    average : float, ``METRES``, optional
        Largest moving average of the error of a stage, which is always minimised.
    error : float, ``METRES``, optional
        Largest error of a stage or a piezo stage.
    standstill : float, ``METRES``, optional
        Largest rms value at standstill: of the gap for a bearing, or of the error for a stage.
    effort : float, ``A/S``, optional
        Largest rms rate of change of the current.
    crossover : float, ``HERTZ``, optional
        Highest crossover frequency of a stage, which must be below its resonances. Simulated stages
        have no resonances. [default: a twentieth of the control rate]
    budget : int, ``N``
        Number of gain sets to try in the nonlinear loop.
    seed : int, at least 0, ``N``
        Seed of all random numbers.
    scheduler : str, ``ADDRESS``, optional
        Use the workers of a dask scheduler, such as tcp://host:8786 (extra 'cluster'). They must
        have access to the same files. [default: processes of this machine]
    jobs : int, optional, only in Python
        Number of processes on this machine. By default, the number of cores.
    progress : callable, optional
        Called with the work done and the total work.

    Returns
    -------
    Tuning
        The gains, which are written even if they miss a requirement.

    Raises
    ------
    InputError
        A file cannot be read or written or contradicts another file, or an option is not for this
        kind of rig.
    NegativeResult
        No gains stabilise the rig.
    Interrupted
        Ctrl-C before any gains were found.

    Examples
    --------
    anhyst tune examples/bearing/rig.toml --out tuned

    anhyst tune examples/stage/rig.toml --out tuned --peak 2
    """
    from pathlib import Path

    from anhyst.support.atomic import check_path
    from anhyst.support.jobs import use_scheduler
    from anhyst_rigs.reports.tuning import write_pareto
    from anhyst_rigs.study.tuning.aims import Aims
    from anhyst_rigs.study.tuning.tuning import tune as work

    check_path(rig, "tune: rig", "the path of a rig file")
    folder = Path(check_path(out, "tune: out"))
    aims = Aims(overshoot, peak, settling, standstill, effort, error, average)
    with use_scheduler(scheduler):
        result = work(
            rig, folder, controller, aims, all_variants=all_variants, crossover=crossover,
            budget=budget, seed=seed, jobs=jobs, progress=progress,
        )  # fmt: skip
    write_pareto(result, folder)
    return result


def warnings(result: Tuning) -> tuple[str, ...]:
    """Return the warnings about the simulated plant, which follow from the loops."""
    return tuple(result.plant.warnings) if result.plant else ()


def as_json(result: Tuning, _: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the result for ``--json``."""
    from anhyst_rigs.study.tuning.result import result_dict

    return result_dict(result)


def show(result: Tuning, arguments: Mapping[str, Any]) -> Iterator[OutputPart]:
    """Return the terminal output: the figures reached, their limits, and the files written."""
    from anhyst.cli.printing import TerminalTable
    from anhyst_rigs.study.tuning.result import column_heads, format_aims, table_rows, verdict_text

    headings, out = column_heads(result)[:-1], arguments["out"]
    table = TerminalTable(f"tuned for {format_aims(result)}", headings)
    for row in table_rows(result):
        table.add_row(*row[: len(headings)])
    yield table
    yield (
        f"worst of all conditions; mean of {result.rig.settings.noise_seeds} noise seeds with its "
        "95 % interval"
    )
    for name, tuned_variant in result.tuned.items():
        yield from (f"what limits '{name}': {limit.text}" for limit in tuned_variant.limits)
    for name, tuned_variant in result.tuned.items():
        if tuned_variant.search_result.check:
            yield from (f"'{name}': {text}" for text in tuned_variant.search_result.check.notes)
    yield f"verdict: {verdict_text(result)}"
    yield from result.plant.report_lines if result.plant else ()
    yield f"{result.seconds:.0f} s, {result.cpu_seconds:.0f} s of processor time"
    yield from (f"written: {path}" for path in result.written.values())
    yield f"written: {out / 'tuning.json'}, {out / 'tuning.md'}, {out / 'pareto.png'}"


def refuse(result: Tuning, _: Mapping[str, Any]) -> None:
    """Raise an error if the search was interrupted or if a requirement is not fulfilled."""
    from anhyst.support.errors import Interrupted, NegativeResult
    from anhyst_rigs.study.tuning.result import describe_shortfall

    if result.interrupted:
        written_paths = ", ".join(str(path) for path in result.written.values())
        raise Interrupted(f"the best gains until then, not checked, are in {written_paths}")
    if (shortfall := describe_shortfall(result)) is not None:
        raise NegativeResult(shortfall, code="aims-missed")
