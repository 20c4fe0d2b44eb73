"""From a model, in memory or in a file, to a folder of C of any kind: what ``anhyst compile`` does."""

from __future__ import annotations

import hashlib
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from anhyst.compensate.budget import (
    REASON,
    Budget,
    as_dict,
    culprit,
    drift_refusal,
    is_held,
    is_reached,
    keeps_allowance,
    measure_budget,
    percent,
    refusal,
    why_drifting,
)
from anhyst.compensate.force_controller import Io
from anhyst.compensate.plan import ACCURACY, CompileRequest, Plan, make_plan, not_computed
from anhyst.compilation.a2l import a2l
from anhyst.compilation.budget_page import budget_page, explain
from anhyst.compilation.controller import Controller, read_fitting
from anhyst.compilation.manifest import (
    MANIFEST,
    CompiledFolder,
    check_folder,
    manifest,
    write_folder,
)
from anhyst.compilation.packages import check_package, package_files
from anhyst.compilation.play import CompiledPlay, compile_play
from anhyst.compilation.source import example_values, signal_lines, sources
from anhyst.compilation.vectors import (
    COLUMNS,
    LEVITATION_COLUMNS,
    golden_vectors,
    levitation_vectors,
    vectors_csv,
)
from anhyst.control.controller_file import read_controller
from anhyst.model.actuator import Model, read_model
from anhyst.support import running_version
from anhyst.support.atomic import PathLike, json_text
from anhyst.support.errors import InputError, NegativeResult
from anhyst.support.jobs import Progress
from anhyst.support.result import columns_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes


SHARES = (1.0, 0.7, 0.4)
"""Of the allowance that a plan may use up, one try after the other."""


