"""A bearing and its controller in lock-step: runs scenarios."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from anhyst._core import FixedPosition, LoopController, Plant, PlantLoop, Position, PositionF32
from anhyst.compensate.force_controller import ForceController
from anhyst.compensate.interface import MethodName
from anhyst.control.controller_file import ControllerTable
from anhyst.control.position import PositionControl, ReferenceConverter
from anhyst.rig.bearing.controller_check import pair_of
from anhyst.rig.bearing.file import BearingRig
from anhyst.rig.bearing.plant import current_loops, make_bearing
from anhyst.rig.bearing.scenario import Scenario
from anhyst.rig.recording import DESCEND, FAULT, RISE, Recording, SignalBound, find_loss, in_columns


@dataclass(frozen=True)
class Setup:
    """Everything one loop needs; goes to other processes."""

    rig: BearingRig  # the plant
    controller: ControllerTable  # gains, limits, lift-off
    compensator: ForceController  # from force to current, as fitted; never run itself
    own: tuple[ForceController, ...] = ()  # of each magnet, where they are not all the same

    @property
    def name(self) -> MethodName:
        """Of its method."""
        return self.compensator.method


def with_gains(setup: Setup, controller: ControllerTable) -> Setup:
    """Return the same compensator behind another controller of the same limits."""
    return replace(setup, controller=controller)


_CLASSES = {"f64": Position, "f32": PositionF32, "fixed": FixedPosition}


def make_position(setup: Setup) -> LoopController:
    """Return the controller of a setup, just switched on, with compensators that remember nothing."""
    number_format = setup.compensator.format
    control = position_control(setup)
    each = setup.own or (setup.compensator,) * len(setup.rig.magnets)
    natives = [one.fresh().native for one in each]
    controller: LoopController = _CLASSES[number_format](
        control.gains(number_format), natives, dict(control.settings(number_format))
    )
    return controller


def check_position(setup: Setup) -> None:
    """Refuse a controller that does not fit its compensator or its number format."""
    control = position_control(setup)
    control.gains(setup.compensator.format)
    control.settings(setup.compensator.format)


def position_control(setup: Setup) -> PositionControl:
    """Return the controller of a setup in SI units."""
    amplifier, parameters = setup.rig.settings.amplifier, setup.compensator.parameters
    return setup.controller.position_control(
        parameters.scales,
        ReferenceConverter(amplifier.current_low_A, amplifier.current_high_A, amplifier.dac_bits),
        pair_of(setup.rig),
        parameters.flux_full_scale,
    )


class SimulatedLoop:
    """One run of a setup, from power on; scenarios follow each other."""

    def __init__(
        self, setup: Setup, seed: int = 0, largest_first: bool = False, bearing: Plant | None = None
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
        return Recording.of_table(in_columns(self._loop, table))


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
