"""Define the data that a bench needs before it is opened: setups, models and firmware."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

from anhyst.compensate.block import Block, DemandLimits, Kind
from anhyst.compensate.current_map import fit_ratio
from anhyst.compensate.force_controller import ForceController
from anhyst.compensate.methods import HysteresisInverse, restrict_model
from anhyst.compensate.plan import CompileRequest, Plan, make_plan
from anhyst.compilation.controller import MAX_CURRENT_RATIO
from anhyst.data import Loops
from anhyst.model.actuator import Model
from anhyst.support.block_words import Scales
from anhyst.support.errors import InputError
from anhyst.support.jobs import Progress
from anhyst_rigs.rig.bearing.loop import BearingSetup, pair_table
from anhyst_rigs.rig.bench.bearing import BearingBench
from anhyst_rigs.rig.bench.force import ForceBench
from anhyst_rigs.rig.bench.piezo import PiezoBench
from anhyst_rigs.rig.bench.stage import StageBench
from anhyst_rigs.rig.fitting import IdentifiedMagnet
from anhyst_rigs.rig.force.file import ForceControlRig
from anhyst_rigs.rig.force.programs import Program, identify_force_model, loops_at_gap
from anhyst_rigs.rig.measurement_table import identify_loops
from anhyst_rigs.rig.piezo import PiezoRig
from anhyst_rigs.rig.stage.loop import Feedforward, StageSetup
from anhyst_rigs.study.excite.design import Specimen, bearing_specimen, force_specimen
from anhyst_rigs.study.tracking.online_calibration import BearingCalibrator, StageCalibrator

_GAP_TOLERANCE_TO_RANGE = 1e-6
"""Permitted distance of the measured gaps from a board's gap limits, relative to its gap range."""


@dataclass(frozen=True)
class PreparedBearing:
    """A bearing with its controller and the firmware."""

    setup: BearingSetup  # active setup, in fixed point
    model: Model  # hysteresis model in the compiled program
    firmware: Path  # path of the firmware for the board ``library``; needed until the bench is open

    @property
    def rig(self) -> Path:
        """The path of the rig file."""
        return self.setup.rig.path

    @property
    def has_single_magnet(self) -> bool:
        """Whether the bearing has one magnet."""
        return len(self.setup.rig.settings.body_magnets) == 1

    @property
    def measured_loops(self) -> Loops:
        """Measured loops that the rig file names."""
        return self.setup.rig.measured_loops.read()

    def with_firmware(self, firmware: Path) -> PreparedBearing:
        """Return a copy whose firmware has another path."""
        return replace(self, firmware=firmware)

    def open(self) -> BearingBench:
        """Open the bench at rest, before its first tick. The caller must close it."""
        return BearingBench(self.setup, self.firmware)

    @property
    def improvable(self) -> PreparedBearing:
        """Object whose model can be improved: the bearing itself."""
        return self

    def open_with_learner(self) -> tuple[BearingBench, BearingCalibrator]:
        """Open the bench, and return it with an online calibration from its motions."""
        bench, knowledge = self.open(), IdentifiedMagnet(self.measured_loops, self.model)
        return bench, BearingCalibrator(self.setup, knowledge, self.compile_words, bench)

    def specimen(self) -> Specimen:
        """Return the magnet for a measurement with a held armature."""
        return bearing_specimen(self.setup.rig)

    def identify(self, loops: Loops, progress: Progress | None = None) -> Model:
        """Identify a model from loops with the options of the rig file."""
        return identify_loops(loops, self.setup.rig.settings.loops, "circuit", progress)

    def compile(self, model: Model) -> Plan:
        """Return the plan of another model for the running board."""
        active_model = self.setup.compensator.parameters
        variant = self.setup.method
        if not isinstance(active_model, HysteresisInverse) or variant not in {"full", "simplified"}:
            raise InputError(
                f"the controller runs without a model ('{variant}'), so there is no model to replace",
                code="no-model",
            )
        controller_table, scales = self.setup.controller, active_model.scales
        gaps = scales.gap_low, scales.gap_high
        current = controller_table.limits.current_high_A
        force = controller_table.force_max(pair_table(self.setup.rig))
        if model.valid is not None and current > MAX_CURRENT_RATIO * model.valid.input[1]:
            raise InputError(
                f"model: was measured up to {model.valid.input[1]:g} A, the controller drives up to "
                f"{current:g} A; measure up to this current",
                code="currents-not-covered",
                key="model",
            )
        request = CompileRequest(
            "simplified" if variant == "simplified" else "full", "q31", controller_table.rate_Hz
        )
        board_model = _adapt_to_board(model, self.model, request.kind)
        bounded_model = restrict_model(board_model, (0.0, current), (0.0, force), gaps)
        return make_plan(bounded_model, request, 0, scales=scales)

    def compile_words(self, model: Model) -> list[int]:
        """Return the parameter block of another model for the running board."""
        return [int(word) for word in fixed_point_block(self.compile(model)).words]


