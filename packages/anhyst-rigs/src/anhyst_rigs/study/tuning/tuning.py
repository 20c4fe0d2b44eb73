"""Tune the controller of a rig for one or all variants: the command ``anhyst tune``."""

from __future__ import annotations

import math
import os
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Protocol

from anhyst.control.controller_file import ControllerFile, write_controller
from anhyst.support.atomic import PathLike, check_folder_writable, check_writable, relative_path
from anhyst.support.errors import InputError, Interrupted
from anhyst.support.jobs import Progress, map_ordered, split_progress
from anhyst.support.kinds import FLUX_PROBE_METHODS, MethodName, require_capability
from anhyst.support.toml_file import require_rig
from anhyst.support.toml_text import KeyPath
from anhyst_rigs.rig.bearing.loop import make_setups
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.distance import PlantCheck
from anhyst_rigs.rig.fitting import check_plant
from anhyst_rigs.rig.piezo import PiezoRig, read_piezo_rig
from anhyst_rigs.rig.rewriting import rewrite_rig
from anhyst_rigs.rig.stage.file import read_stage
from anhyst_rigs.rig.stage.fitted import identify_stage_magnet
from anhyst_rigs.rig.stage.setpoint import scan_motion
from anhyst_rigs.study.bearing.inputs import check_inputs, read_files
from anhyst_rigs.study.bearing.simulate import compared_variants
from anhyst_rigs.study.piezo import find_inverses
from anhyst_rigs.study.plants import PIEZO_METHODS
from anhyst_rigs.study.tracking.gains import find_gains
from anhyst_rigs.study.tracking.simulate import (
    COMPARED_METHODS,
    COMPENSATOR,
    check_calibration,
    make_variants,
)
from anhyst_rigs.study.tuning.aims import Aims
from anhyst_rigs.study.tuning.bearing import BearingLoop, default_conditions
from anhyst_rigs.study.tuning.piezo import PiezoLoop
from anhyst_rigs.study.tuning.result import RESULT_FILES, TunedVariant, Tuning, make_file_note, write_results
from anhyst_rigs.study.tuning.search import GainSearch
from anhyst_rigs.study.tuning.stage import MAX_PERIOD_TICKS, StageLoop
from anhyst_rigs.study.tuning.trial import Tunable


def tune(
    rig: PathLike,
    out: Path,
    controller: PathLike | None,
    aims: Aims,
    *,
    all_variants: bool,
    crossover: float | None,
    budget: int,
    seed: int,
    jobs: int | None,
    progress: Progress | None,
) -> Tuning:
    """Find controller gains for stated aims, for any kind of rig: `anhyst.tune`."""
    if budget < 10:
        raise InputError(
            f"--budget: {budget} sets of gains are too few; enter at least 10",
            code="out-of-range",
            key="--budget",
        )
    kind = require_rig(rig, "tune")
    kind.refuse_options(
        "tune",
        {
            "--controller": controller,
            "--overshoot": aims.overshoot_percent,
            "--average": aims.average_m,
            "--crossover": crossover,
            "--error": aims.error_peak_m,
            "--settling": aims.settling_time_s,
            "--standstill": aims.standstill_rms_m,
            "--effort": aims.current_rate_rms_A_per_s,
        },
    )
    begin_s, used_before_s = time.perf_counter(), _processor_time()
    tuning_kind = require_capability(kind, HasTuning)
    subject = tuning_kind.tuning(rig, controller, crossover)
    aims = subject.with_default_aims(aims)
    variant_names = subject.variants() if all_variants else (subject.main_variant,)
    paths = subject.plan_paths(out, variant_names, tuning_kind.files(rig, controller))
    make_search = partial(GainSearch, aims=aims, budget=budget, seed=seed, jobs=jobs)
    tuned, interrupted = _tune_all(make_search, subject.make_loops(variant_names, jobs), progress)
    out.mkdir(parents=True, exist_ok=True)
    result = Tuning(
        rig=subject.rig,
        controller=subject.controller,
        plant=subject.plant,
        main_variant=subject.main_variant,
        aims=aims,
        budget=budget,
        seed=seed,
        tuned=tuned,
        written={name: paths[name] for name in tuned},
        interrupted=interrupted,
        seconds=time.perf_counter() - begin_s,
        cpu_seconds=_processor_time() - used_before_s,
    )
    for name, path in result.written.items():
        subject.write(tuned[name], path, make_file_note(tuned[name], result))
    write_results(result, out)
    return result


