"""From a model file to a folder of C: what ``anhyst compile`` does."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from anhyst.atomic import PathLike
from anhyst.compile.budget import Budget, as_dict, check_accuracy, keeps_allowance, measure_budget
from anhyst.compile.controller import Controller, read_fitting
from anhyst.compile.folder import check_folder, json_text, write_folder
from anhyst.compile.lifting import flight_csv, flight_vectors
from anhyst.compile.manifest import manifest
from anhyst.compile.page import budget_page
from anhyst.compile.plan import ACCURACY, Plan, Request, make_plan, not_computed
from anhyst.compile.source import sources
from anhyst.compile.vectors import golden_vectors, vectors_csv
from anhyst.errors import InputError, NegativeResult
from anhyst.model import ActuatorModel
from anhyst.modelfile import read_model
from anhyst.version import running_version

SHARES = (1.0, 0.7, 0.4)
"""Of the allowance that a plan may use up, one try after the other."""


@dataclass(frozen=True)
class Compiled:
    """What came out.

    Parameters
    ----------
    out : Path
        The folder.
    plan : Plan
        What was chosen.
    budget : Budget
        How accurate it is.
    manifest : dict
        What stands in ``manifest.json``, without the hashes of the files.
    files : tuple of str
        Names of the files.
    """

    out: Path
    plan: Plan
    budget: Budget
    manifest: dict[str, Any]
    files: tuple[str, ...]

    @property
    def warning(self) -> str:
        """What a user should know, in one sentence; mostly nothing."""
        if keeps_allowance(self.plan, self.budget):
            return ""
        return (
            f"formats and tables cost more than the {ACCURACY:g} % of the largest output that is "
            f"usual: 2 KiB of tables hold no more; {self.out / 'budget.html'} tells how much"
        )


def compile_model(
    model_path: PathLike,
    out: PathLike,
    request: Request,
    controller_path: PathLike | None = None,
) -> Compiled:
    """Compile a model into a folder of C, with a controller of the position or without.

    Parameters
    ----------
    model_path : path-like
        A model file.
    out : path-like
        The folder to write; one that was compiled before is replaced, any other is left alone.
    request : Request
        What is wanted.
    controller_path : path-like, optional
        A controller file.

    Returns
    -------
    Compiled

    Raises
    ------
    InputError
        The model cannot be read or compiled, the controller is another one than what is wanted, or
        the folder cannot be written.
    NegativeResult
        The wanted accuracy cannot be reached.
    """
    check_folder(out)
    model = read_model(model_path)
    controller = None
    if controller_path is not None:
        controller = read_fitting(controller_path, request, model_path)
        controller.check_current(model)
    sha256 = hashlib.sha256(Path(model_path).read_bytes()).hexdigest()
    try:
        plan, budget = _planned(model, request, int(sha256[:8], 16), controller)
    except InputError as error:
        raise InputError(f"{model_path}: {error}") from error
    except NegativeResult as error:
        raise InputError(f"{model_path}: {not_computed(error)}") from error
    check_accuracy(budget)
    version = running_version()
    around = None if controller is None else controller.around(plan)
    files = {
        **sources(plan, sha256, version, around),
        "vectors.csv": vectors_csv(golden_vectors(plan)),
        "budget.json": json_text(as_dict(budget)),
        "budget.html": budget_page(plan, budget, version),
    }
    if around is not None:
        files["controller.csv"] = flight_csv(flight_vectors(plan, around))
    described = manifest(plan, budget, sha256, version, around)
    write_folder(out, files, described)
    return Compiled(Path(out), plan, budget, described, (*files, "manifest.json"))


def _planned(
    model: ActuatorModel, request: Request, model_hash: int, controller: Controller | None
) -> tuple[Plan, Budget]:
    """Plan, and plan tighter where another path than that of the plan breaks the allowance.

    With a controller and no accuracy asked for, the first plan stays: it is what simulations run.
    """
    shares: tuple[float, ...] = SHARES
    if controller is not None:
        model = controller.narrowed(model)
        shares = SHARES[:1] if request.accuracy is None else SHARES
    for share in shares:
        plan = make_plan(model, request, model_hash, share)
        budget = measure_budget(plan)
        at_its_end = plan.found.reached > share * plan.allowance
        if at_its_end or keeps_allowance(plan, budget):
            break
    return plan, budget
