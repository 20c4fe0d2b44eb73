"""Test the measured frequency response of a running loop against the linear loop."""

from __future__ import annotations

import numpy as np

from anhyst.compensate.methods import make_compensator
from anhyst.compensate.sources import Sources
from anhyst_rigs.rig.bearing.loop import BearingSetup, operating_point
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.drift import change_iron, change_rig
from tests.study import bearings

SUBSTEPS = 16
"""Sub-steps of the simulated plant. With the 4 of the example, its amplifier lags by 1.7 us more."""


def linear_setup(rig: BodyRig, bandwidth: float = 120.0) -> BearingSetup:
    """A bearing with an iron without hysteresis, and constants as compensation, which are linear."""
    rig = change_iron(change_rig(rig, {"timing.substeps": SUBSTEPS}), 1.0)
    table, settings = bearings.controller().settings, rig.settings
    assert table.design is not None
    design = table.design.model_copy(update={"mass_kg": settings.body.mass_kg, "bandwidth_Hz": bandwidth})
    controller = table.model_copy(update={"design": design, "rate_Hz": settings.timing.rate_Hz})
    loops = bearings.knowledge().loops
    known = operating_point(rig, controller, loops)
    return BearingSetup(rig, make_compensator("linearised", Sources(known, loops), "fixed"), controller)


def drawn_setup(number: int) -> BearingSetup:
    """A bearing with a drawn mass, gap, rate and controller bandwidth."""
    rng = np.random.default_rng([54, number])
    rates = [12_000.0, 16_000.0, 20_000.0, 25_000.0]
    changes = {
        "body.mass_kg": float(rng.uniform(1.0, 4.0)),
        "gap_m": float(rng.uniform(0.42e-3, 0.48e-3)),
        "timing.rate_Hz": float(rng.choice(rates)),
    }
    return linear_setup(change_rig(bearings.example(), changes), float(rng.uniform(90.0, 130.0)))


# TESTS
