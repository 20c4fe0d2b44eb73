"""Pack variables into the object descriptor tables (ODT) of a DAQ list, and decode their samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst_rigs.link.foreign.variables import SlaveVariable


class OdtEntry(NamedTuple):
    """Bytes of memory that are part of a sample."""

    extension: int
    address: int  # byte address
    size: int  # bytes


@dataclass(frozen=True, slots=True)
class OdtLimits:
    """Limits of the ODTs of a DAQ list."""

    first_bytes: int  # bytes for values in the first ODT, which also contains the time stamp
    other_bytes: int  # bytes for values in each other ODT
    max_entries: int  # entries in an ODT
    max_odts: int
    granularity: int  # of the size and the address of an entry, bytes
    max_entry_bytes: int
    extension_per_odt: bool  # whether all entries of an ODT need the same address extension


@dataclass(slots=True)
class OdtPlan:
    """The ODTs of a DAQ list, and the position of each variable in a sample."""

    odts: list[list[OdtEntry]] = field(default_factory=lambda: [[]])
    positions: list[NDArray[np.intp]] = field(default_factory=list)  # bytes of each variable in a sample

    def odt_bytes(self) -> list[int]:
        """Return the number of value bytes in each ODT."""
        return [sum(entry.size for entry in odt) for odt in self.odts]

    def decode(self, samples: Sequence[bytes], variables: Sequence[SlaveVariable]) -> FloatArray:
        """Return a row of physical values for each sample."""
        data = np.frombuffer(b"".join(samples), dtype=np.uint8).reshape(len(samples), -1)
        columns = [
            variable.decode(np.ascontiguousarray(data[:, position]).view(variable.dtype)[:, 0])
            for variable, position in zip(variables, self.positions, strict=True)
        ]
        return np.column_stack(columns)


def plan_odts(variables: Sequence[SlaveVariable], address_bytes: int, limits: OdtLimits) -> OdtPlan:
    """Return ODTs that contain the variables in their order; `address_bytes` is the size of an address.

    The address and the size of an entry are multiples of the granularity. Therefore, an entry can be
    larger than its variable. Variables in the same entry, such as bit fields, share it.
    """
    plan = OdtPlan()
    begins: dict[OdtEntry, int] = {}
    used_bytes = total_bytes = 0
    for variable in variables:
        begin = variable.address * address_bytes
        position: list[int] = []
        for entry in _split(variable.extension, begin, variable.size, limits):
            if entry not in begins:
                odt = plan.odts[-1]
                capacity = limits.first_bytes if len(plan.odts) == 1 else limits.other_bytes
                is_other_extension = bool(odt) and odt[-1].extension != entry.extension
                if (
                    used_bytes + entry.size > capacity
                    or len(odt) >= limits.max_entries
                    or (limits.extension_per_odt and is_other_extension)
                ):
                    plan.odts.append([])
                    used_bytes = 0
                plan.odts[-1].append(entry)
                begins[entry] = total_bytes
                used_bytes += entry.size
                total_bytes += entry.size
            first = max(begin, entry.address)
            last = min(begin + variable.size, entry.address + entry.size)
            offset = begins[entry] - entry.address
            position += range(first + offset, last + offset)
        plan.positions.append(np.array(position))
    if len(plan.odts) > limits.max_odts:
        raise InputError(
            f"the signals need {len(plan.odts)} ODTs, and a DAQ list of this slave has {limits.max_odts}; "
            "choose fewer signals",
            code="too-many-signals",
        )
    return plan


def _split(extension: int, begin: int, size: int, limits: OdtLimits) -> list[OdtEntry]:
    """Return the entries that contain some bytes of memory."""
    granularity = limits.granularity
    max_bytes = min(limits.max_entry_bytes, limits.first_bytes, limits.other_bytes)
    max_bytes -= max_bytes % granularity
    if max_bytes == 0:
        raise InputError(
            f"an entry of {granularity} bytes does not fit into the samples of this slave",
            code="too-many-signals",
        )
    first = begin - begin % granularity
    end = -(-(begin + size) // granularity) * granularity
    return [
        OdtEntry(extension, address, min(max_bytes, end - address))
        for address in range(first, end, max_bytes)
    ]
