"""What is said on the link and on the bus of a virtual plant.

Made by tools/contract from contract/frames.toml and signals.toml, which say what they mean: do not edit.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, fields
from enum import IntEnum
from typing import ClassVar, NamedTuple, Self

VERSION = 4
PAYLOAD_MOST = 240
PLANT_MAGIC = 0x616E6879


class Reason(IntEnum):
    """Reasons for rejecting a request (NAK)."""

    NONE = 0
    VERSION = 1  # different protocol version; detail: the controller's version
    TYPE = 2  # unknown request
    LENGTH = 3  # wrong length of the payload; detail: its length
    # the sequence number is older than the last one; detail: 1 if a request with this number was answered, otherwise 0
    OLD = 4
    STATE = 5  # not allowed in this state; detail: the state
    VALUE = 6  # value out of range, or unknown setting, command or word
    ORDER = 7  # block data without block_begin or with a wrong offset; detail: the expected offset
    CHECKSUM = 8  # the received block does not have the announced checksum
    BLOCK = 9  # the block is invalid, or has a different kind or layout
    GENERATION = 10  # the block has a different generation; detail: its generation
    SESSION = 11  # no session is open: send hello first
    CURRENT = 12  # current still flows; repeat the request at zero current
    # the block has different full scales, gaps, rate or units; detail: the first word that differs
    SCALE = 13
    NOT_KEPT = 14  # the board has no non-volatile memory, or writing failed


class Body(IntEnum):
    """The controlled quantity."""

    FORCE = 0  # the force of a magnet
    POSITION = 1  # the position of a levitating armature


class Setting(IntEnum):
    """Settings."""

    # maximum number of ticks between two requests; afterwards the link counts as lost; the board has its own upper limit
    HEARTBEAT_TICKS = 0
    DEMAND_SLEW = 1  # largest change of the demand per tick, q31
    COMPENSATION = 2  # 1: the compensator; 0: a constant force-current ratio
    RATIO = 3  # constant ratio of current to demand, q30
    FOLLOW = 4  # current that updates the hysteresis state. 0: commanded; 1: measured
    # 0: built-in gains; 1: built-in gains times gain_p to gain_dd, read when this setting is written
    GAINS = 5
    GAIN_P = 6  # factor of the built-in proportional gain, q30
    GAIN_I = 7  # factor of the built-in integral gain, q30
    GAIN_D = 8  # factor of the built-in gain of the first derivative, q30
    GAIN_DD = 9  # factor of the built-in gain of the second derivative, q30
    CURRENT_TOLERANCE = 10  # largest difference between measured and commanded current, q31
    CURRENT_LAG_TICKS = 11  # longest time constant of amplifier and current sensor, ticks
    # time in which the amplifier can change the current by the full scale, ticks
    CURRENT_SWEEP_TICKS = 12
    # number of consecutive samples beyond current_tolerance that cause a fault
    CURRENT_OFF_TICKS = 13


class SettingRange(NamedTuple):
    """What a setting may be."""

    low: int
    high: int
    start: int
    start_ms: int  # the same of a setting in ticks, else 0
    while_running: bool


SETTINGS = {
    Setting.HEARTBEAT_TICKS: SettingRange(2, 1000000, 0, 100, True),
    Setting.DEMAND_SLEW: SettingRange(1, 2147483647, 2147483647, 0, True),
    Setting.COMPENSATION: SettingRange(0, 1, 1, 0, True),
    Setting.RATIO: SettingRange(-2147483648, 2147483647, 1073741824, 0, False),
    Setting.FOLLOW: SettingRange(0, 1, 0, 0, False),
    Setting.GAINS: SettingRange(0, 1, 0, 0, True),
    Setting.GAIN_P: SettingRange(536870912, 2147483647, 1073741824, 0, True),
    Setting.GAIN_I: SettingRange(0, 2147483647, 1073741824, 0, True),
    Setting.GAIN_D: SettingRange(536870912, 2147483647, 1073741824, 0, True),
    Setting.GAIN_DD: SettingRange(0, 2147483647, 1073741824, 0, True),
    Setting.CURRENT_TOLERANCE: SettingRange(1, 536870911, 107374182, 0, False),
    Setting.CURRENT_LAG_TICKS: SettingRange(3, 1000000, 0, 5, False),
    Setting.CURRENT_SWEEP_TICKS: SettingRange(1, 1000000, 0, 50, False),
    Setting.CURRENT_OFF_TICKS: SettingRange(1, 1000000, 0, 20, False),
}


@dataclass(frozen=True)
class Message:
    """A payload: fixed fields, then for some types a row of numbers."""

    TYPE: ClassVar[int]
    ANSWER: ClassVar[int]  # type of the answer to a request, else 0
    FIXED: ClassVar[struct.Struct]
    TAIL: ClassVar[str]

    def __init_subclass__(cls, code: int, form: str, answer: int = 0, tail: str = "") -> None:
        cls.TYPE, cls.ANSWER, cls.FIXED, cls.TAIL = code, answer, struct.Struct(form), tail

    def pack(self) -> bytes:
        """Return the payload; ValueError where a number does not fit."""
        values = [getattr(self, field.name) for field in fields(self)]
        tail = values.pop() if self.TAIL else b""
        form = f"<{len(tail)}{self.TAIL or 'B'}"
        try:
            return self.FIXED.pack(*values) + struct.pack(form, *tail)
        except struct.error as error:
            raise ValueError(f"{type(self).__name__}: {error}") from error

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        """Return what the payload says; ValueError where its length is wrong."""
        fixed, rest = payload[: cls.FIXED.size], payload[cls.FIXED.size :]
        each = struct.calcsize(f"<{cls.TAIL}") if cls.TAIL else 0
        if len(fixed) != cls.FIXED.size or (len(rest) % each if each else len(rest)):
            raise ValueError(f"{cls.__name__}: {len(payload)} bytes of payload")
        values = list(cls.FIXED.unpack(fixed))
        if each:
            values.append(struct.unpack(f"<{len(rest) // each}{cls.TAIL}", rest))
        return cls(*values)


@dataclass(frozen=True)
class PlantRecord:
    """A record of the plant's bus: 32-bit words, the last one a check."""

    FIXED: ClassVar[struct.Struct]

    def __init_subclass__(cls, form: str) -> None:
        cls.FIXED = struct.Struct(form)

    def pack(self) -> bytes:
        """Return the record with its check."""
        body = self.FIXED.pack(*vars(self).values())
        return body + struct.pack("<I", _check(body))

    @classmethod
    def unpack(cls, record: bytes) -> Self:
        """Return what the record says; ValueError where length or check are wrong."""
        body = record[:-4]
        if len(body) != cls.FIXED.size or record[-4:] != struct.pack("<I", _check(body)):
            raise ValueError(f"{cls.__name__}: not a record of the plant's bus")
        return cls(*cls.FIXED.unpack(body))


