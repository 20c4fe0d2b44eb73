"""The position controller that goes into an output folder beside the compensator."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from anhyst._core import FixedForceController, FixedPosition
from anhyst.compensate.bearing import bearing_model
from anhyst.compensate.block import Block, Scales
from anhyst.compensate.current_map import CurrentMap, plain_map
from anhyst.compensate.plan import CompileRequest, Plan
from anhyst.control.controller_file import (
    ControllerFile,
    ControllerTable,
    error_at_key,
    read_controller,
)
from anhyst.control.position import PositionControl, Settings
from anhyst.model.actuator import Model
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError
from anhyst.support.toml_file import FileFault, faults_error

BEYOND = 1.01
"""Largest current of a controller, by the largest that was measured; as much for noise."""


@dataclass(frozen=True)
class Controller:
    """A controller file, read and found to fit what is asked for."""

    file: ControllerFile  # where it stands, and what it says

    @property
    def table(self) -> ControllerTable:
        """What the file says."""
        return self.file.settings

    @property
    def magnets(self) -> int:
        """One, or two that pull against each other."""
        return 1 if self.table.pair is None else 2

    @property
    def sha256(self) -> str:
        """Of the file."""
        return hashlib.sha256(self.file.path.read_bytes()).hexdigest()

    def narrowed(self, model: Model) -> Model:
        """Return the model for forces, currents and gaps of this controller alone."""
        table = self.table
        seen = None if model.valid is None else model.valid.schedule
        limits = table.limits.gap_low_m, table.limits.gap_high_m
        gaps = limits if seen is None else table.working_gaps(table.pair, seen)
        force_max = table.force_max(table.pair)
        return bearing_model(model, (0.0, table.limits.current_high_A), (0.0, force_max), gaps)

    def check_current(self, model: Model) -> None:
        """Refuse currents that the model was never seen at."""
        highest = self.table.limits.current_high_A
        if model.valid is not None and highest > BEYOND * model.valid.input[1]:
            seen = model.valid.input[1]
            text = f"the model was seen up to {seen:g} A; lower it, or measure further"
            raise faults_error(
                self.file.path, [FileFault(("limits", "current_high_A"), text, code="beyond-model")]
            )

    def around(self, plan: Plan) -> ControllerPlan:
        """Return the controller around the compensator of a plan."""
        table = self.table
        assert isinstance(plan.block, Block)
        with error_at_key(self.file):
            control = table.position_control(
                plan.block.scales, table.converter_of_currents(), table.pair
            )
            control.gains("fixed")
            settings = control.settings("fixed")
        block = plan.block.scales
        scales = Scales(block.demand, settings["current_full"], block.gap_low, block.gap_high)
        return ControllerPlan(self, control, plan.block, settings, plain_map(plan.model, scales))


@dataclass(frozen=True)
class ControllerPlan:
    """A position controller in fixed point."""

    source: Controller  # what it was made from
    control: PositionControl  # in SI units
    block: Block  # of the compensator
    settings: Settings  # as the core takes them, by name
    plain: CurrentMap  # drives while the compensation is switched off

    @property
    def magnets(self) -> int:
        """How many compensators it has."""
        return self.source.magnets

    @property
    def gains(self) -> NDArray[np.int32]:
        """Words of the gains, as the core takes them."""
        return np.asarray(self.control.gains("fixed"), dtype=np.int32)

    def start(self) -> FixedPosition:
        """Return the very controller, just switched on, with compensators that remember nothing."""
        compensators = [
            FixedForceController.compensator(self.block.kind, self.block.words)
            for _ in range(self.magnets)
        ]
        return FixedPosition(self.gains, compensators, dict(self.settings))


def read_fitting(path: PathLike, request: CompileRequest, model_path: PathLike) -> Controller:
    """Read a controller file for a folder."""
    file = read_controller(path)
    faults = [*_faults(file.settings, request), *_model_faults(file, model_path)]
    if faults:
        raise faults_error(file.path, faults)
    _check_format(file.settings, request)
    return Controller(file)


def _faults(table: ControllerTable, request: CompileRequest) -> list[FileFault]:
    chosen = table.compensation
    faults: list[FileFault] = []
    if table.rate_Hz != request.rate:
        text = f"is {table.rate_Hz:g} Hz here and {request.rate:g} Hz in --rate; make them equal"
        faults.append(FileFault(("rate_Hz",), text, code="option-differs"))
    if chosen.variant not in ("full", "simplified"):  # the others exist to be compared with
        text = f'"{chosen.variant}" is for comparison in simulations; write "full" or "simplified"'
        faults.append(FileFault(("compensation", "variant"), text, code="not-compilable"))
    elif chosen.variant != request.kind:
        text = f'is "{chosen.variant}" here and {request.kind} in --kind; make them equal'
        faults.append(FileFault(("compensation", "variant"), text, code="option-differs"))
    if chosen.format != "fixed":
        text = f'"{chosen.format}" is for simulations; write "fixed", which goes with --io q31'
        faults.append(FileFault(("compensation", "format"), text, code="not-compilable"))
    if table.pair is None and table.limits.force_low_N < 0.0:
        text = "a single magnet cannot push; raise it to 0, or describe the second in [pair]"
        faults.append(FileFault(("limits", "force_low_N"), text, code="cannot-push"))
    return faults


def _model_faults(file: ControllerFile, model_path: PathLike) -> list[FileFault]:
    """Refuse another model than the one that the controller file names."""
    if file.model is None:
        return []
    try:
        same = file.model.read_bytes() == Path(model_path).read_bytes()
    except OSError as error:
        text = f"{error.filename}: {error.strerror}; name the model file that is compiled"
    else:
        text = "" if same else f"is not {model_path}; compile the model that is named here"
    return [FileFault(("compensation", "model"), text, code="model-differs")] if text else []


def _check_format(table: ControllerTable, request: CompileRequest) -> None:
    """Refuse what cannot carry a position."""
    if request.io == "q15":
        limits = table.limits
        step = 1.25 * (limits.gap_high_m - limits.gap_low_m) / 2**16
        speed = step * table.rate_Hz
        raise InputError(
            f"--io: in q15 a gap has steps of {1e9 * step:.2g} nm and its speed of "
            f"{1e3 * speed:.2g} mm/s, too coarse to control it; give q31",
            code="format-too-coarse",
            key="--io",
        )
    if request.io != "q31":
        raise InputError(
            f"--io: {request.io} is not for a position controller, which is compiled in fixed "
            "point; give q31",
            code="option-not-for-this",
            key="--io",
        )