@dataclass(frozen=True)
class ForceRig:
    """An actuator whose force is controlled."""

    complete_rig: ForceControlRig  # rig with a complete magnet
    measured_loops: Loops  # loops that the rig file names

    has_single_magnet: ClassVar[bool] = True

    @property
    def rig(self) -> Path:
        """The path of the rig file."""
        return self.complete_rig.path

    def specimen(self) -> Specimen:
        """Return the actuator for a measurement with a held armature."""
        return force_specimen(self.complete_rig)

    def identify(self, loops: Loops, progress: Progress | None = None) -> Model:
        """Identify a model from loops with the options of the rig file."""
        return identify_force_model(self.complete_rig, loops, progress)


@dataclass(frozen=True)
class PreparedForce(ForceRig):
    """An actuator, and the firmware that controls its force."""

    # program with model, block and firmware; the firmware is needed until the bench is open
    program: Program

    @property
    def model(self) -> Model:
        """The hysteresis model in the compiled program."""
        return self.program.model

    @property
    def firmware(self) -> Path:
        """The firmware for the board ``library``."""
        return self.program.firmware

    def with_firmware(self, firmware: Path) -> PreparedForce:
        """Return a copy whose firmware has another path."""
        return replace(self, program=replace(self.program, firmware=firmware))

    def open(self) -> ForceBench:
        """Open the bench at rest, before its first tick. The caller must close it."""
        bench = ForceBench(self.complete_rig, self.program)
        settings = self.complete_rig.settings.force
        current_per_force = fit_ratio(loops_at_gap(self.measured_loops, settings.end_m), settings.force_max_N)
        bench.apply({"ratio": 1.0 / float(current_per_force.ratio[0])})
        return bench

    @property
    def improvable(self) -> PreparedForce:
        """Object whose model can be improved: the actuator itself."""
        return self

    def open_with_learner(self) -> tuple[ForceBench, None]:
        """Open the bench without calibration, because a held armature does not accelerate."""
        return self.open(), None

    def compile(self, model: Model) -> Plan:
        """Return the plan of another model for the running board."""
        request = CompileRequest(self.program.kind, "q31", self.complete_rig.settings.timing.rate_Hz)
        board_model = _adapt_to_board(model, self.model, request.kind)
        return _make_force_plan(board_model, request, self.program.scales, self.program.block.limits)


@dataclass(frozen=True)
class PreparedBoard(ForceRig):
    """An actuator with a stand-alone controller, and the data with which it was compiled."""

    model: Model  # hysteresis model in the compiled controller
    request: CompileRequest
    scales: Scales
    limits: DemandLimits  # limits of the controller

    def compile(self, model: Model) -> Plan:
        """Return the plan of another model for the running board."""
        gap_low, gap_high = self.scales.gap_low, self.scales.gap_high
        if gap_low < gap_high and not model.needs_schedule:
            raise InputError(
                f"model: is valid at one gap, the board works from {gap_low:g} to {gap_high:g} m; identify a "
                "model from loops at several gaps and build the firmware with it",
                code="single-gap",
                key="model",
            )
        board_model = _adapt_to_board(model, self.model, self.request.kind)
        return _make_force_plan(board_model, self.request, self.scales, self.limits)


