"""A bearing and its controller in lock-step: runs scenarios."""

from __future__ import annotations

import numpy as np

from anhyst._core import Plant, PlantLoop
from anhyst.rig.bearing.file import BearingRig
from anhyst.rig.bearing.plant import current_loops, make_bearing
from anhyst.rig.bearing.recording import DESCEND, FAULT, RISE, Recording, in_columns
from anhyst.rig.bearing.scenario import Scenario
from anhyst.rig.bearing.setup import Setup, make_position
from anhyst.rig.holding import SignalBound, find_loss


class SimulatedLoop:
    """One run of a setup, from power on; scenarios follow each other."""

    def __init__(
        self,
        setup: Setup,
        seed: int = 0,
        largest_first: bool = False,
        bearing: Plant | None = None,
    ) -> None:
        self.setup = setup
        rig = setup.rig
        bearing = bearing or make_bearing(rig, seed)
        if largest_first:
            for magnet in range(len(rig.magnets)):
                for current in (rig.settings.amplifier.current_high_A, 0.0):
                    bearing.hold(current, magnet)
        self._loop = PlantLoop(bearing, make_position(setup), current_loops(rig))

    def run(self, scenario: Scenario) -> Recording:
        """Go on with a scenario."""
        table = self._loop.run(
            scenario.target, scenario.load, scenario.inject, scenario.feed, scenario.command
        )
        return Recording(in_columns(self._loop, table))


def lost_at(rig: BearingRig, recording: Recording, since: int = 0) -> float | None:
    """Return when levitation was lost: a stop was touched, or the controller gave up."""
    body = rig.settings.body
    fault = recording["state"] >= FAULT
    if fault.any():
        since = min(since, int(np.argmax(fault)))
    gap, state = recording["gap_m"][since:], recording["state"][since:]
    bounds = (
        SignalBound("an end stop was reached", gap, body.stop_low_m, body.stop_high_m),
        SignalBound("the controller gave up", state, RISE - 1, DESCEND + 1),
    )
    loss = find_loss(bounds, planned=len(gap))
    return None if loss is None else float(recording["t_s"][since + loss.tick])
