"""Sample variables of an XCP slave, either with a DAQ list or by polling."""

from __future__ import annotations

import math
import struct
import time
from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np

from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst_rigs.link.foreign.odt import OdtLimits, plan_odts
from anhyst_rigs.link.foreign.slave import (
    ALLOC_DAQ,
    ALLOC_ODT,
    ALLOC_ODT_ENTRY,
    CLEAR_DAQ_LIST,
    FREE_DAQ,
    GET_DAQ_LIST_INFO,
    MEMORY_OVERFLOW,
    SAMPLING,
    SET_DAQ_LIST_MODE,
    SET_DAQ_PTR,
    START_STOP_DAQ_LIST,
    START_STOP_SYNCH,
    WRITE_DAQ,
    DaqProperties,
    Slave,
    SlaveRefusedError,
)
from anhyst_rigs.link.foreign.variables import EventChannel, SlaveVariable

_MAX_ODT_ENTRIES = (255, 30, 7)
"""Numbers of entries in an ODT of a dynamic list that are tried one after the other."""
_MAX_ODTS = 0xFC
"""Number of ODT identifiers that XCP reserves for samples."""
_FIRST_SAMPLE_TIMEOUT_S = 2.0
_MEASURING_TIME_S = 0.25
_MEASURED_PERIODS = 2.5
"""The period of an event is measured for this number of periods, and at least for the time above."""
_STAMPED_TOLERANCE = 0.05
_ARRIVAL_TOLERANCE = 0.5
"""Largest relative difference between stated and measured period, with and without time stamps.

If the difference is larger, the measured period is used.
"""
_MAX_LINE_LOAD = 0.8
"""Fraction of the data rate of a serial port that samples may use."""
_POLL_PERIODS_S = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
_MAX_POLL_LOAD = 0.5
"""Largest fraction of its period that polling all signals may take."""


class Sampler(ABC):
    """Running sampling of some variables. A row contains the number of its period, then the values."""

    variables: Sequence[SlaveVariable]
    rate: float  # periods of the event per second, Hz
    ticks_per_row: int  # number of periods from one row to the next
    doc: str  # manner of sampling, for the user

    @abstractmethod
    def read_rows(self, wait_s: float) -> FloatArray:
        """Return new rows; wait at most a time, s, for the first one."""

    @abstractmethod
    def stop(self) -> None:
        """End the sampling."""

    def take_notes(self) -> list[str]:
        """Return messages about lost samples since the last call."""
        return []


class Poller(Sampler):
    """Sampling by one read command for each variable; the values of a row are not simultaneous."""

    ticks_per_row = 1

    def __init__(self, slave: Slave, variables: Sequence[SlaveVariable]) -> None:
        self.variables, self._slave = variables, slave
        begin = time.monotonic()
        self._poll()
        needed_s = (time.monotonic() - begin) / _MAX_POLL_LOAD
        period_s = next((period for period in _POLL_PERIODS_S if period >= needed_s), needed_s)
        self.rate = 1.0 / period_s
        self.doc = f"polled every {period_s:g} s; the values of a row are not simultaneous"
        self._begin, self._tick = time.monotonic(), 0

    def _poll(self) -> list[float]:
        return [
            one.value_of(self._slave.read(one.address, one.extension, one.size, one.name))
            for one in self.variables
        ]

    def stop(self) -> None:
        """End the sampling. The slave receives no message."""

    def read_rows(self, wait_s: float) -> FloatArray:
        """Return one row when it is due."""
        due_s = self._begin + (self._tick + 1) / self.rate - time.monotonic()
        time.sleep(min(max(due_s, 0.0), wait_s))
        if due_s > wait_s:
            return np.empty((0, 1 + len(self.variables)))
        self._tick = max(self._tick + 1, math.floor((time.monotonic() - self._begin) * self.rate))
        return np.array([[self._tick, *self._poll()]])