class TuningSubject(ABC):
    """A rig whose controller is tuned, and the files that are written for it."""

    file_stem: str  # stem of the names of the written files
    rig: BodyRig | PiezoRig
    controller: ControllerFile | None = None
    plant: PlantCheck | None = None  # comparison of the plant with the measured loops
    main_variant: MethodName  # variant that is tuned by default

    def with_default_aims(self, aims: Aims) -> Aims:
        """Return aims with the default limits of this kind of rig."""
        return aims

    @abstractmethod
    def variants(self) -> Sequence[MethodName]:
        """Return the names of all variants."""

    @abstractmethod
    def make_loops(self, names: Sequence[MethodName], jobs: int | None) -> Mapping[MethodName, Tunable]:
        """Identify the plant, and return the loops of all variants except impossible ones."""

    def write(self, tuned: TunedVariant, path: Path, note: str) -> None:
        """Write a rig file with the tuned gains, if the rig has no controller file for them."""
        gains = tuned.search_result.loop.gains().items()
        changes: dict[KeyPath, Any] = {("control", name): value for name, value in gains}
        rewrite_rig(self.rig.path, path, changes, note)

    def plan_paths(
        self, folder: Path, names: Sequence[MethodName], reads: Sequence[Path]
    ) -> dict[MethodName, Path]:
        """Return the paths of the output files; raise an error if they cannot be written."""
        files = {name: f"{self.file_stem}{f'-{name}' if len(names) > 1 else ''}.toml" for name in names}
        check_folder_writable(folder)
        for name in (*files.values(), *RESULT_FILES) if folder.is_dir() else ():
            check_writable(folder / name, input_files=reads)
        return {name: folder / file for name, file in files.items()}


class HasTuning(Protocol):
    """A kind of rig whose gains can be tuned."""

    def files(self, rig: PathLike, controller: PathLike | None) -> list[Path]:
        """Return the rig file, and all files that it and a controller file name."""

    def tuning(self, rig: PathLike, controller: PathLike | None, crossover: float | None) -> TuningSubject:
        """Read a rig file, and a controller file or highest crossover (Hz) if the kind accepts it."""


class BearingSubject(TuningSubject):
    """A bearing, for which a controller file is written."""

    file_stem = "controller"
    rig: BodyRig
    controller: ControllerFile

    def __init__(self, rig: PathLike, controller: PathLike | None, _: float | None) -> None:
        self.rig, self.controller = read_files(rig, controller)
        self.main_variant = self.controller.settings.compensation.variant

    def with_default_aims(self, aims: Aims) -> Aims:
        """Return aims with an overshoot limit of 2 %, if no aims are given."""
        return aims if aims.overshoot_percent is not None else replace(aims, overshoot_percent=2.0)

    def variants(self) -> Sequence[MethodName]:
        """Return the names of all variants."""
        return compared_variants(self.rig, self.main_variant)

    def make_loops(self, names: Sequence[MethodName], jobs: int | None) -> Mapping[MethodName, Tunable]:
        """Identify the magnet, and return the loops of the variants."""
        inputs = check_inputs(self.rig, self.controller)
        self.rig, knowledge = inputs.rig, inputs.identify_magnet()
        self.plant = check_plant(inputs.rig, knowledge)
        setups = make_setups(inputs.rig, self.controller, knowledge, tuple(names))
        conditions = default_conditions(inputs.rig)
        return {name: BearingLoop(setup, conditions) for name, setup in setups.items()}

    def write(self, tuned: TunedVariant, path: Path, note: str) -> None:
        """Write a controller file with the tuned gains."""
        assert isinstance(tuned.search_result.loop, BearingLoop)
        settings = tuned.search_result.loop.setup.controller
        changes: dict[str, Any] = {"name": f"tuned, {tuned.variant}"}
        if self.controller.model is not None:
            model = relative_path(path.parent, self.controller.model)
            changes["compensation"] = settings.compensation.model_copy(update={"model": model})
        write_controller(path, settings.model_copy(update=changes), note)


