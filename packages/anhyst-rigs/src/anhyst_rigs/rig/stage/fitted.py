"""Prepare a stage for a run: identify its magnets, fit its compensators, and apply a calibration."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial

from anhyst.compensate.force_controller import ForceController
from anhyst.compensate.sources import OperatingRange
from anhyst.data import Loops
from anhyst.support.errors import InputError
from anhyst.support.kinds import MethodName
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.calibration import CENTRE_PARAMETERS, CalibratedMethod
from anhyst_rigs.rig.drift import NO_DRIFT, Drift
from anhyst_rigs.rig.fitting import (
    IdentifiedMagnet,
    calibrate_magnet,
    fit_compensators,
    identify_magnet_with_ripple,
)
from anhyst_rigs.rig.stage.calibrated import correction_rows
from anhyst_rigs.rig.stage.loop import StageSetup, bias_force


def identify_stage_magnet(rig: BodyRig, loops: Loops | None = None) -> IdentifiedMagnet:
    """Identify the magnet of a stage from given loops or from the loops of its rig file."""

    def usable(magnet: IdentifiedMagnet) -> bool:
        try:
            return bool(fit_method_compensator(rig, magnet, "full"))
        except InputError:
            return False

    return identify_magnet_with_ripple(loops or rig.measured_loops.read(), rig.settings.loops, usable)


def make_stage(
    rig: BodyRig, magnet: IdentifiedMagnet, method: MethodName, calibrated: CalibratedMethod | None = None
) -> StageSetup:
    """Fit the compensator of a method; apply the given calibration or that of the rig file."""
    calibration = calibrated or rig.method_calibration(method)
    if calibration is None:
        return StageSetup(rig, fit_method_compensator(rig, magnet, method))
    return apply_calibration(rig, cache(partial(fit_method_compensator, rig, magnet, method)), calibration)


def apply_calibration(
    rig: BodyRig,
    fit: Callable[[float], ForceController],
    calibration: CalibratedMethod,
    drift: Drift = NO_DRIFT,
) -> StageSetup:
    """Return a stage whose controller is corrected by a calibration.

    `fit` returns the compensator for a relative change of the loop width.
    """
    compensators = tuple(fit(width) for width in calibration.width_changes(len(rig.settings.body_magnets)))
    return StageSetup(
        rig,
        compensators[0],
        drift=drift,
        correction_rows=correction_rows(calibration, compensators[0], rig),
        own_compensators=compensators,
        body_corrections={name: calibration.value(name) for name in ("payload", *CENTRE_PARAMETERS)},
        cable_stiffness=calibration.value("cable_N_per_m"),
    )


def fit_method_compensator(
    rig: BodyRig, magnet: IdentifiedMagnet, method: MethodName, width_change: float = 0.0
) -> ForceController:
    """Fit the compensator of a method to a magnet with a relative change of its loop width."""
    table, measured_gaps = rig.settings, [gap for gap in magnet.loops.by_schedule() if gap is not None]
    try:
        operating_range = OperatingRange(
            gap=rig.gap,
            force=bias_force(rig, method),
            rate=table.timing.rate_Hz,
            gap_range=(min(measured_gaps), max(measured_gaps)),
            force_max=table.tracking.force_max_N,
            current_max=table.amplifier.current_high_A,
            is_bipolar=table.magnet.is_bidirectional,
        )
        wider_magnet = calibrate_magnet(magnet, width_change=width_change) if width_change else magnet
        return fit_compensators(rig, operating_range, [wider_magnet], method, table.tracking.format)[0]
    except InputError as error:
        raise error.with_location(rig.measured_loops.description) from error
