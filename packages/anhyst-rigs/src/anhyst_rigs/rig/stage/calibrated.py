"""Apply estimated corrections of the magnets and of the body to the controller of a stage."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from anhyst.compensate.force_controller import ForceController
from anhyst.support.kinds import FLUX_PROBE_METHODS
from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.calibration import CENTRE_PARAMETERS, CalibratedMethod, ParameterName

HOLD_TIME_S = 0.02
"""Time for which a force is held so that the eddy currents decay, s."""


def assumed_rig(rig: BodyRig, values: Mapping[ParameterName, float]) -> BodyRig:
    """Return a stage with the mass and the centre of mass that the controller assumes."""
    body, centre_shift = rig.settings.body, [values.get(name, 0.0) for name in CENTRE_PARAMETERS]
    changes = {
        "body.mass_kg": body.mass_kg * (1.0 + values.get("payload", 0.0)),
        "body.centre_m": [
            coordinate + change for coordinate, change in zip(body.centre_m, centre_shift, strict=True)
        ],
    }
    return replace(rig, settings=rig.settings.with_changes(changes))


def correction_rows(calibration: CalibratedMethod, compensator: ForceController, rig: BodyRig) -> FloatArray:
    """Return the corrections of each magnet as one row.

    The columns are the scale of the current, the zero of the gap (m), the scale of the flux
    density, and the lead of the current (s).
    """
    magnet_numbers = range(1, len(rig.settings.body_magnets) + 1)
    scales = np.array([1.0 + calibration.value(f"scale_{number}") for number in magnet_numbers])
    gap_zeros = [calibration.value(f"gap_zero_{number}_m") for number in magnet_numbers]
    unit_scales = np.ones(scales.size)
    rows = np.column_stack([unit_scales, gap_zeros, unit_scales, 0.0 * unit_scales])
    if calibration.name in FLUX_PROBE_METHODS:
        rows[:, 2] = scales
    else:
        rows[:, 0] = scales
        if lag := calibration.value("lag_s"):
            rows[:, 3] = lag / rig.dt * current_per_root_force(compensator, rig)
    return rows


def current_per_root_force(compensator: ForceController, rig: BodyRig) -> float:
    """Return current divided by the root of the force, A/N^(1/2), at half of the largest force."""
    force, compensator_copy = 0.5 * rig.settings.tracking.force_max_N, compensator.reset_copy()
    for _ in range(round(HOLD_TIME_S / rig.dt)):
        compensator_copy.commit(compensator_copy.solve(force, rig.gap), rig.gap)
    return float(compensator_copy.solve(force, rig.gap) / np.sqrt(force))