class DaqSampler(Sampler):
    """Sampling with one DAQ list, which the slave sends at each event, or at each n-th event."""

    def __init__(
        self, slave: Slave, properties: DaqProperties, variables: Sequence[SlaveVariable], event: EventChannel
    ) -> None:
        slave.require_unlocked(SAMPLING, "sample signals")
        self.variables, self._slave, self._properties = variables, slave, properties
        self._list = properties.first_list
        self._stamp_bytes = properties.stamp_bytes
        self._incomplete: list[bytes] = []
        self._wrong_packets = self._lost_marks = self._overloads = 0
        self._last_stamp: int | None = None
        self._tick = 0
        self._configure(event)
        self._measure_period(event)

    def _configure(self, event: EventChannel) -> None:
        """Write the DAQ list and start it."""
        slave, properties = self._slave, self._properties
        slave.request(bytes((START_STOP_SYNCH, 0)), "stop all DAQ lists")
        if properties.is_dynamic:
            self._allocate()
        else:
            self.plan = plan_odts(self.variables, slave.granularity, self._choose_list(event))
            self._list_command(CLEAR_DAQ_LIST, 0)
        self.ticks_per_row = self._choose_prescaler(event)
        for number, odt in enumerate(self.plan.odts):
            self._list_command(SET_DAQ_PTR, 0, bytes((number, 0)))
            for entry in odt:
                fields = (
                    entry.size // slave.granularity,
                    entry.extension,
                    entry.address // slave.granularity,
                )
                names = ", ".join(one.name for one in self.variables if self._covers(one, entry.address))
                slave.request(
                    struct.pack(f"{slave.order}BBBBI", WRITE_DAQ, 0xFF, *fields), f"sample {names[:120]}"
                )
        mode = 0x10 if self._stamp_bytes else 0x00
        tail = struct.pack(f"{slave.order}HBB", event.number, self.ticks_per_row, 0)
        self._list_command(SET_DAQ_LIST_MODE, mode, tail)
        slave.line.poll_samples(0.0)  # discards samples of an earlier list
        answer = self._list_command(START_STOP_DAQ_LIST, 1)
        self._first_identifier = answer[1] if properties.identifier_bytes == 1 and len(answer) > 1 else 0

    def _covers(self, variable: SlaveVariable, byte_address: int) -> bool:
        begin = variable.address * self._slave.granularity
        return (
            begin <= byte_address + self._properties.granularity - 1 and byte_address < begin + variable.size
        )

    def _list_command(self, command: int, mode: int, tail: bytes = b"") -> bytes:
        head = struct.pack(f"{self._slave.order}BBH", command, mode, self._list)
        return self._slave.request(head + tail, "write the DAQ list")

    def _limits(self, max_odts: int, max_entries: int) -> OdtLimits:
        """Return the limits of the ODTs; the time stamp is omitted if it leaves no room for values."""
        properties = self._properties
        other_bytes = self._slave.max_sample_bytes - properties.identifier_bytes
        if other_bytes - self._stamp_bytes < properties.granularity and not properties.stamp_is_fixed:
            self._stamp_bytes = 0
        return OdtLimits(
            other_bytes - self._stamp_bytes,
            other_bytes,
            max_entries,
            max_odts,
            properties.granularity,
            properties.max_entry_bytes,
            properties.extension_per_odt,
        )

    def _choose_list(self, event: EventChannel) -> OdtLimits:
        """Choose the largest static list for an event, and return its limits."""
        best = (0, 0, 0)
        for number in range(self._properties.first_list, self._properties.list_count):
            command = struct.pack(f"{self._slave.order}BBH", GET_DAQ_LIST_INFO, 0, number)
            answer = self._slave.request(command, f"read DAQ list {number}", 6)
            flags, max_odts, max_entries, fixed_event = struct.unpack(f"{self._slave.order}BBBH", answer[1:6])
            is_usable = not flags & 0x01 and (not flags & 0x02 or fixed_event == event.number)
            if is_usable and flags & 0x04:
                best = max(best, (max_odts * max_entries, number, max_odts))
        if not best[0]:
            raise InputError(
                f"{self._slave.url}: no DAQ list can sample at the event {event.name}; choose another event",
                code="no-daq-list",
            )
        self._list = best[1]
        return self._limits(best[2], best[0] // best[2])

    def _allocate(self) -> None:
        """Plan and reserve a dynamic list; a slave may allow only a few entries in an ODT."""
        for max_entries in _MAX_ODT_ENTRIES:
            limits = self._limits(_MAX_ODTS, max_entries)
            self.plan = plan_odts(self.variables, self._slave.granularity, limits)
            try:
                self._reserve()
                return
            except SlaveRefusedError as refused:
                if refused.error != MEMORY_OVERFLOW or max_entries == _MAX_ODT_ENTRIES[-1]:
                    raise

    def _reserve(self) -> None:
        slave, purpose = self._slave, "reserve the DAQ list"
        slave.request(bytes((FREE_DAQ,)), purpose)
        slave.request(struct.pack(f"{slave.order}BBH", ALLOC_DAQ, 0, 1), purpose)
        self._list_command(ALLOC_ODT, 0, bytes((len(self.plan.odts),)))
        for number, odt in enumerate(self.plan.odts):
            self._list_command(ALLOC_ODT_ENTRY, 0, bytes((number, len(odt))))

    def _choose_prescaler(self, event: EventChannel) -> int:
        """Return the number of events for each sample, so that a serial port can carry the samples."""
        line = self._slave.line
        if not line.serial or not event.period_s:
            return 1
        overhead = struct.calcsize(line.framing.head) + line.framing.checksum_bytes + 1
        sample_bytes = sum(self.plan.odt_bytes()) + self._stamp_bytes
        sample_bytes += len(self.plan.odts) * (overhead + self._properties.identifier_bytes)
        prescaler = math.ceil(sample_bytes / event.period_s / (_MAX_LINE_LOAD * line.baud / 10.0))
        if prescaler > (255 if self._properties.has_prescaler else 1):
            raise InputError(
                f"{self._slave.url}: the port cannot carry {len(self.variables)} signals at the event "
                f"{event.name}; choose fewer signals or a slower event",
                code="too-many-signals",
            )
        return max(1, prescaler)

    def _measure_period(self, event: EventChannel) -> None:
        """Compare the stated period of the event with the first samples, and set the rate of the rows."""
        stated_s = event.period_s * self.ticks_per_row
        stamps, arrivals = self._take_first_samples(event, stated_s)
        measured_s = 0.0
        if len(stamps) > 1:
            steps = np.diff(stamps) % (1 << 8 * self._stamp_bytes)
            counts = np.maximum(1.0, np.round(steps / max(1.0, float(np.median(steps)))))
            measured_s = float(steps.sum() / counts.sum()) * self._properties.stamp_period_s
        elif len(arrivals) > 1:
            measured_s = (arrivals[-1] - arrivals[0]) / (len(arrivals) - 1)
        tolerance = _STAMPED_TOLERANCE if stamps else _ARRIVAL_TOLERANCE
        self.doc = f"event {event.name}, every {stated_s:g} s"
        self._row_period_s = stated_s
        if measured_s and not abs(measured_s - stated_s) <= tolerance * stated_s:
            self._row_period_s = measured_s
            self.doc = f"event {event.name}, measured period {measured_s:.4g} s"
            self.doc += f" (stated: {stated_s:g} s)" if stated_s else ""
        if not self._row_period_s:
            raise InputError(
                f"{self._slave.url}: the period of event {event.name} is unknown and cannot be measured; "
                "choose another event",
                code="no-tick",
            )
        self.rate = self.ticks_per_row / self._row_period_s
        self._last_stamp = stamps[-1] if stamps else None

    def _take_first_samples(self, event: EventChannel, period_s: float) -> tuple[list[int], list[float]]:
        """Return the time stamps and the times of arrival of the first samples."""
        measuring_s = max(_MEASURING_TIME_S, _MEASURED_PERIODS * period_s)
        timeout_s = max(_FIRST_SAMPLE_TIMEOUT_S, measuring_s)
        end = time.monotonic() + timeout_s
        stamps: list[int] = []
        arrivals: list[float] = []
        while (present := time.monotonic()) < end:
            samples, new_stamps = self._take_samples(min(0.05, end - present))
            if samples and not arrivals:
                end = time.monotonic() + measuring_s
            arrivals += [time.monotonic()] * len(samples)
            stamps += new_stamps
        if not arrivals:
            reason = f"no sample arrived within {timeout_s:g} s; the event does not occur, choose another one"
            if self._wrong_packets:
                reason = (
                    "its samples are too short for the DAQ list; the slave does not follow the XCP standard"
                )
            raise InputError(f"{self._slave.url}: event {event.name}: {reason}", code="no-tick")
        return stamps, arrivals

    def read_rows(self, wait_s: float) -> FloatArray:
        """Return a row for each new sample."""
        samples, stamps = self._take_samples(wait_s)
        if not samples:
            return np.empty((0, 1 + len(self.variables)))
        values = self.plan.decode(samples, self.variables)
        return np.column_stack((self._number_rows(stamps, len(samples)), values))

    def _number_rows(self, stamps: Sequence[int], count: int) -> FloatArray:
        """Return the numbers of the event periods of new samples.

        A step of the time stamp is rounded to whole periods. Therefore, jitter below half a period has
        no effect, and a lost sample leaves a gap. Without time stamps, lost samples remain unknown.
        """
        steps = np.ones(count)
        if stamps:
            first = stamps[0] if self._last_stamp is None else self._last_stamp
            differences = np.diff(stamps, prepend=first) % (1 << 8 * self._stamp_bytes)
            periods = differences * self._properties.stamp_period_s / self._row_period_s
            steps = np.maximum(1.0, np.round(periods))
            self._last_stamp = stamps[-1]
        ticks = self._tick + self.ticks_per_row * np.cumsum(steps)
        self._tick = int(ticks[-1])
        return ticks

    def _take_samples(self, wait_s: float) -> tuple[list[bytes], list[int]]:
        """Return the value bytes and the time stamp of each complete sample."""
        samples: list[bytes] = []
        stamps: list[int] = []
        head, order = self._properties.identifier_bytes, "big" if self._slave.order == ">" else "little"
        odt_bytes, last_odt = self.plan.odt_bytes(), len(self.plan.odts) - 1
        for packet in self._slave.line.poll_samples(wait_s):
            odt = self._odt_of(packet)
            if odt is None or not 0 <= odt <= last_odt:
                continue
            begin = head + (self._stamp_bytes if odt == 0 else 0)
            if odt == 0:
                self._incomplete = []
            if len(packet) < begin + odt_bytes[odt]:
                self._wrong_packets += 1
                self._incomplete = []
            elif odt == len(self._incomplete):
                self._incomplete.append(packet[head:])
            else:
                self._incomplete = []  # A packet of this sample was lost.
            if len(self._incomplete) == last_odt + 1:
                first, *others = self._incomplete
                stamps.append(int.from_bytes(first[: self._stamp_bytes], order))  # type: ignore[arg-type]
                first_values = first[self._stamp_bytes :][: odt_bytes[0]]
                parts = [part[:size] for part, size in zip(others, odt_bytes[1:], strict=True)]
                samples.append(b"".join((first_values, *parts)))
                self._incomplete = []
        return samples, stamps if self._stamp_bytes else []

    def _odt_of(self, packet: bytes) -> int | None:
        """Return the number of the ODT of a packet, or None if it belongs to another list."""
        properties, identifier = self._properties, packet[0]
        if properties.marks_overload:
            self._lost_marks += identifier >> 7
            identifier &= 0x7F
        if properties.identifier_bytes == 1:
            return identifier - self._first_identifier
        size = properties.identifier_bytes
        list_bytes = packet[max(1, size - 2) : size]
        order = "big" if self._slave.order == ">" else "little"
        return identifier if int.from_bytes(list_bytes, order) == self._list else None  # type: ignore[arg-type]

    def take_notes(self) -> list[str]:
        """Return messages about lost samples since the last call."""
        notes = []
        overloads, self._overloads = (
            self._slave.line.overload_count - self._overloads,
            self._slave.line.overload_count,
        )
        if overloads or self._lost_marks:
            notes.append("the slave reports that it dropped samples; choose fewer signals or a slower event")
        if self._wrong_packets:
            notes.append(f"{self._wrong_packets} samples had a wrong length and were dropped")
        self._lost_marks = self._wrong_packets = 0
        return notes

    def stop(self) -> None:
        """Stop the DAQ list."""
        self._slave.request(bytes((START_STOP_SYNCH, 0)), "stop the DAQ list")


def choose_event(
    events: Sequence[EventChannel], variables: Sequence[SlaveVariable], number: int | None
) -> EventChannel:
    """Return the event with a number, or the fastest cyclic event that may sample all variables."""
    allowed = [one for one in events if all(not v.events or one.number in v.events for v in variables)]
    if number is None:
        allowed.sort(key=lambda event: event.period_s or math.inf)
        if not allowed:
            raise InputError(
                "the signals belong to different events; choose signals of one event", code="no-daq-list"
            )
        return allowed[0]
    chosen = next((event for event in events if event.number == number), None)
    if chosen is None:
        raise InputError(f"the slave has no event {number}", code="no-daq-list")
    if chosen not in allowed:
        names = ", ".join(v.name for v in variables if v.events and number not in v.events)
        raise InputError(
            f"event {chosen.name} does not sample {names[:120]}; choose another event", code="no-daq-list"
        )
    return chosen
