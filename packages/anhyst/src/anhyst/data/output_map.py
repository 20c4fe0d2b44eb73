"""Relation between the flux density of the iron and each output quantity.

An output is ``c_out * B**power + out_0``. `OUTPUT_MAPS` states the power and other properties of
each quantity, such as whether it has a natural zero. `full_scale` defines the reference of all
relative errors.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from anhyst.support.numeric import FloatArray
from anhyst.support.units import QUANTITIES, Quantity, choose_display_unit


@dataclass(frozen=True, slots=True)
class OutputMap:
    """Properties of an output quantity, ``c_out * B**power + out_0``."""

    quantity: str  # name of the output quantity
    # power of the flux density
    power: int = 1
    # whether the output grows with the flux of the iron, so that the area of its loop is an
    # energy
    is_flux_based: bool = False
    is_flux_density: bool = False  # whether the output is the flux density itself, ``c_out = 1``
    # whether the output has a natural zero; otherwise deviations refer to its range
    has_natural_zero: bool = True
    # whether an active material without iron gives the output, with lag and creep
    has_creep: bool = False
    # name of the quantity if a current or a field drives it and the name differs
    magnetised_name: str = ""

    @property
    def is_even(self) -> bool:
        """Whether the output is the same for both signs of the flux density."""
        return self.power % 2 == 0

    def shape(self, flux_density: FloatArray) -> FloatArray:
        """Return the flux density to the power of the output."""
        return flux_density * flux_density if self.power == 2 else flux_density**self.power


OUTPUT_MAPS = {
    entry.quantity: entry
    for entry in (
        OutputMap("force", power=2, is_flux_based=True),
        OutputMap("thrust", is_flux_based=True),
        OutputMap("flux_density", is_flux_based=True, is_flux_density=True),
        OutputMap("flux_linkage", is_flux_based=True),
        OutputMap("displacement", has_natural_zero=False, has_creep=True),
        OutputMap("strain", has_natural_zero=False, has_creep=True, magnetised_name="magnetostriction"),
        OutputMap("magnetostriction", power=2),
    )
}
"""Output maps by quantity, in the order of preference if a table contains several outputs."""


def output_map(output: Quantity) -> OutputMap:
    """Return the map of an output; an unknown output is proportional to the flux density."""
    return OUTPUT_MAPS.get(output.name) or OutputMap(output.name)


def full_scale(output: Quantity, records: Iterable[FloatArray]) -> float:
    """Return the full scale of an output, the reference of every relative deviation.

    The full scale is the largest magnitude in all records. A displacement or a strain has no natural zero; its
    full scale is the largest range of a record.
    """
    has_zero = output_map(output).has_natural_zero
    magnitudes = (float(np.max(np.abs(record)) if has_zero else np.ptp(record)) for record in records)
    return max(magnitudes, default=0.0)


def name_full_scale(output: Quantity, size: float | None = None) -> str:
    """Return the name of a full scale, with its value if given: ``the largest force (24 N)``."""
    name = output.words
    scale_name = f"the largest {name}" if output_map(output).has_natural_zero else f"the range of the {name}"
    if size is None:
        return scale_name
    unit, scale = choose_display_unit(output, size)
    return f"{scale_name} ({scale * size:.5g} {unit})"


COIL_VOLTAGES = ("sense_voltage", "voltage")
"""Voltages that are integrated to the flux linkage if a current drives, in order of preference."""


def measured_quantity(drive: Quantity, output: Quantity) -> Quantity:
    """Return the output quantity for a drive.

    A magnetised body has an even strain. The integral of the voltage of a coil is a flux linkage.
    """
    if output.name in COIL_VOLTAGES:
        return QUANTITIES["flux_linkage"]
    name = output_map(output).magnetised_name
    return QUANTITIES[name] if name and drive.name in {"current", "field"} else output


class Device(Protocol):
    """Loops or a model: anything with an input and an output quantity."""

    @property
    def input(self) -> Quantity:
        """Quantity of the drive."""

    @property
    def output(self) -> Quantity:
        """Quantity of the response."""


def is_actuator(device: Device) -> bool:
    """Whether the input is a current and the output a force that moves a body."""
    return device.input.name == "current" and device.output.name in ("force", "thrust")


def is_electromagnet(device: Device) -> bool:
    """Whether a current produces an attraction, as in bearings and force control."""
    return device.input.name == "current" and output_map(device.output).is_even