@dataclass(frozen=True, repr=False)
class Compiled(CompiledFolder):
    """What came out.

    Parameters
    ----------
    out : Path
        The folder.
    manifest : dict
        What stands in ``manifest.json``, without the hashes of the files.
    files : tuple of str
        Names of the files.
    plan : Plan
        What was chosen.
    budget : Budget
        How accurate it is.
    left_out : tuple of str
        What of the model is not compiled, one sentence each.
    """

    plan: Plan
    budget: Budget
    left_out: tuple[str, ...] = ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a user should know, one sentence each; mostly nothing."""
        notes = list(self.left_out)
        page = next(name for name in self.files if name.endswith("budget.html"))
        if not keeps_allowance(self.plan, self.budget):
            notes.append(
                f"formats and tables cost more than the {ACCURACY:g} % of the largest output that "
                f"is usual: {REASON[culprit(self.budget).name]}; {self.out / page} shows "
                "how much"
            )
        if not is_held(self.plan, self.budget):
            notes.append(why_drifting(self.plan, self.budget))
        return tuple(notes)

    def facts(self) -> dict[str, str]:
        """Return where it is, what it is, and how accurate."""
        request, budget = self.plan.request, self.budget
        worst, drift = (
            f"{percent(budget, part.worst or 0.0):.2g} % of {budget.largest:.4g} {budget.unit}"
            for part in (budget.compiled, budget.drift)
        )
        facts = {"folder": str(self.out), "kind": request.kind, "signals": request.io}
        facts |= {"rate": f"{request.rate:g} Hz", "accuracy": worst, "drift": drift}
        return facts | {f"warning {n}": text for n, text in enumerate(self.warnings, 1)}

    def to_columns(self) -> dict[str, Any]:
        """Return the accuracy budget, in units of the output and in per cent of the largest."""
        return columns_of(as_dict(self.budget)["parts"])

    def draw(self, ax: Axes) -> None:
        """Draw the accuracy budget: what each part costs."""
        budget = self.budget
        parts = [part for part in (*budget.parts, budget.compiled, budget.drift) if part.worst]
        places = range(len(parts))
        ax.barh(places, [percent(budget, part.worst or 0.0) for part in parts], color="0.8")
        ax.barh(places, [percent(budget, part.rms or 0.0) for part in parts], height=0.5)
        ax.set_yticks(places, [part.title for part in parts])
        ax.invert_yaxis()
        ax.set_xlabel(f"worst and rms, % of {budget.largest:.4g} {budget.unit}")


def compile_model(
    model_path: PathLike,
    out: PathLike,
    request: CompileRequest,
    controller_path: PathLike | None = None,
    progress: Progress | None = None,
    package: str | None = None,
) -> Compiled:
    """Compile a model into a folder of C, with a controller of the position or without."""
    check_package(package)
    check_folder(out)
    model = read_model(model_path)
    model, late = compilable(model, request)
    controller = None
    if controller_path is not None:
        controller = read_fitting(controller_path, request, model_path)
        controller.check_current(model)
    sha256 = hashlib.sha256(Path(model_path).read_bytes()).hexdigest()
    try:
        plan, budget = _planned(model, request, int(sha256[:8], 16), controller, progress)
    except InputError as error:
        raise error.at(model_path) from error
    except NegativeResult as error:
        raise not_computed(error).at(model_path) from error
    if not is_reached(budget):
        raise refusal(budget, _better(model, plan, controller))
    if request.accuracy is not None and request.kind == "full" and not is_held(plan, budget):
        raise drift_refusal(plan, budget)
    costs, accuracy = as_dict(budget), _accuracy(budget)
    version = running_version()
    around = None if controller is None else controller.around(plan)
    signals, values = signal_lines(plan), example_values(plan, sha256, version, around)
    choices = explain(plan)
    files = {
        **sources(plan, values, accuracy, signals, around),
        "vectors.csv": vectors_csv(COLUMNS, golden_vectors(plan)),
        "budget.json": json_text(costs),
        "budget.html": budget_page(plan, budget, choices, signals, version),
    }
    if around is not None:
        files["controller.csv"] = vectors_csv(LEVITATION_COLUMNS, levitation_vectors(plan, around))
    described = manifest(plan, budget, choices, sha256, version, around)
    if request.io != "f32":  # a firmware computes in fixed point
        files[f"{plan.name}.a2l"] = a2l(described)
    packed = package_files(package, files, described, values)
    described |= {} if package is None else {"package": package}
    write_folder(out, packed, described)
    return Compiled(Path(out), described, (*packed, MANIFEST), plan, budget, late)


def compilable(model: Model, request: CompileRequest) -> tuple[Model, tuple[str, ...]]:
    """Return what of a model is compiled, and say what is not."""
    if model.has_lag or (model.has_layers and request.kind == "full"):
        return model, not_compiled(model, layers=True)
    return model.at_rest, not_compiled(model)


def not_compiled(model: Model, *, layers: bool = False) -> tuple[str, ...]:
    """Say what comes late and is left to what stands around the compensator."""
    late, notes = model.dynamics, []
    if model.has_eddy_currents and not layers:
        better = "; --kind full has it" if model.has_layers else ""
        notes.append(
            "how late solid iron answers (gamma) is not compiled: fast demands are met as slow ones "
            f"are, and anhyst predict with column t_s says what that leaves{better}"
        )
    if late is not None and late.lag > 0.0:
        notes.append(
            f"the lag of {late.lag:.3g} s is not compiled: give the demand so much earlier"
        )
    if late is not None and late.times:
        notes.append(
            f"creep is not compiled: {100.0 * sum(late.shares):.2g} % of a step, within "
            f"{max(late.times):.3g} s, is left to the feedback"
        )
    return tuple(notes)


def _accuracy(budget: Budget) -> dict[str, str]:
    """Return what the drop-in guide says of the accuracy, per cent of the largest output."""
    return {
        name: f"{percent(budget, part.worst or 0.0):.2g}"
        for name, part in (("travelling", budget.compiled), ("drift", budget.drift))
    }


def _better(model: Model, plan: Plan, controller: Controller | None) -> str:
    """Return the options that reach an accuracy which those of a plan do not; empty if none do."""
    compensator = plan.request
    tries: list[tuple[str, CompileRequest]] = []
    if compensator.kind != "full":
        tries.append(("--kind full", replace(compensator, kind="full")))
    elif controller is None:
        finer: dict[Io, tuple[Io, ...]] = {"q15": ("q31", "f32"), "q31": ("f32",)}
        tries += [
            (f"--io {io}", replace(compensator, io=io)) for io in finer.get(compensator.io, ())
        ]
    for options, request in tries:
        try:
            planned = _planned(model, request, plan.builder.model_hash, controller, None)[1]
        except (InputError, NegativeResult):
            continue
        if is_reached(planned):
            return options
    return ""


def _planned(
    model: Model,
    request: CompileRequest,
    model_hash: int,
    controller: Controller | None,
    progress: Progress | None,
) -> tuple[Plan, Budget]:
    """Plan, and tighter where another path breaks the allowance, unless a controller asked for none."""
    shares: tuple[float, ...] = SHARES
    if controller is not None:
        model = controller.narrowed(model)
        shares = SHARES[:1] if request.accuracy is None else SHARES
    whole = 2 * len(shares) + 1  # a plan and its budget each, and what is written
    for index, share in enumerate(shares):
        plan = make_plan(model, request, model_hash, share)
        if progress is not None:
            progress(2 * index + 1, whole)
        budget = measure_budget(plan)
        if progress is not None:
            progress(2 * index + 2, whole)
        if plan.found.reached > share * plan.allowance or keeps_allowance(plan, budget):
            break
    return plan, budget


CompileKind = Literal["full", "simplified", "play"]


def compile_actuator(
    model: Model | PathLike,
    out: PathLike,
    *,
    rate: float | None = None,
    kind: CompileKind = "full",
    io: Io = "q15",
    accuracy: float | None = None,
    name: str | None = None,
    controller: PathLike | None = None,
    package: str | None = None,
    progress: Progress | None = None,
) -> Compiled | CompiledPlay:
    """Compile a model, in memory or in a file, into a folder of C: demand in, current out."""
    if isinstance(model, Model):
        with tempfile.TemporaryDirectory(prefix="anhyst-") as folder:
            path = model.save(Path(folder) / "model.toml")
            return compile_actuator(
                path, out, rate=rate, kind=kind, io=io, accuracy=accuracy, name=name,
                controller=controller, package=package, progress=progress,
            )  # fmt: skip
    if rate is None and controller is None:
        read_model(model)  # a file that is none is said before what is missing beside it
    ticks = _rate(rate, controller)
    if kind == "play":
        _refuse_for_play(controller, accuracy)
        return compile_play(model, out, ticks, io, name, package)
    request = CompileRequest(kind, io, ticks, accuracy, name)
    return compile_model(model, out, request, controller, progress, package)


def _rate(rate: float | None, controller: PathLike | None) -> float:
    """Return what was given, or what the controller file says."""
    if rate is not None:
        return rate
    if controller is None:
        text = "--rate: is missing; give the ticks a second, or a --controller file"
        raise InputError(text, code="missing", key="--rate")
    return read_controller(controller).settings.rate_Hz


def _refuse_for_play(controller: PathLike | None, accuracy: float | None) -> None:
    """Refuse what a map with one play does not have: it is neither planned nor put around."""
    if controller is not None:
        raise InputError(
            "--controller: a position controller is compiled with --kind full or simplified; leave "
            "it out, or give another kind",
            code="option-not-for-this",
            key="--controller",
        )
    if accuracy is not None:
        raise InputError(
            "--accuracy: a map with one play is as accurate as its one play; leave it out, or give "
            "--kind full",
            code="option-not-for-this",
            key="--accuracy",
        )
