"""How the controller of a stage uses what motion taught of its magnets and of its body."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from anhyst.compensate.force_controller import ForceController
from anhyst.support.kinds import PROBED
from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.calibration import CENTRE, CalibratedMethod, ParameterName

HELD_S = 0.02
"""For which a force is held until eddy currents of the iron have died away."""


def believed(rig: BodyRig, values: Mapping[ParameterName, float]) -> BodyRig:
    """Return the stage with the mass and the centre of mass that a controller believes in."""
    body, off = rig.settings.body, [values.get(name, 0.0) for name in CENTRE]
    changes = {
        "body.mass_kg": body.mass_kg * (1.0 + values.get("payload", 0.0)),
        "body.centre_m": [one + by for one, by in zip(body.centre_m, off, strict=True)],
    }
    return replace(rig, settings=rig.settings.changed(changes))


def correction(learnt: CalibratedMethod, compensator: ForceController, rig: BodyRig) -> FloatArray:
    """Return the rows of the controller: scale, gap zero, flux density, lead, a magnet each."""
    count = range(1, len(rig.settings.placed) + 1)
    scales = np.array([1.0 + learnt.value(f"scale_{number}") for number in count])
    zeros = [learnt.value(f"gap_zero_{number}_m") for number in count]
    ones = np.ones(scales.size)
    rows = np.column_stack([ones, zeros, ones, 0.0 * ones])
    if learnt.name in PROBED:
        rows[:, 2] = scales
    else:
        rows[:, 0] = scales
        if lag := learnt.value("lag_s"):
            rows[:, 3] = lag / rig.dt * per_root(compensator, rig)
    return rows


def per_root(compensator: ForceController, rig: BodyRig) -> float:
    """Return the current over the root of the force, A/N^(1/2), at half of the largest force."""
    force, held = 0.5 * rig.settings.tracking.force_max_N, compensator.fresh()
    for _ in range(round(HELD_S / rig.dt)):
        held.commit(held.solve(force, rig.gap), rig.gap)
    return float(held.solve(force, rig.gap) / np.sqrt(force))
