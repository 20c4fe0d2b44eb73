"""From what is known of a stage's magnets to runs of every variant."""

from __future__ import annotations

from anhyst.compensate.interface import MethodName
from anhyst.compensate.methods import make_compensator
from anhyst.compensate.sources import Operating, Sources
from anhyst.rig.bearing.make_setup import IdentifiedMagnet, calibrate_probe
from anhyst.rig.stage.file import StageRig
from anhyst.rig.stage.loop import StageSetup, bias
from anhyst.support.errors import InputError


def make_stage(rig: StageRig, magnet: IdentifiedMagnet, method: MethodName) -> StageSetup:
    """Fit one variant to what is known and put it behind the controller."""
    table, measured = rig.settings, [g for g in magnet.loops.by_schedule() if g is not None]
    try:
        operating = Operating(
            gap=rig.gap,
            force=bias(rig, method),
            rate=table.timing.rate_Hz,
            gap_range=(min(measured), max(measured)),
            force_max=table.tracking.force_max_N,
            current_max=table.amplifier.current_high_A,
        )
        probe = calibrate_probe(rig.bearing) if method == "flux" else None
        sources = Sources(operating, magnet.loops, magnet.model, probe)
        compensator = make_compensator(method, sources, table.tracking.format)
    except InputError as error:
        raise error.at(rig.measured.text) from error
    return StageSetup(rig, compensator)
