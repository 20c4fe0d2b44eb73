"""What a stage's controller may be wrong about: plants that are not what was calibrated."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from anhyst._core import Plant
from anhyst.rig.bearing.file import BearingRig
from anhyst.rig.bearing.plant import make_bearing
from anhyst.rig.iron_table import NamedIron
from anhyst.rig.parts.magnet import iron_magnet
from anhyst.rig.tables import SpreadTable

CUT = 3.0
"""Standard deviations at which the distribution of an error ends."""
_PINNING = ("pinning_scale_A_per_m", "pinning_A_per_m", "coercivity_A_per_m")
"""Key of the loop's width, by family of the iron."""


@dataclass(frozen=True, slots=True)
class CalibrationErrors:
    """How far a plant is from what its controller was made for."""

    gap_zero: float = 0.0  # added to what the gap sensor reads, m
    currents: tuple[float, float] = (0.0, 0.0)  # relative errors of the currents of the two magnets
    pinning: float = 0.0  # of the width of the loop, relative
    hall: float = 0.0  # gain error of the Hall probes
    eddy: float = 0.0  # lag of the flux behind the current that the controller does not know, s


CALIBRATED = CalibrationErrors()
"""Nothing is wrong."""
KINDS = ("gap zero", "current scale", "pinning", "Hall gain", "eddy lag", "all")
"""What is drawn alone, and everything together."""


def draw_errors(table: SpreadTable, kind: str, rng: np.random.Generator) -> CalibrationErrors:
    """Draw a plant; of all errors those of one kind, or all.

    Every error is normal, cut off at three standard deviations; a lag is positive.
    """
    gap, first, second, pinning, hall, eddy = np.clip(rng.standard_normal(6), -CUT, CUT).tolist()
    drawn = CalibrationErrors(
        gap_zero=table.gap_zero_m * gap,
        currents=(0.01 * table.current_percent * first, 0.01 * table.current_percent * second),
        pinning=0.01 * table.pinning_percent * pinning,
        hall=0.01 * table.hall_percent * hall,
        eddy=table.eddy_s * abs(eddy),
    )
    names = {
        "gap zero": "gap_zero",
        "current scale": "currents",
        "pinning": "pinning",
        "Hall gain": "hall",
        "eddy lag": "eddy",
    }
    if kind == "all":
        return drawn
    return replace(CalibrationErrors(), **{names[kind]: getattr(drawn, names[kind])})


def make_mistaken(rig: BearingRig, errors: CalibrationErrors, seed: int) -> Plant:
    """Return the plant of a rig with such errors, at rest."""
    settings = rig.settings
    magnet, steel = settings.magnet, _pinned(settings.steel, errors.pinning).steel()
    first, second = (
        iron_magnet(
            replace(magnet.poles, turns=magnet.poles.turns * (1.0 + error)),
            steel,
            magnet.eddy_time_s + errors.eddy,
            settings.gap_m,
        )
        for error in errors.currents
    )
    sensor, hall = settings.gap_sensor, settings.hall_probe
    wrong = {"gap_sensor.offset_m": sensor.offset_m + errors.gap_zero}
    if hall is not None:
        wrong["hall_probe.gain_error"] = hall.gain_error + errors.hall
    return make_bearing(replace(rig, settings=settings.changed(wrong)), seed, first, second)


def _pinned(iron: NamedIron, error: float) -> NamedIron:
    """Return an iron with a wider loop."""
    key = next(key for key in _PINNING if hasattr(iron, key))
    return iron.model_copy(update={key: (1.0 + error) * getattr(iron, key)})
