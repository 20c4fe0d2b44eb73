"""Build the setup of a bearing: fit compensators and combine them with a controller."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from anhyst._core import FixedPosition, LoopController, Position, PositionF32
from anhyst.compensate.force_controller import ForceController
from anhyst.compensate.methods import MODEL_METHODS
from anhyst.compensate.sources import OperatingRange
from anhyst.control.controller_file import ControllerFile, ControllerTable, PairTable, error_at_key
from anhyst.control.position import PositionControl, ReferenceConverter
from anhyst.data import Loops
from anhyst.model.actuator import Model
from anhyst.support.errors import InputError
from anhyst.support.kinds import MethodName, NumberFormat
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.fitting import IdentifiedMagnet, calibrate_magnet, fit_compensators
from anhyst_rigs.rig.loop import Setup
from anhyst_rigs.rig.recording import COLUMNS


def pair_table(rig: BodyRig) -> PairTable | None:
    """Return the parameters of a pair of magnets for the controller; None for a single magnet."""
    bias_force, total_gap = rig.settings.bias_N, rig.settings.gap_total_m
    if bias_force is None or total_gap is None:
        return None
    return PairTable(bias_force_N=bias_force, gap_total_m=total_gap)


_CONTROLLER_CLASSES = {"f64": Position, "f32": PositionF32, "fixed": FixedPosition}


@dataclass(frozen=True)
class BearingSetup(Setup):
    """Everything that a run of a bearing needs."""

    recorded_columns = COLUMNS
    controller: ControllerTable  # gains, limits and lift-off settings

    @cached_property
    def position_control(self) -> PositionControl:
        """Position controller in SI units."""
        amplifier, parameters = self.rig.settings.amplifier, self.compensator.parameters
        return self.controller.position_control(
            parameters.scales,
            ReferenceConverter(amplifier.current_low_A, amplifier.current_high_A, amplifier.dac_bits),
            pair_table(self.rig),
            parameters.flux_full_scale,
        )

    def make_controller(self, drives: Sequence[ForceController] = ()) -> LoopController:
        """Return the controller in its state after power-on."""
        number_format, control = self.compensator.format, self.position_control
        natives = [drive.native for drive in drives or self.make_compensators()]
        controller: LoopController = _CONTROLLER_CLASSES[number_format](
            control.gains(number_format), natives, dict(control.settings(number_format))
        )
        return controller


def make_setup(
    rig: BodyRig,
    controller: ControllerTable,
    magnet: IdentifiedMagnet,
    variant: MethodName,
    number_format: NumberFormat,
) -> BearingSetup:
    """Fit the compensators of a variant with the calibration of the rig; add a controller."""
    magnets = calibrated_magnets(rig, magnet, variant)
    compensators = fit_bearing_compensators(rig, controller, magnets, variant, number_format)
    compensation = controller.compensation.model_copy(update={"variant": variant, "format": number_format})
    table = controller.model_copy(update={"compensation": compensation})
    return BearingSetup(
        rig, compensators[0], table, own_compensators=tuple(compensators) if len(compensators) > 1 else ()
    )


def fit_bearing_compensators(
    rig: BodyRig,
    controller: ControllerTable,
    magnets: Sequence[IdentifiedMagnet],
    variant: MethodName,
    number_format: NumberFormat,
) -> list[ForceController]:
    """Fit the compensator of a variant to each magnet."""
    point = operating_point(rig, controller, *(magnet.loops for magnet in magnets))
    commits_readings = controller.compensation.applied == "measured"
    return fit_compensators(rig, point, magnets, variant, number_format, commits_readings)


def calibrated_magnets(rig: BodyRig, magnet: IdentifiedMagnet, variant: MethodName) -> list[IdentifiedMagnet]:
    """Return each magnet corrected by the calibration of a variant, or one uncorrected magnet.

    The gap of the second magnet is the sum of both gaps minus the gap of the first magnet.
    Therefore, its zero error has the opposite sign.
    """
    calibration = rig.method_calibration(variant)
    if calibration is None or not calibration.is_applied:
        return [magnet]
    width_changes = calibration.width_changes(len(rig.settings.body_magnets))
    gap_zero = calibration.value("gap_zero_m")
    # The compensators of both magnets of a pair cover the same range of gaps.
    gap_margin = 2.0 * abs(gap_zero) if len(width_changes) > 1 else 0.0
    return [
        calibrate_magnet(
            magnet,
            calibration.value(f"scale_{number + 1}"),
            (gap_zero, -gap_zero)[number],
            width_change,
            gap_margin,
        )
        for number, width_change in enumerate(width_changes)
    ]


def model_to_compile(rig: BodyRig, magnet: IdentifiedMagnet, variant: MethodName) -> Model:
    """Return the model for the parameter block, corrected by the calibration of a variant."""
    magnets = calibrated_magnets(rig, magnet, variant)
    if len(magnets) > 1:
        raise InputError(
            f"{rig.path}: control.calibration: both magnets of a pair share one block, but each "
            "was calibrated separately; omit it",
            code="calibration-not-compiled",
            key="control.calibration",
        )
    return magnets[0].model


def make_setups(
    rig: BodyRig, controller: ControllerFile, magnet: IdentifiedMagnet, variants: tuple[MethodName, ...]
) -> Mapping[MethodName, BearingSetup]:
    """Make the setups of several variants in the number format of a matching controller file."""
    table = controller.settings
    setups = {}
    for variant in variants:
        has_model = variant in MODEL_METHODS and controller.model is not None
        try:
            setups[variant] = make_setup(rig, table, magnet, variant, table.compensation.format)
        except InputError as error:
            raise error.with_location(
                controller.model if has_model else rig.measured_loops.description
            ) from error
        with error_at_key(controller):  # gains that do not suit the compensator or its format
            control = setups[variant].position_control
            control.gains(table.compensation.format)
            control.settings(table.compensation.format)
    return setups


def operating_point(rig: BodyRig, controller: ControllerTable, *loops: Loops) -> OperatingRange:
    """Return the operating point and the ranges of a bearing; for a pair, at its bias force."""
    pair_parameters = pair_table(rig)
    measured_gaps = [gap for loop in loops for gap in loop.by_schedule() if gap is not None]
    return OperatingRange(
        gap=rig.settings.gap_m,
        force=rig.static_load if pair_parameters is None else pair_parameters.bias_force_N,
        rate=controller.rate_Hz,
        gap_range=controller.working_gaps(pair_parameters, (min(measured_gaps), max(measured_gaps))),
        force_max=controller.force_max(pair_parameters),
        current_max=controller.limits.current_high_A,
    )
