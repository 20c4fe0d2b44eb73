"""Tune the controller of a bearing for one variant or for all: what ``anhyst tune`` does."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from anhyst.compensate.interface import MethodName
from anhyst.control.controller_file import ControllerFile, ControllerTable, write_controller
from anhyst.rig.bearing.file import BearingRig
from anhyst.rig.bearing.loop import Setup
from anhyst.rig.bearing.make_setup import check_plant, make_setups
from anhyst.study.bearing.ready import make_ready, read_files
from anhyst.study.bearing.simulate import compared
from anhyst.study.tuning.aims import Aims
from anhyst.study.tuning.limits import Limit, find_limits
from anhyst.study.tuning.output import RESULTS, file_note, write_results
from anhyst.study.tuning.result import Tuned, Tuning
from anhyst.study.tuning.search import BUDGET, FoundGains, GainSearch
from anhyst.study.tuning.trial import Condition, default_conditions
from anhyst.support.atomic import PathLike, check_writable
from anhyst.support.errors import InputError, Interrupted
from anhyst.support.progress import Progress


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
    """Find gains for stated aims over gaps, step heights and loads at once; write the files."""
    if budget < 10:
        raise InputError(
            f"--budget: {budget} sets of gains are too few; give 10 or more",
            code="out-of-range",
            key="--budget",
        )
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
        self, setups: Mapping[MethodName, Setup], progress: Progress | None
    ) -> tuple[dict[MethodName, Tuned], bool]:
        """Tune one after the other; ctrl-C ends it and keeps what there is."""
        tuned: dict[MethodName, Tuned] = {}
        for place, (name, setup) in enumerate(setups.items()):
            part = _part(progress, place, len(setups))
            search = GainSearch(
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

    def _limits(self, found: FoundGains) -> Sequence[Limit]:
        if found.check is None:
            return ()
        return find_limits(
            found.setup, self.conditions, self.aims, found.check, self.seed, self.jobs
        )


def _places(
    folder: Path, variants: Sequence[MethodName], rig: BearingRig, controller: ControllerFile
) -> dict[MethodName, Path]:
    """Return where the controller files go; find out first whether they can be written."""
    names = {
        name: "controller.toml" if len(variants) == 1 else f"controller-{name}.toml"
        for name in variants
    }
    if folder.is_dir():
        for name in (*names.values(), *RESULTS):
            check_writable(folder / name, reads=[rig.path, controller.path, *rig.measured.files])
    elif folder.exists():
        raise InputError(f"{folder}: is a file; name a folder", code="is-a-file")
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
