"""A stage ready to run: its magnets identified from loops, a method fitted to them and corrected."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial

from anhyst.compensate.force_controller import ForceController
from anhyst.compensate.sources import Operating
from anhyst.data import Loops
from anhyst.support.errors import InputError
from anhyst.support.kinds import MethodName
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.calibration import CENTRE, CalibratedMethod
from anhyst_rigs.rig.drift import NO_DRIFT, Drift
from anhyst_rigs.rig.fitting import IdentifiedMagnet, calibrated, fit_at, identify_rippling
from anhyst_rigs.rig.stage.calibrated import correction
from anhyst_rigs.rig.stage.loop import StageSetup, bias


def identify_stage(rig: BodyRig, loops: Loops | None = None) -> IdentifiedMagnet:
    """Identify what is known of the magnets of a stage, from its loops or others of them."""

    def usable(known: IdentifiedMagnet) -> bool:
        try:
            return bool(fit_method(rig, known, "full"))
        except InputError:
            return False

    return identify_rippling(loops or rig.measured.read(), rig.settings.loops, usable)


def make_stage(
    rig: BodyRig,
    magnet: IdentifiedMagnet,
    method: MethodName,
    calibrated: CalibratedMethod | None = None,
) -> StageSetup:
    """Fit one variant to what is known and put it behind the controller.

    It is corrected by what was found, here or in the file that the rig names.
    """
    learnt = calibrated or rig.learnt(method)
    if learnt is None:
        return StageSetup(rig, fit_method(rig, magnet, method))
    return corrected(rig, cache(partial(fit_method, rig, magnet, method)), learnt)


def corrected(
    rig: BodyRig,
    fitted: Callable[[float], ForceController],
    learnt: CalibratedMethod,
    drift: Drift = NO_DRIFT,
) -> StageSetup:
    """Return a stage whose controller is corrected by what was found of its method.

    Fitted is it for a width of the loop.
    """
    each = tuple(fitted(width) for width in learnt.widths(len(rig.settings.placed)))
    return StageSetup(
        rig,
        each[0],
        drift=drift,
        correction=correction(learnt, each[0], rig),
        own=each,
        body={name: learnt.value(name) for name in ("payload", *CENTRE)},
        cable=learnt.value("cable_N_per_m"),
    )


def fit_method(
    rig: BodyRig, magnet: IdentifiedMagnet, method: MethodName, wider: float = 0.0
) -> ForceController:
    """Fit one variant to what is known of a magnet whose loops are wider by a part."""
    table, measured = rig.settings, [g for g in magnet.loops.by_schedule() if g is not None]
    try:
        operating = Operating(
            gap=rig.gap,
            force=bias(rig, method),
            rate=table.timing.rate_Hz,
            gap_range=(min(measured), max(measured)),
            force_max=table.tracking.force_max_N,
            current_max=table.amplifier.current_high_A,
            both_ways=table.magnet.both_ways,
        )
        known = calibrated(magnet, wider=wider) if wider else magnet
        return fit_at(rig, operating, [known], method, table.tracking.format)[0]
    except InputError as error:
        raise error.at(rig.measured.text) from error