@dataclass(frozen=True)
class PreparedStage:
    """A stage with its identified magnets, and its setups with their gains."""

    magnet: IdentifiedMagnet
    setups: tuple[StageSetup, ...]  # inverses: single-valued, and with the compensator
    gains: tuple[Feedforward, ...]  # feedforward gains of each setup

    firmware = None
    improvable = None

    def open(self) -> StageBench:
        """Open the bench at rest, before its first tick. The caller must close it."""
        return StageBench(self.setups, self.gains)

    def open_with_learner(self) -> tuple[StageBench, StageCalibrator]:
        """Open the bench, and return it with an online calibration from its motions."""
        bench = self.open()
        return bench, StageCalibrator(self.magnet, bench)


@dataclass(frozen=True)
class PreparedPiezo:
    """A piezo stage with two inverses: single-valued and with hysteresis."""

    rig: PiezoRig
    inverses: tuple[ForceController, ForceController]

    firmware = None
    improvable = None

    def open(self) -> PiezoBench:
        """Open the bench at rest, before its first tick. The caller must close it."""
        return PiezoBench(self.rig, self.inverses)

    def open_with_learner(self) -> tuple[PiezoBench, None]:
        """Open the bench without calibration, because a piezo stage has no magnets."""
        return self.open(), None


Prepared = PreparedBearing | PreparedForce | PreparedStage | PreparedPiezo
"""Data for the opening of a virtual bench."""

Improvable = PreparedBearing | PreparedForce | PreparedBoard
"""Object whose model can be improved."""


def fixed_point_block(plan: Plan) -> Block:
    """Return the fixed-point parameters of a plan."""
    assert isinstance(plan.block, Block)
    return plan.block


def _adapt_to_board(model: Model, active_model: Model, kind: Kind) -> Model:
    """Return a model that a board can compute. Layers remain only if the board has their states."""
    if kind != "full" or active_model.layers is None or not active_model.has_layers:
        return model.at_rest
    if not model.has_layers:
        raise InputError(
            "model: has no eddy-current layers, which the controller needs; measure at several "
            "speeds (measurement.fast_A_per_s)",
            code="rate-not-measured",
            key="model",
        )
    assert model.layers is not None
    if model.layers.state_copies > active_model.layers.state_copies:
        raise InputError(
            f"model: {model.layers.state_copies} hysteresis states, the controller has room for "
            f"{active_model.layers.state_copies}; build the firmware with this model",
            code="too-many-layers",
            key="model",
        )
    return model


def _make_force_plan(model: Model, request: CompileRequest, scales: Scales, limits: DemandLimits) -> Plan:
    """Plan a force model for the signals and the limits of a board."""
    valid_range = replace(
        model.valid_range,
        input=_intersect_ranges(model.valid_range.input, limits.current),
        output=_intersect_ranges(model.valid_range.output, limits.demand),
        schedule=_covered_gaps(model, scales),
    )
    return make_plan(replace(model, valid=valid_range), request, 0, scales=scales)


def _intersect_ranges(
    model_range: tuple[float, float], board_range: tuple[float, float]
) -> tuple[float, float]:
    return max(model_range[0], board_range[0]), min(model_range[1], board_range[1])


def _covered_gaps(model: Model, scales: Scales) -> tuple[float, float] | None:
    """Return the gap range of a board; raise an error if the model does not cover it."""
    if not model.needs_schedule:
        return None if model.valid is None else model.valid.schedule
    gap_low, gap_high = scales.gap_low, scales.gap_high
    model_gaps = None if model.valid is None else model.valid.schedule
    tolerance = _GAP_TOLERANCE_TO_RANGE * (gap_high - gap_low)
    if model_gaps is None or model_gaps[0] > gap_low + tolerance or model_gaps[1] < gap_high - tolerance:
        known_text = "no gap" if model_gaps is None else f"gaps of {model_gaps[0]:g} to {model_gaps[1]:g} m"
        raise InputError(
            f"model: is valid at {known_text}, the board works from {gap_low:g} to {gap_high:g} m; measure loops "
            "at both ends",
            code="gaps-not-covered",
            key="model",
        )
    return gap_low, gap_high
