"""Everything that one loop needs: rig, controller, and a compensator that is fitted."""

from __future__ import annotations

from dataclasses import dataclass, replace

from anhyst.compensate.force_controller import ForceController
from anhyst.compensate.interface import MethodName
from anhyst.control.controller_file import ControllerTable
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
