"""From what is known of a magnet to loops that are ready to run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from anhyst.compensate.force_controller import ForceController
from anhyst.compensate.methods import MODELS
from anhyst.compensate.sources import Operating
from anhyst.control.controller_file import ControllerFile, ControllerTable, error_at_key
from anhyst.data import Loops
from anhyst.model.actuator import Model
from anhyst.rig.bearing.loop import BearingSetup, check_controller, check_position, pair_of
from anhyst.rig.body import BodyRig
from anhyst.rig.fitting import IdentifiedMagnet, calibrated, fit_at
from anhyst.support.errors import InputError
from anhyst.support.kinds import MethodName, NumberFormat


def make_setup(
    rig: BodyRig,
    controller: ControllerTable,
    magnet: IdentifiedMagnet,
    variant: MethodName,
    number_format: NumberFormat,
) -> BearingSetup:
    """Fit one variant to what is known, and to what motion taught of it, behind the controller."""
    magnets = calibrated_magnets(rig, magnet, variant)
    each = fit_magnets(rig, controller, magnets, variant, number_format)
    chosen = controller.compensation.model_copy(
        update={"variant": variant, "format": number_format}
    )
    behind = controller.model_copy(update={"compensation": chosen})
    return BearingSetup(rig, each[0], behind, own=tuple(each) if len(each) > 1 else ())


def fit_magnets(
    rig: BodyRig,
    controller: ControllerTable,
    magnets: Sequence[IdentifiedMagnet],
    variant: MethodName,
    number_format: NumberFormat,
) -> list[ForceController]:
    """Fit one variant to what is known of each magnet."""
    where = operating_point(rig, controller, *(magnet.loops for magnet in magnets))
    return fit_at(rig, where, magnets, variant, number_format)


def calibrated_magnets(
    rig: BodyRig, magnet: IdentifiedMagnet, variant: MethodName
) -> list[IdentifiedMagnet]:
    """Return what is known of each magnet by what motion taught of a variant, or of all at once.

    The second magnet's gap is what is left of both: it is read too small by what the first one's is
    read too large.
    """
    calibration = rig.learnt(variant)
    if calibration is None or not calibration.taken:
        return [magnet]
    widths, zero = calibration.widths(len(rig.magnets)), calibration.value("gap_zero_m")
    # one range of gaps for both of a pair
    over = 2.0 * abs(zero) if len(widths) > 1 else 0.0
    return [
        calibrated(
            magnet, calibration.value(f"scale_{number + 1}"), (zero, -zero)[number], wider, over
        )
        for number, wider in enumerate(widths)
    ]


def compiled_model(rig: BodyRig, magnet: IdentifiedMagnet, variant: MethodName) -> Model:
    """Return the model of which a block is compiled: with what motion taught of it."""
    magnets = calibrated_magnets(rig, magnet, variant)
    if len(magnets) > 1:
        raise InputError(
            f"{rig.path}: control.calibration: both magnets of a pair share one block, and each was "
            "calibrated for itself; leave it out",
            code="calibration-not-compiled",
            key="control.calibration",
        )
    return magnets[0].model


def make_setups(
    rig: BodyRig,
    controller: ControllerFile,
    magnet: IdentifiedMagnet,
    variants: tuple[MethodName, ...],
) -> Mapping[MethodName, BearingSetup]:
    """Fit several variants in the number format of a controller file."""
    check_controller(controller, rig)
    table = controller.settings
    setups = {}
    for variant in variants:
        modelled = variant in MODELS and controller.model is not None
        try:
            setups[variant] = make_setup(rig, table, magnet, variant, table.compensation.format)
        except InputError as error:
            raise error.at(controller.model if modelled else rig.measured.text) from error
        with error_at_key(controller):
            check_position(setups[variant])
    return setups


def operating_point(rig: BodyRig, controller: ControllerTable, *loops: Loops) -> Operating:
    """Return where a bearing works, over all loops: each magnet of a pair around its bias."""
    pair = pair_of(rig)
    measured = [gap for loop in loops for gap in loop.by_schedule() if gap is not None]
    return Operating(
        gap=rig.settings.gap_m,
        force=rig.load if pair is None else pair.bias_force_N,
        rate=controller.rate_Hz,
        gap_range=controller.working_gaps(pair, (min(measured), max(measured))),
        force_max=controller.force_max(pair),
        current_max=controller.limits.current_high_A,
    )
