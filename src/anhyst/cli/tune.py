"""The verbs ``tune`` and ``calibrate``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import anhyst
from anhyst.cli.shared import (
    AsJson,
    Scheduler,
    Verbose,
    of_its_kind,
    print_json,
    progress_bar,
    show,
    table,
    warn,
)
from anhyst.support.errors import Interrupted, NegativeResult

if TYPE_CHECKING:
    from anhyst import Tuning


def tune(
    rig: Annotated[
        Path,
        typer.Argument(
            metavar="RIG",
            help="Rig file of a bearing, a stage or a piezo stage.",
            callback=of_its_kind,
        ),
    ],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="Output folder.")],
    controller: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Initial controller file of a bearing. [default: 'controller.toml' next to the "
            "rig file]",
        ),
    ] = None,
    all_variants: Annotated[
        bool,
        typer.Option(
            "--all-variants", help="Tune every kind of compensation separately, and compare them."
        ),
    ] = False,
    overshoot: Annotated[
        float | None,
        typer.Option(
            metavar="PERCENT",
            help="Largest overshoot of any step of a bearing. [default: 2]",
        ),
    ] = None,
    peak: Annotated[
        float, typer.Option(metavar="RATIO", help="Largest peak of the sensitivity.")
    ] = 3.0,
    settling: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS",
            help="Longest settling time (for a stage, into 50 nm). For a bearing, it is "
            "minimised in any case.",
        ),
    ] = None,
    average: Annotated[
        float | None,
        typer.Option(
            metavar="METRES",
            help="Largest moving average of a stage. It is minimised in any case.",
        ),
    ] = None,
    error: Annotated[
        float | None,
        typer.Option(metavar="METRES", help="Largest error of a stage or a piezo stage."),
    ] = None,
    standstill: Annotated[
        float | None,
        typer.Option(
            metavar="METRES",
            help="Largest rms at standstill: of the gap for a bearing, of the error for a stage.",
        ),
    ] = None,
    effort: Annotated[
        float | None,
        typer.Option(metavar="A/S", help="Largest rms rate of change of the current."),
    ] = None,
    crossover: Annotated[
        float | None,
        typer.Option(
            metavar="HERTZ",
            help="Highest crossover frequency of a stage, below its resonances. Simulated stages "
            "have no resonances. [default: a twentieth of the control rate]",
        ),
    ] = None,
    budget: Annotated[
        int, typer.Option(metavar="N", help="Number of gain sets to try in the nonlinear loop.")
    ] = 240,
    seed: Annotated[int, typer.Option(metavar="N", min=0, help="Seed of all random numbers.")] = 0,
    scheduler: Scheduler = None,
    as_json: AsJson = False,
    _verbose: Verbose = False,
) -> None:
    """Find the gains of a rig for stated requirements, and what limits them.

    For a bearing, the settling time is minimised. Each set of gains must suit all gaps and steps of
    the rig file, with its load and with two thirds of it. It is tested first in linear loops, then
    in the nonlinear loop with hysteresis, noise, delay and limits. The best set is tested with
    every noise seed and with a swept sine. The command writes the new controller file, tuning.json,
    tuning.md and pareto.png.

    For a stage, the command finds the corner frequencies of its PID that minimise the moving
    average on the training set-point. It evaluates them on the test set-point and on random plants,
    as defined in [spread]. It writes a new rig file instead of a controller file.

    For a piezo stage, the command finds the integrator and the notch filter that minimise the rms
    error on its triangle, on random plants as defined in [spread].

    Exit code 1 if no gains fulfil the requirements. Ctrl-C keeps the best gains found until then.

    Example: anhyst tune examples/bearing/rig.toml --out tuned

    Example: anhyst tune examples/stage/rig.toml --out tuned --peak 2
    """
    from anhyst.reports.tuning import write_pareto
    from anhyst.study.tuning.result import figures_of, shortfall

    with progress_bar("tuning") as progress:
        tuning = anhyst.tune(
            rig,
            out,
            controller,
            all_variants=all_variants,
            overshoot=overshoot,
            peak=peak,
            settling=settling,
            average=average,
            error=error,
            standstill=standstill,
            effort=effort,
            crossover=crossover,
            budget=budget,
            seed=seed,
            scheduler=scheduler,
            progress=progress,
        )
        write_pareto(tuning, out)
    for text in tuning.plant.warnings if tuning.plant else ():
        warn(text)
    if as_json:
        print_json(figures_of(tuning))
    else:
        _show(tuning, out)
    if tuning.interrupted:
        kept = ", ".join(str(path) for path in tuning.written.values())
        raise Interrupted(f"the best so far, not checked, is in {kept}")
    missed = shortfall(tuning)
    if missed is not None:
        raise NegativeResult(missed, code="aims-missed")


def _show(tuning: Tuning, out: Path) -> None:
    from anhyst.study.tuning.result import aims_text, heads, rows, worth

    head = heads(tuning)[:-1]
    drawn = table(f"tuned for {aims_text(tuning)}", head)
    for row in rows(tuning):
        drawn.add_row(*row[: len(head)])
    limits = [
        f"what limits '{name}': {one.text}"
        for name, tuned in tuning.tuned.items()
        for one in tuned.limits
    ]
    checks = [(name, one.found.check) for name, one in tuning.tuned.items()]
    show(
        drawn,
        f"worst of all conditions, mean of {tuning.rig.settings.noise_seeds} noise seeds with its "
        "95 % interval",
        *limits,
        *(f"'{name}': {text}" for name, one in checks if one for text in one.notes),
        f"verdict: {worth(tuning)}",
        *(tuning.plant.lines if tuning.plant else ()),
        f"{tuning.seconds:.0f} s, {tuning.cpu_seconds:.0f} s of processor time",
        *(f"written: {path}" for path in tuning.written.values()),
        f"written: {out / 'tuning.json'}, {out / 'tuning.md'}, {out / 'pareto.png'}",
    )


def calibrate(
    rig: Annotated[
        Path,
        typer.Argument(
            metavar="RIG", help="Rig file of a bearing or a stage.", callback=of_its_kind
        ),
    ],
    recordings: Annotated[
        list[Path], typer.Argument(metavar="RUNS", help="Recordings of the motion.")
    ],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FILE", help="Calibration file (TOML) to write."),
    ] = None,
    controller: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Controller file of a bearing. [default: 'controller.toml' next to the rig file]",
        ),
    ] = None,
    as_json: AsJson = False,
    _verbose: Verbose = False,
) -> None:
    """Estimate the errors of the magnets of a stage or a bearing from its motion.

    Mass times acceleration, for a bearing including its load, is compared with the force that each
    method predicts from the currents. The mass in the rig file is assumed to be correct. [spread]
    defines how large the errors of the other parameters may be. To use the calibration in the next
    simulate, name the file as control.calibration in the rig file.

    Example: anhyst calibrate examples/stage/rig.toml run.csv --out calibration.toml

    Example: anhyst calibrate examples/bearing/rig.toml run.csv --out calibration.toml
    """
    calibration = anhyst.calibrate(rig, recordings, out, controller=controller)
    facts = calibration.facts()
    for method in calibration.file.method:
        if method.name == "full" and method.force_N > 0.0 and not method.fits:
            warn(f"{method.name}: {facts[method.name]}; a flux probe helps there")
    if as_json:
        print_json(calibration.as_dict())
    else:
        drawn = table("learnt from motion", ["method", "number", "value", "+/-", "before", ""])
        for method in calibration.file.method:
            for number in method.parameter:
                values = (f"{value:.3g}" for value in (number.value, number.sigma, number.prior))
                unseen = "frozen: not seen" if number.frozen else ""
                drawn.add_row(
                    method.name, number.name, *values, unseen if method.taken else "not taken"
                )
        written = [f"written: {out}"] if out is not None and calibration.learnt else []
        show(drawn, *(f"{name}: {text}" for name, text in facts.items()), *written)
    if not calibration.learnt:
        raise NegativeResult(
            "nothing is taken: too little motion or force was asked for, or no law explains it",
            code="nothing-learnt",
        )