class StageSubject(TuningSubject):
    """A stage, for which a rig file is written."""

    file_stem = "rig"
    main_variant = COMPENSATOR
    rig: BodyRig

    def __init__(self, rig: PathLike, _: PathLike | None, crossover: float | None) -> None:
        self.rig = read_stage(rig)
        check_calibration(self.rig)
        self.max_crossover = math.inf if crossover is None else crossover
        min_crossover = self.rig.settings.timing.rate_Hz / MAX_PERIOD_TICKS
        if not self.max_crossover > min_crossover:
            raise InputError(
                f"--crossover: {self.max_crossover:g} Hz is not above {min_crossover:g} Hz, a thousandth of the "
                "controller's rate; give a higher one",
                code="out-of-range",
                key="--crossover",
            )

    def variants(self) -> Sequence[MethodName]:
        """Return the names of all variants."""
        return [
            name
            for name in COMPARED_METHODS
            if name not in FLUX_PROBE_METHODS or self.rig.settings.flux_sensor is not None
        ]

    def make_loops(self, names: Sequence[MethodName], jobs: int | None) -> Mapping[MethodName, Tunable]:
        """Identify the magnets, and return the loops of the variants."""
        setups, _ = make_variants(self.rig, identify_stage_magnet(self.rig), names)
        scan = self.rig.settings.scan
        find_stage_gains = partial(find_gains, motion=scan_motion(scan, scan.train_m_per_s2))
        feedforwards = map_ordered(find_stage_gains, list(setups.values()), jobs=jobs)
        return {
            name: StageLoop(setup, gains, self.max_crossover)
            for (name, setup), gains in zip(setups.items(), feedforwards, strict=True)
        }


class PiezoSubject(TuningSubject):
    """A piezo stage, for which a rig file is written."""

    file_stem = "rig"
    main_variant = "full"

    def __init__(self, rig: PathLike, _: PathLike | None, __: float | None) -> None:
        self.rig: PiezoRig = read_piezo_rig(rig)

    def variants(self) -> Sequence[MethodName]:
        """Return the names of all variants."""
        return tuple(PIEZO_METHODS)

    def make_loops(self, names: Sequence[MethodName], jobs: int | None) -> Mapping[MethodName, Tunable]:
        """Identify the stack, and return the loops of the variants."""
        inverses = find_inverses(self.rig)
        return {name: PiezoLoop(self.rig, inverses[PIEZO_METHODS[name]]) for name in names}


def _tune_all(
    make_search: Callable[..., GainSearch], loops: Mapping[MethodName, Tunable], progress: Progress | None
) -> tuple[dict[MethodName, TunedVariant], bool]:
    """Tune one variant after another. After ctrl-C, return the completed variants."""
    tuned: dict[MethodName, TunedVariant] = {}
    loop_progress = split_progress(progress, [1.0] * len(loops))
    for (name, loop), progress_part in zip(loops.items(), loop_progress, strict=True):
        gain_search = make_search(loop, progress=progress_part)
        try:
            result = gain_search.run()
            check_result = result.check
            limits = (
                result.loop.find_limits(gain_search.aims, check_result, gain_search.seed, gain_search.jobs)
                if check_result
                else []
            )
            progress_part(1, 1)
        except KeyboardInterrupt:
            if not tuned:
                raise Interrupted("no gains were found yet, nothing was written") from None
            return tuned, True
        tuned[name] = TunedVariant(name, result, tuple(limits), gain_search.aims)
        if result.interrupted:
            return tuned, True
    return tuned, False


def _processor_time() -> float:
    """Return the processor time of this process and its finished children, s."""
    usage = os.times()
    return usage.user + usage.system + usage.children_user + usage.children_system
