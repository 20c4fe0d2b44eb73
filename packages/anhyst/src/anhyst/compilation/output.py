"""Compile a model, in memory or in a file, to a folder of C (``anhyst compile``).

`compile_model` plans the tables, measures the accuracy budget and writes all files. If the budget
exceeds the allowed error, it plans again with a smaller allowance. If the accuracy stays
insufficient, it writes nothing and raises an error.
"""

from __future__ import annotations

import hashlib
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from anhyst.compensate.budget import (
    ADVICE,
    Budget,
    accuracy_error,
    budget_dict,
    drift_error,
    explain_drift,
    is_accuracy_reached,
    is_drift_allowed,
    is_within_allowance,
    largest_part,
    measure_budget,
    percent,
)
from anhyst.compensate.force_controller import SignalFormat
from anhyst.compensate.measure import CROSSING_TIME_S
from anhyst.compensate.plan import (
    DEFAULT_ACCURACY_PERCENT,
    CompileRequest,
    Plan,
    make_plan,
    not_computed_error,
)
from anhyst.compilation.a2l import make_a2l
from anhyst.compilation.budget_page import explain_choices, make_budget_page
from anhyst.compilation.controller import CheckedController, read_checked_controller
from anhyst.compilation.manifest import (
    MANIFEST_FILE,
    CompiledFolder,
    check_folder,
    make_manifest,
    write_folder,
)
from anhyst.compilation.packages import check_package, make_package_files
from anhyst.compilation.play import CompiledPlay, compile_play
from anhyst.compilation.source import example_values, make_sources, signal_lines
from anhyst.compilation.vectors import (
    COLUMNS,
    LEVITATION_COLUMNS,
    make_golden_vectors,
    make_levitation_vectors,
    write_vectors_csv,
)
from anhyst.control.controller_file import read_controller
from anhyst.model.actuator import Model, read_model
from anhyst.model.prediction import describe_fast_drives
from anhyst.support import running_version
from anhyst.support.atomic import PathLike, json_text
from anhyst.support.errors import InputError, NegativeResult
from anhyst.support.jobs import Progress
from anhyst.support.result import rows_to_columns

if TYPE_CHECKING:
    from matplotlib.axes import Axes


ALLOWANCE_SHARES = (1.0, 0.7, 0.4)
"""Fractions of the allowance that successive plans may use."""


