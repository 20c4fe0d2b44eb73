"""Everything that one loop needs: rig, controller, and a drive that is fitted."""

from __future__ import annotations

from dataclasses import dataclass, replace

from anhyst.compensate.drive import Drive
from anhyst.control.controller_file import (
    ControllerTable,
    Variant,
)
from anhyst.rig.bearing.file import BearingRig


@dataclass(frozen=True)
class Setup:
    """Everything one loop needs; goes to other processes.

    Parameters
    ----------
    rig : BearingRig
        The plant.
    controller : ControllerTable
        Gains, limits, lift-off.
    drive : Drive
        From force to current, as fitted; never run itself.
    """

    rig: BearingRig
    controller: ControllerTable
    drive: Drive

    @property
    def name(self) -> Variant:
        """Of the variant."""
        return self.drive.variant


def with_gains(setup: Setup, controller: ControllerTable) -> Setup:
    """Return the same drive behind another controller of the same limits."""
    return replace(setup, controller=controller)
