"""Everything that one loop needs: rig, controller, and a compensator that is fitted."""

from __future__ import annotations

from dataclasses import dataclass, replace

from anhyst._core import FixedPosition, LoopController, Position, PositionF32
from anhyst.compensate.force_controller import ForceController
from anhyst.compensate.interface import MethodName
from anhyst.control.controller_file import ControllerTable
from anhyst.control.position import PositionControl, ReferenceConverter
from anhyst.rig.bearing.controller_check import pair_of
from anhyst.rig.bearing.file import BearingRig


@dataclass(frozen=True)
class Setup:
    """Everything one loop needs; goes to other processes."""

    rig: BearingRig  # the plant
    controller: ControllerTable  # gains, limits, lift-off
    compensator: ForceController  # from force to current, as fitted; never run itself

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
    natives = [setup.compensator.fresh().native for _ in setup.rig.magnets]
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
