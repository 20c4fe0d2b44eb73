"""What an output makes of the flux density in the iron: known of the quantity, and asked of it once."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from anhyst.support.numeric import FloatArray
from anhyst.support.units import QUANTITIES, Quantity, choose_display_unit


@dataclass(frozen=True, slots=True)
class OutputMap:
    """Output over flux density, ``c_out * B**power + out_0``."""

    quantity: str  # name of the output
    # power of the flux density; an even one does not depend on the sign of the input
    power: int = 1
    # whether the output grows with the flux of the iron, and encloses energy with the input
    is_flux_based: bool = False
    is_flux_density: bool = False  # whether the output is the flux density itself, ``c_out = 1``
    # whether the output has a natural zero; else deviations refer to its range
    has_natural_zero: bool = True
    # whether a body that deforms by itself gives it, with lag and creep and no iron in it
    has_creep: bool = False
    # name of the quantity that it is where a current or a field drives, if that is another one
    magnetised_name: str = ""

    @property
    def is_even(self) -> bool:
        """Whether the output is the same for a flux density and its negative."""
        return self.power % 2 == 0

    def shape(self, flux_density: FloatArray) -> FloatArray:
        """Return the flux density to the power of the output."""
        return flux_density * flux_density if self.power == 2 else flux_density**self.power


OUTPUT_MAPS = {
    each.quantity: each
    for each in (
        OutputMap("force", power=2, is_flux_based=True),
        OutputMap("thrust", is_flux_based=True),
        OutputMap("flux_density", is_flux_based=True, is_flux_density=True),
        OutputMap("flux_linkage", is_flux_based=True),
        OutputMap("displacement", has_natural_zero=False, has_creep=True),
        OutputMap(
            "strain", has_natural_zero=False, has_creep=True, magnetised_name="magnetostriction"
        ),
        OutputMap("magnetostriction", power=2),
    )
}
"""By the name of the quantity, first choice of an output first."""


def output_map(output: Quantity) -> OutputMap:
    """Return the map of an output; in proportion to the flux density if nothing else is known."""
    return OUTPUT_MAPS.get(output.name) or OutputMap(output.name)


def full_scale(output: Quantity, records: Iterable[FloatArray]) -> float:
    """Return the full scale of an output, to which every relative deviation refers.

    It is the largest size in all records. A displacement or a strain has no natural zero: its full
    scale is the largest range of a record.
    """
    has_zero = output_map(output).has_natural_zero
    sizes = (float(np.max(np.abs(each)) if has_zero else np.ptp(each)) for each in records)
    return max(sizes, default=0.0)


def name_full_scale(output: Quantity, size: float | None = None) -> str:
    """Return the words for a full scale, with its size if given: ``the largest force (24 N)``."""
    name = output.name.replace("_", " ")
    words = (
        f"the largest {name}" if output_map(output).has_natural_zero else f"the range of the {name}"
    )
    if size is None:
        return words
    unit, scale = choose_display_unit(output, size)
    return f"{words} ({scale * size:.5g} {unit})"


def measured_quantity(drive: Quantity, answer: Quantity) -> Quantity:
    """Return what a column measures under a drive: strain of what is magnetised is even."""
    name = output_map(answer).magnetised_name
    return QUANTITIES[name] if name and drive.name in {"current", "field"} else answer


class Device(Protocol):
    """Loops, or a model: anything with an input and an output."""

    @property
    def input(self) -> Quantity:
        """What drives it."""

    @property
    def output(self) -> Quantity:
        """What it answers with."""


def is_actuator(device: Device) -> bool:
    """Whether a current makes a force: what moves a body."""
    return device.input.name == "current" and device.output.name in ("force", "thrust")


def is_electromagnet(device: Device) -> bool:
    """Whether a current pulls: what a bearing and a force controller are made of."""
    return device.input.name == "current" and output_map(device.output).is_even