def _check(body: bytes) -> int:
    check = PLANT_MAGIC
    for (word,) in struct.iter_unpack("<I", body):
        check ^= word
    return check


@dataclass(frozen=True)
class HelloRequest(Message, code=0x01, answer=0x81, form="<HI"):
    """Opens a session: the sequence numbers start again with this frame.

    If this session is already open, the frame is answered and has no effect.
    """

    version: int  # protocol version of the PC
    session: int  # random number of the session, chosen by the PC


@dataclass(frozen=True)
class HeartbeatRequest(Message, code=0x02, answer=0x82, form="<"):
    """Requests the status."""


@dataclass(frozen=True)
class DemandRequest(Message, code=0x03, answer=0x82, form="<i"):
    """The demanded force, valid from the next tick on.

    No effect outside the state run and on a position controller.
    """

    force: int  # q31 of the full-scale force


@dataclass(frozen=True)
class CommandRequest(Message, code=0x04, answer=0x83, form="<H"):
    """Changes the state.

    Detail of the answer: the new state.
    """

    command: int  # one of command


@dataclass(frozen=True)
class SettingReadRequest(Message, code=0x05, answer=0x85, form="<H"):
    """Requests a setting."""

    setting: int  # one of setting


@dataclass(frozen=True)
class SettingWriteRequest(Message, code=0x06, answer=0x85, form="<Hi"):
    """Changes a setting, valid from the next tick on."""

    setting: int  # one of setting
    value: int


@dataclass(frozen=True)
class BlockBeginRequest(Message, code=0x07, answer=0x83, form="<HHI"):
    """Announces a parameter block and discards words of an incomplete one."""

    words: int  # length of the block
    generation: int  # generation of the block
    checksum: int  # CRC-32 of all its words, low byte first


@dataclass(frozen=True)
class BlockDataRequest(Message, code=0x08, answer=0x83, form="<H", tail="h"):
    """The next words of the block.

    Detail of the answer: the next offset.
    """

    offset: int  # offset of the first word in the block
    words: tuple[int, ...]


@dataclass(frozen=True)
class BlockSwapRequest(Message, code=0x09, answer=0x83, form="<H"):
    """Checks the block and activates it between two ticks.

    After an error, the old block remains active. Detail of the answer: the generation of the active
    block.
    """

    generation: int  # generation of the block


@dataclass(frozen=True)
class BlockReadRequest(Message, code=0x0A, answer=0x86, form="<HH"):
    """Requests words of the active block."""

    offset: int  # first requested word
    words: int  # number of words, 1..118


@dataclass(frozen=True)
class TargetRequest(Message, code=0x0E, answer=0x82, form="<i"):
    """The target position, valid from the next tick on; before a lift, the first target.

    A position outside the range is rejected, and a force controller rejects every target.
    """

    position: int  # q31 of the position controller's full scale