@dataclass(frozen=True, repr=False)
class Compiled(CompiledFolder):
    """Result of compiling a model.

    Parameters
    ----------
    out : Path
        The folder.
    manifest : dict
        Content of ``manifest.json``, without the hashes of the files.
    files : tuple of str
        Names of the files.
    plan : Plan
        Selected scales, tables and start-up sequence.
    budget : Budget
        Measured accuracy.
    left_out : tuple of str
        Parts of the model that are not compiled, one sentence each.
    """

    plan: Plan
    budget: Budget
    left_out: tuple[str, ...] = ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings for the user, one sentence each; usually there are none."""
        notes = list(self.left_out)
        budget_run = np.array(self.plan.model.valid_range.input), np.array([0.0, CROSSING_TIME_S])
        notes += describe_fast_drives(self.plan.model, [budget_run], "in the accuracy budget, ")
        page = next(name for name in self.files if name.endswith("budget.html"))
        if not is_within_allowance(self.plan, self.budget):
            notes.append(
                "the error due to formats and tables exceeds the default limit, "
                f"{DEFAULT_ACCURACY_PERCENT:g} % of the largest output: "
                f"{ADVICE[largest_part(self.budget).name]}; {self.out / page} shows each contribution"
            )
        if not is_drift_allowed(self.plan, self.budget):
            notes.append(explain_drift(self.plan, self.budget))
        return tuple(notes)

    def facts(self) -> dict[str, str]:
        """Return folder, kind, signals, rate and accuracy."""
        request, budget = self.plan.request, self.budget
        worst_text, drift = (
            f"{percent(budget, part.worst or 0.0):.2g} % of {budget.reference_output:.4g} {budget.unit}"
            for part in (budget.compiled, budget.drift)
        )
        facts = {"folder": str(self.out), "kind": request.kind, "signals": request.io}
        facts |= {"rate": f"{request.rate:g} Hz", "accuracy": worst_text, "drift": drift}
        return facts | {f"warning {n}": text for n, text in enumerate(self.warnings, 1)}

    def to_columns(self) -> dict[str, Any]:
        """Return the accuracy budget, in units of the output and in % of the reference output."""
        return rows_to_columns(budget_dict(self.budget)["parts"])

    def draw(self, ax: Axes) -> None:
        """Draw the accuracy budget: the error contribution of each step."""
        budget = self.budget
        parts = [part for part in (*budget.parts, budget.compiled, budget.drift) if part.worst]
        bar_positions = range(len(parts))
        ax.barh(bar_positions, [percent(budget, part.worst or 0.0) for part in parts], color="0.8")
        ax.barh(bar_positions, [percent(budget, part.rms or 0.0) for part in parts], height=0.5)
        ax.set_yticks(bar_positions, [part.title for part in parts])
        ax.invert_yaxis()
        ax.set_xlabel(f"worst and rms, % of {budget.reference_output:.4g} {budget.unit}")


def compile_model(
    model_path: PathLike,
    out: PathLike,
    request: CompileRequest,
    controller_path: PathLike | None = None,
    progress: Progress | None = None,
    package: str | None = None,
) -> Compiled:
    """Compile a model file to a folder of C, with or without a position controller."""
    check_package(package)
    check_folder(out)
    model = read_model(model_path)
    model, omissions = select_compilable(model, request)
    controller = None
    if controller_path is not None:
        controller = read_checked_controller(controller_path, request, model_path)
        controller.check_current(model)
    sha256 = hashlib.sha256(Path(model_path).read_bytes()).hexdigest()
    try:
        plan, budget = _plan_within_allowance(model, request, int(sha256[:8], 16), controller, progress)
    except InputError as error:
        raise error.with_location(model_path) from error
    except NegativeResult as error:
        raise not_computed_error(error).with_location(model_path) from error
    if not is_accuracy_reached(budget):
        raise accuracy_error(budget, _find_better_options(model, plan, controller))
    if request.accuracy is not None and request.kind == "full" and not is_drift_allowed(plan, budget):
        raise drift_error(plan, budget)
    budget_entry, accuracy = budget_dict(budget), _guide_accuracy(budget)
    version = running_version()
    controller_plan = None if controller is None else controller.make_controller_plan(plan)
    signals, values = signal_lines(plan), example_values(plan, sha256, version, controller_plan)
    choices = explain_choices(plan)
    files = {
        **make_sources(plan, values, accuracy, signals, controller_plan),
        "vectors.csv": write_vectors_csv(COLUMNS, make_golden_vectors(plan)),
        "budget.json": json_text(budget_entry),
        "budget.html": make_budget_page(plan, budget, choices, signals, version),
    }
    if controller_plan is not None:
        files["controller.csv"] = write_vectors_csv(
            LEVITATION_COLUMNS, make_levitation_vectors(plan, controller_plan)
        )
    manifest_entry = make_manifest(plan, budget, choices, sha256, version, controller_plan)
    if request.io != "f32":  # firmware uses fixed point
        files[f"{plan.name}.a2l"] = make_a2l(manifest_entry)
    output_files = make_package_files(package, files, manifest_entry, values)
    manifest_entry |= {} if package is None else {"package": package}
    write_folder(out, output_files, manifest_entry)
    return Compiled(Path(out), manifest_entry, (*output_files, MANIFEST_FILE), plan, budget, omissions)


def select_compilable(model: Model, request: CompileRequest) -> tuple[Model, tuple[str, ...]]:
    """Return the part of a model that can be compiled, and a sentence about each omission."""
    if model.has_lag or (model.has_layers and request.kind == "full"):
        return model, list_omissions(model, has_layers=True)
    return model.at_rest, list_omissions(model)


def list_omissions(model: Model, *, has_layers: bool = False) -> tuple[str, ...]:
    """Return a sentence for each dynamic part of a model that is not compiled."""
    dynamics, notes = model.dynamics, []
    if model.has_eddy_currents and not has_layers:
        alternative_text = "; --kind full compiles it" if model.has_layers else ""
        notes.append(
            "the eddy-current lag (gamma) is not compiled: fast demands are compensated like slow ones, "
            f"and anhyst predict with a column t_s shows the remaining error{alternative_text}"
        )
    if model.eddy_circuit is not None and model.eddy_circuit.excess > 0.0:
        notes.append(
            "the excess loss is compiled as a lag, which is equal at the highest validated rate: the row "
            "'rate' of the budget states the error, and faster demands are compensated too much"
        )
    if dynamics is not None and dynamics.lag > 0.0:
        notes.append(f"the lag of {dynamics.lag:.3g} s is not compiled: give the demand earlier by this time")
    if dynamics is not None and dynamics.times:
        notes.append(
            f"creep is not compiled: {100.0 * sum(dynamics.shares):.2g} % of a step, within "
            f"{max(dynamics.times):.3g} s, is left to the feedback"
        )
    return tuple(notes)


def _guide_accuracy(budget: Budget) -> dict[str, str]:
    """Return the errors for the drop-in guide, % of the reference output."""
    return {
        name: f"{percent(budget, part.worst or 0.0):.2g}"
        for name, part in (("travelling", budget.compiled), ("drift", budget.drift))
    }


def _find_better_options(model: Model, plan: Plan, controller: CheckedController | None) -> str:
    """Return options that reach the requested accuracy; empty if there are none."""
    compensator = plan.request
    attempts: list[tuple[str, CompileRequest]] = []
    if compensator.kind != "full":
        attempts.append(("--kind full", replace(compensator, kind="full")))
    elif controller is None:
        finer_formats: dict[SignalFormat, tuple[SignalFormat, ...]] = {"q15": ("q31", "f32"), "q31": ("f32",)}
        attempts += [
            (f"--io {io}", replace(compensator, io=io)) for io in finer_formats.get(compensator.io, ())
        ]
    for options, request in attempts:
        try:
            budget = _plan_within_allowance(model, request, plan.builder.model_hash, controller, None)[1]
        except (InputError, NegativeResult):
            continue
        if is_accuracy_reached(budget):
            return options
    return ""


def _plan_within_allowance(
    model: Model,
    request: CompileRequest,
    model_hash: int,
    controller: CheckedController | None,
    progress: Progress | None,
) -> tuple[Plan, Budget]:
    """Return a plan within the allowance, and its budget.

    The allowance of the search is reduced while the budget exceeds it. A position controller
    without a requested accuracy is planned once.
    """
    shares: tuple[float, ...] = ALLOWANCE_SHARES
    if controller is not None:
        model = controller.restrict_model(model)
        shares = ALLOWANCE_SHARES[:1] if request.accuracy is None else ALLOWANCE_SHARES
    total_steps = 2 * len(shares) + 1  # two progress steps per plan, one for files
    for index, share in enumerate(shares):
        plan = make_plan(model, request, model_hash, share)
        if progress is not None:
            progress(2 * index + 1, total_steps)
        budget = measure_budget(plan)
        if progress is not None:
            progress(2 * index + 2, total_steps)
        if plan.search_result.error > share * plan.allowance or is_within_allowance(plan, budget):
            break
    return plan, budget


CompileKind = Literal["full", "simplified", "play"]


def compile_actuator(
    model: Model | PathLike,
    out: PathLike,
    *,
    rate: float | None = None,
    kind: CompileKind = "full",
    io: SignalFormat = "q15",
    accuracy: float | None = None,
    name: str | None = None,
    controller: PathLike | None = None,
    package: str | None = None,
    progress: Progress | None = None,
) -> Compiled | CompiledPlay:
    """Compile a model, in memory or in a file, to a folder of C: demand in, current out."""
    if isinstance(model, Model):
        with tempfile.TemporaryDirectory(prefix="anhyst-") as folder:
            path = model.save(Path(folder) / "model.toml")
            return compile_actuator(
                path, out, rate=rate, kind=kind, io=io, accuracy=accuracy, name=name,
                controller=controller, package=package, progress=progress,
            )  # fmt: skip
    if rate is None and controller is None:
        read_model(model)  # an invalid model file is reported before a missing option
    rate_Hz = _select_rate(rate, controller)
    if kind == "play":
        _check_play_options(controller, accuracy)
        return compile_play(model, out, rate_Hz, io, name, package)
    request = CompileRequest(kind, io, rate_Hz, accuracy, name)
    return compile_model(model, out, request, controller, progress, package)


def _select_rate(rate: float | None, controller: PathLike | None) -> float:
    """Return the given sample rate, or that of the controller file, Hz."""
    if rate is not None:
        return rate
    if controller is None:
        text = "--rate: is missing; give the sample rate in Hz, or a --controller file"
        raise InputError(text, code="missing", key="--rate")
    return read_controller(controller).settings.rate_Hz


def _check_play_options(controller: PathLike | None, accuracy: float | None) -> None:
    """Raise an error for options that a map with one play operator does not have."""
    if controller is not None:
        raise InputError(
            "--controller: a position controller is compiled with --kind full or simplified; omit "
            "it, or give another kind",
            code="option-not-for-this",
            key="--controller",
        )
    if accuracy is not None:
        raise InputError(
            "--accuracy: the accuracy of a map with one play cannot be selected; omit it, or give "
            "--kind full",
            code="option-not-for-this",
            key="--accuracy",
        )
