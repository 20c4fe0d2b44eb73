"""Tune the controller of a bearing for one variant or for all: what ``anhyst tune`` does."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from anhyst.atomic import PathLike, check_writable
from anhyst.errors import InputError, Interrupted
from anhyst.rig.distance import PlantCheck
from anhyst.simulate.controllerfile import (
    ControllerFile,
    ControllerTable,
    Variant,
    write_controller,
)
from anhyst.simulate.plantcheck import check_plant
from anhyst.simulate.ready import make_ready, read_files
from anhyst.simulate.rigfile import BearingRig
from anhyst.simulate.setup import Setup, make_setups
from anhyst.simulate.simulate import compared
from anhyst.tune.aims import Aims, Figures
from anhyst.tune.limits import Limit, find_limits
from anhyst.tune.output import RESULTS, file_note, verdict, write_results
from anhyst.tune.search import BUDGET, Found, Search
from anhyst.tune.trial import Condition, default_conditions

Progress = Callable[[float, float], None]


@dataclass(frozen=True)
class Tuned:
    """What tuning one variant gave.

    Parameters
    ----------
    variant : str
    found : Found
        The search.
    limits : tuple of Limit
        What limits.
    aims : Aims
    """

    variant: Variant
    found: Found
    limits: tuple[Limit, ...]
    aims: Aims

    @property
    def figures(self) -> Figures:
        """What the gains reach, worst of all conditions."""
        return self.found.figures

    @property
    def misses(self) -> Mapping[str, float]:
        """Aims that are missed, by how much of their limit."""
        return self.aims.misses(self.figures)


@dataclass(frozen=True)
class Tuning:
    """What a tuning gave.

    Parameters
    ----------
    rig : BearingRig
    controller : ControllerFile
        As it was.
    plant : PlantCheck
        What the loops say about the plant.
    aims : Aims
    conditions : tuple of Condition
    budget, seed : int
    tuned : mapping of str to Tuned
        By variant.
    written : mapping of str to Path
        Controller file of every variant.
    interrupted : bool
        Whether ctrl-C ended it.
    seconds, cpu_seconds : float
        By the clock, and of all processes.
    """

    rig: BearingRig
    controller: ControllerFile
    plant: PlantCheck
    aims: Aims
    conditions: tuple[Condition, ...]
    budget: int
    seed: int
    tuned: Mapping[Variant, Tuned]
    written: Mapping[Variant, Path]
    interrupted: bool
    seconds: float
    cpu_seconds: float

    @property
    def verdict(self) -> str | None:
        """Why the aims are not met, in a line; None if they are, by the file's own variant."""
        own = self.tuned.get(self.controller.settings.compensation.variant)
        if own is None or not own.misses:
            return None
        return verdict(own)


def tune(
    rig_path: PathLike,
    out: PathLike,
    controller_path: PathLike | None = None,
    *,
    aims: Aims | None = None,
    all_variants: bool = False,
    budget: int = BUDGET,
    seed: int = 0,
    progress: Progress | None = None,
    jobs: int | None = None,
) -> Tuning:
    """Find gains for stated aims over gaps, step heights and loads at once; write the files.

    Parameters
    ----------
    rig_path : path-like
        Rig file of a bearing: its gaps, steps and load are what is tried, and two thirds of that
        load.
    out : path-like
        Folder to write to: ``controller.toml`` (with `all_variants`, one for each:
        ``controller-full.toml``), ``tuning.json``, ``tuning.md`` and ``pareto.png``.
    controller_path : path-like, optional
        Controller file to begin with; ``controller.toml`` beside the rig file if left out.
        Everything but the gains, filters and set-point weight is kept.
    aims : Aims, optional
    all_variants : bool, optional
        Tune every variant for itself, with the same aims, budget and seed.
    budget : int, optional
        Sets of gains that are tried in the nonlinear loop, for each variant.
    seed : int, optional
        The same seed gives the same result on any number of cores.
    progress : callable, optional
        Called with what is done and what there is in all.
    jobs : int, optional
        Processes; as many as there are cores if left out.

    Returns
    -------
    Tuning
        Written even if aims are missed; see :attr:`Tuning.verdict`.

    Raises
    ------
    InputError
        A file that cannot be read, written, or does not fit the others.
    Interrupted
        Ctrl-C, too early for any gains.
    """
    if budget < 10:
        raise InputError(f"--budget: {budget} sets of gains are too few; give 10 or more")
    begin, used = time.perf_counter(), _processor_time()
    rig, controller = read_files(rig_path, controller_path)
    own = controller.settings.compensation.variant
    variants = compared(rig, own) if all_variants else (own,)
    folder = Path(out)
    places = _places(folder, variants, rig, controller)
    ready = make_ready(rig, controller)
    rig = ready.rig
    knowledge = ready.knowledge()
    setups = make_setups(rig, controller, knowledge, variants)
    task = _Task(default_conditions(rig), aims or Aims(), budget, seed, jobs)
    tuned, interrupted = task.run(setups, progress)
    written = {name: places[name] for name in tuned}
    folder.mkdir(parents=True, exist_ok=True)
    for name, one in tuned.items():
        settings = _portable(one.found.setup.controller, controller, folder)
        write_controller(
            written[name],
            settings.model_copy(update={"name": f"tuned, {name}"}),
            file_note(one, rig, task.conditions, budget, seed),
        )
    result = Tuning(
        rig=rig,
        controller=controller,
        plant=check_plant(rig, knowledge),
        aims=task.aims,
        conditions=task.conditions,
        budget=budget,
        seed=seed,
        tuned=tuned,
        written=written,
        interrupted=interrupted,
        seconds=time.perf_counter() - begin,
        cpu_seconds=_processor_time() - used,
    )
    write_results(result, folder)
    return result