@dataclass(frozen=True)
class KeepRequest(Message, code=0x0F, answer=0x83, form="<"):
    """Stores the active block for the next start, if the board has non-volatile memory.

    Allowed only in idle or ready at zero current, because the board may stop its ticks for seconds.
    Detail: the generation of the block.
    """


@dataclass(frozen=True)
class XcpRequest(Message, code=0x10, answer=0x89, form="<", tail="B"):
    """An XCP command; an empty frame requests only samples.

    Only the command of an unlocked master counts as a heartbeat, not the frame.
    """

    command: tuple[int, ...]


@dataclass(frozen=True)
class InfoAnswer(Message, code=0x81, form="<HHHHHHHIIHH"):
    """Identification of the controller."""

    version: int  # protocol version
    firmware: int  # version of the firmware: 256*major + minor
    kind: int  # kind of compensator (ANHYST_KIND_...)
    layout: int  # layout of the parameter blocks
    generation: int  # generation of the active block
    capacity: int  # maximum number of words of a parameter block
    ramp: int  # time from full current to zero in the safe state, ms
    model: int  # first 32 bits of the model's hash
    rate: int  # ticks per second
    body: int  # controlled quantity, one of body
    magnets: int  # number of magnets: 1, or an opposing pair


@dataclass(frozen=True)
class StatusAnswer(Message, code=0x82, form="<BBHiiiiiHHHHHiiiiI"):
    """State and signals of the tick in the header."""

    state: int  # one of state
    fault: int  # latched reason, one of fault
    flags: int  # bits of flag
    demand: int  # active demand, q31
    force: int  # measured force, q30
    gap: int  # measured gap, q30
    current: int  # measured current, q30
    drive: int  # commanded current, q31
    generation: int  # generation of the active block
    bad_frames: int  # damaged frames, modulo 65536
    lost_frames: int  # missing sequence numbers, modulo 65536
    missed_ticks: int  # missed ticks since power-on, modulo 65536
    phase: int  # one of phase
    position: int  # last plausible position, q31
    reference: int  # reference position, q31
    current_2: int  # measured current of the second magnet, q30
    drive_2: int  # commanded current of the second magnet, q31
    cycles: int  # processor cycles of the longest tick; 0: not counted


@dataclass(frozen=True)
class AckAnswer(Message, code=0x83, form="<HH"):
    """The request was executed."""

    request: int  # type of the request
    detail: int  # see the request


@dataclass(frozen=True)
class NakAnswer(Message, code=0x84, form="<HHH"):
    """The request was rejected and had no effect."""

    request: int  # type of the request
    reason: int  # one of reason
    detail: int  # see the reason


@dataclass(frozen=True)
class SettingAnswer(Message, code=0x85, form="<Hi"):
    """The value of a setting."""

    setting: int  # one of setting
    value: int


@dataclass(frozen=True)
class BlockWordsAnswer(Message, code=0x86, form="<H", tail="h"):
    """Words of the active block."""

    offset: int  # offset of the first word
    words: tuple[int, ...]


@dataclass(frozen=True)
class XcpPacketsAnswer(Message, code=0x89, form="<", tail="B"):
    """The answer to the command, then events and samples; each packet follows its length."""

    packets: tuple[int, ...]


@dataclass(frozen=True)
class PlantSample(PlantRecord, form="<IiiiiiI"):
    """Plant to controller: the sensor readings at the beginning of a tick."""

    tick: int  # counts from 1
    gap: int  # q30: 0 is the low end of the model's gaps, 1.0 the high one
    force: int  # q30 of the full-scale force
    position: int  # q31 of the position controller's full scale
    current: int  # current of the first magnet, q30 of full scale
    current_2: int  # current of the second magnet, q30 of full scale
    status: int  # bits of PORT_... in port/port.h


@dataclass(frozen=True)
class PlantDrive(PlantRecord, form="<IiiIIiiii"):
    """Controller to plant: the currents from the beginning of the next tick on, and signals of the controller for recordings."""

    tick: int  # tick of the sample from which the record was computed
    drive: int  # commanded current of the first magnet, q31 of full scale
    drive_2: int  # commanded current of the second magnet, q31 of full scale
    state: int  # state + 256*fault
    mode: int  # flags + 65536*phase
    demand: int  # active demand, q31 of the full-scale force
    reference: int  # reference position, q31 of the controller's full scale
    flux: int  # flux of the first magnet's model after the commit, q30
    expected: int  # force of this model, q31


ANSWERS: dict[int, type[Message]] = {
    answer.TYPE: answer
    for answer in (
        InfoAnswer,
        StatusAnswer,
        AckAnswer,
        NakAnswer,
        SettingAnswer,
        BlockWordsAnswer,
        XcpPacketsAnswer,
    )
}