@dataclass(frozen=True)
class _Task:
    """What is the same for every variant."""

    conditions: tuple[Condition, ...]
    aims: Aims
    budget: int
    seed: int
    jobs: int | None

    def run(
        self, setups: Mapping[Variant, Setup], progress: Progress | None
    ) -> tuple[dict[Variant, Tuned], bool]:
        """Tune one after the other; ctrl-C ends it and keeps what there is."""
        tuned: dict[Variant, Tuned] = {}
        for place, (name, setup) in enumerate(setups.items()):
            part = _part(progress, place, len(setups))
            search = Search(
                setup, self.conditions, self.aims, self.budget, self.seed, part, self.jobs
            )
            try:
                found = search.run()
                limits = self._limits(found)
                if part is not None:
                    part(1, 1)
            except KeyboardInterrupt:
                if not tuned:
                    raise Interrupted("too early for any gains, nothing written") from None
                return tuned, True
            tuned[name] = Tuned(name, found, tuple(limits), self.aims)
            if found.interrupted:
                return tuned, True
        return tuned, False

    def _limits(self, found: Found) -> Sequence[Limit]:
        if found.check is None:
            return ()
        return find_limits(
            found.setup, self.conditions, self.aims, found.check, self.seed, self.jobs
        )


def _places(
    folder: Path, variants: Sequence[Variant], rig: BearingRig, controller: ControllerFile
) -> dict[Variant, Path]:
    """Return where the controller files go; find out first whether they can be written."""
    names = {
        name: "controller.toml" if len(variants) == 1 else f"controller-{name}.toml"
        for name in variants
    }
    if folder.is_dir():
        for name in (*names.values(), *RESULTS):
            check_writable(folder / name, reads=[rig.path, controller.path, *rig.measured.files])
    elif folder.exists():
        raise InputError(f"{folder}: is a file; name a folder")
    else:
        # A file of that name could be made there, and so could the folder.
        above = next(one for one in folder.absolute().parents if one.exists())
        check_writable(above / folder.name)
    return {name: folder / file for name, file in names.items()}


def _portable(
    settings: ControllerTable, controller: ControllerFile, folder: Path
) -> ControllerTable:
    """Return settings whose model is named as seen from another folder."""
    if controller.model is None:
        return settings
    model = os.path.relpath(controller.model, folder)
    compensation = settings.compensation.model_copy(update={"model": Path(model).as_posix()})
    return settings.model_copy(update={"compensation": compensation})


def _part(progress: Progress | None, place: int, count: int) -> Progress | None:
    """Return the progress of one variant as a part of the whole."""
    if progress is None:
        return None

    def update(done: float, total: float) -> None:
        progress(place + done / total, count)

    return update


def _processor_time() -> float:
    """Return the processor time of this process and those that it waited for, s."""
    used = os.times()
    return used.user + used.system + used.children_user + used.children_system
