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
    """Why a request was not done (NAK)."""

    NONE = 0
    VERSION = 1  # another protocol version; detail: the controller's
    TYPE = 2  # no such request
    LENGTH = 3  # the payload has the wrong length; detail: the length it had
    # number overtaken by newer ones; detail: 1 a request of this number was answered then, 0 none
    OLD = 4
    STATE = 5  # not in this state; detail: the state
    VALUE = 6  # a value out of its range, or no such setting, command or word
    ORDER = 7  # block data without begin or not at the next offset; detail: the next offset
    CHECKSUM = 8  # the block that arrived is not the one that was announced
    BLOCK = 9  # the block is not valid, or of another kind or layout
    GENERATION = 10  # the block has another generation; detail: its own
    SESSION = 11  # no session is open: hello comes first
    CURRENT = 12  # in this state, but current still flows; once it is zero
    # made for other full scales, gaps, rate or units; detail: the first word that differs
    SCALE = 13
    NOT_KEPT = 14  # the board has no room that outlives the power, or it did not keep


class Body(IntEnum):
    """What a controller controls."""

    FORCE = 0  # the force of a magnet
    POSITION = 1  # the position of a levitating armature


class Setting(IntEnum):
    """Settings."""

    # ticks without a new request until the link counts as lost; the board has a ceiling of its own
    HEARTBEAT_TICKS = 0
    DEMAND_SLEW = 1  # largest change of the demand in a tick, q31
    COMPENSATION = 2  # 1: the compensator; 0: a constant force-current ratio
    RATIO = 3  # the constant ratio, q30: current for each unit of demand
    FOLLOW = 4  # what the memory follows. 0: the current driven; 1: the current measured
    # 0: the gains built in; 1: these times gain_p to gain_dd as they stand when this is written
    GAINS = 5
    GAIN_P = 6  # share of the proportional gain built in, q30
    GAIN_I = 7  # share of the integral gain, q30
    GAIN_D = 8  # share of the gain of the first derivative, q30
    GAIN_DD = 9  # share of the gain of the second derivative, q30
    CURRENT_TOLERANCE = 10  # largest deviation of the measured from the driven current, q31
    CURRENT_LAG_TICKS = 11  # longest time constant of amplifier and current sensor, ticks
    # ticks in which the amplifier can change the current by the full scale
    CURRENT_SWEEP_TICKS = 12
    CURRENT_OFF_TICKS = 13  # samples in a row beyond current_tolerance until it is a fault


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
    FIXED: ClassVar[struct.Struct]
    TAIL: ClassVar[str] = ""

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
class HelloRequest(Message):
    """Opens a session: the sequence starts again with this frame.

    Where this very session is open already it is answered and changes nothing.
    """

    TYPE: ClassVar[int] = 0x01
    ANSWER: ClassVar[int] = 0x81
    FIXED: ClassVar[struct.Struct] = struct.Struct("<HI")

    version: int  # protocol version of the PC
    session: int  # number of the session, drawn at random by the PC


@dataclass(frozen=True)
class HeartbeatRequest(Message):
    """Asks for the status."""

    TYPE: ClassVar[int] = 0x02
    ANSWER: ClassVar[int] = 0x82
    FIXED: ClassVar[struct.Struct] = struct.Struct("<")


@dataclass(frozen=True)
class DemandRequest(Message):
    """The demanded force, in force from the next tick.

    Without effect outside run and on a position.
    """

    TYPE: ClassVar[int] = 0x03
    ANSWER: ClassVar[int] = 0x82
    FIXED: ClassVar[struct.Struct] = struct.Struct("<i")

    force: int  # q31 of the full-scale force


@dataclass(frozen=True)
class CommandRequest(Message):
    """Changes the state.

    Detail of the answer: the state entered.
    """

    TYPE: ClassVar[int] = 0x04
    ANSWER: ClassVar[int] = 0x83
    FIXED: ClassVar[struct.Struct] = struct.Struct("<H")

    command: int  # one of command


@dataclass(frozen=True)
class SettingReadRequest(Message):
    """Asks for a setting."""

    TYPE: ClassVar[int] = 0x05
    ANSWER: ClassVar[int] = 0x85
    FIXED: ClassVar[struct.Struct] = struct.Struct("<H")

    setting: int  # one of setting


@dataclass(frozen=True)
class SettingWriteRequest(Message):
    """Sets a setting, in force from the next tick."""

    TYPE: ClassVar[int] = 0x06
    ANSWER: ClassVar[int] = 0x85
    FIXED: ClassVar[struct.Struct] = struct.Struct("<Hi")

    setting: int  # one of setting
    value: int


@dataclass(frozen=True)
class BlockBeginRequest(Message):
    """Announces a parameter block; what had arrived of another is forgotten."""

    TYPE: ClassVar[int] = 0x07
    ANSWER: ClassVar[int] = 0x83
    FIXED: ClassVar[struct.Struct] = struct.Struct("<HHI")

    words: int  # length of the block
    generation: int  # of the block
    checksum: int  # CRC-32 of all its words, low byte first


@dataclass(frozen=True)
class BlockDataRequest(Message):
    """The next words of the block.

    Detail of the answer: the next offset.
    """

    TYPE: ClassVar[int] = 0x08
    ANSWER: ClassVar[int] = 0x83
    FIXED: ClassVar[struct.Struct] = struct.Struct("<H")
    TAIL: ClassVar[str] = "h"

    offset: int  # of the first of these words in the block
    words: tuple[int, ...]


@dataclass(frozen=True)
class BlockSwapRequest(Message):
    """Checks the block and puts it in force between two ticks.

    On any error the old one stays. Detail of the answer: the generation in force.
    """

    TYPE: ClassVar[int] = 0x09
    ANSWER: ClassVar[int] = 0x83
    FIXED: ClassVar[struct.Struct] = struct.Struct("<H")

    generation: int  # of the block


@dataclass(frozen=True)
class BlockReadRequest(Message):
    """Asks for words of the block in force."""

    TYPE: ClassVar[int] = 0x0A
    ANSWER: ClassVar[int] = 0x86
    FIXED: ClassVar[struct.Struct] = struct.Struct("<HH")

    offset: int  # first word wanted
    words: int  # number of words, 1..118


@dataclass(frozen=True)
class TargetRequest(Message):
    """The position to go to and hold, from the next tick on; before lifting, the first one.

    Refused beyond the positions that can be, and by a controller of force.
    """

    TYPE: ClassVar[int] = 0x0E
    ANSWER: ClassVar[int] = 0x82
    FIXED: ClassVar[struct.Struct] = struct.Struct("<i")

    position: int  # q31 of the controller's full scale


@dataclass(frozen=True)
class KeepRequest(Message):
    """Keeps the block in force for the next start, where the board has room for one.

    In idle or ready at zero current alone: the board's time may stand still meanwhile, for seconds.
    Detail: its generation.
    """

    TYPE: ClassVar[int] = 0x0F
    ANSWER: ClassVar[int] = 0x83
    FIXED: ClassVar[struct.Struct] = struct.Struct("<")


@dataclass(frozen=True)
class XcpRequest(Message):
    """A command of XCP, or nothing where only samples are wanted.

    Is no sign of life by itself: the command is, of a master that has shown the key.
    """

    TYPE: ClassVar[int] = 0x10
    ANSWER: ClassVar[int] = 0x89
    FIXED: ClassVar[struct.Struct] = struct.Struct("<")
    TAIL: ClassVar[str] = "B"

    command: tuple[int, ...]


@dataclass(frozen=True)
class InfoAnswer(Message):
    """Who the controller is."""

    TYPE: ClassVar[int] = 0x81
    FIXED: ClassVar[struct.Struct] = struct.Struct("<HHHHHHHIIHH")

    version: int  # protocol version
    firmware: int  # version of the firmware: 256*major + minor
    kind: int  # kind of compensator (ANHYST_KIND_...)
    layout: int  # layout of the parameter blocks
    generation: int  # of the block in force
    capacity: int  # most words of a parameter block
    ramp: int  # ms from full current to zero in the safe state
    model: int  # first 32 bits of the hash of the model of the block
    rate: int  # ticks a second
    body: int  # what it controls, one of body
    magnets: int  # 1, or 2 that pull against each other


@dataclass(frozen=True)
class StatusAnswer(Message):
    """What the controller did in the tick that its head names."""

    TYPE: ClassVar[int] = 0x82
    FIXED: ClassVar[struct.Struct] = struct.Struct("<BBHiiiiiHHHHHiiiiI")

    state: int  # one of state
    fault: int  # one of fault: the latched reason
    flags: int  # bits of flag
    demand: int  # demand in force, q31
    force: int  # measured, q30
    gap: int  # measured, q30
    current: int  # measured, q30
    drive: int  # current driven, q31
    generation: int  # of the block in force
    bad_frames: int  # frames thrown away, modulo 65536
    lost_frames: int  # sequence numbers left out, modulo 65536
    missed_ticks: int  # since power on, modulo 65536
    phase: int  # one of phase
    position: int  # the last plausible one, q31
    reference: int  # position controlled to, q31
    current_2: int  # of the second magnet, likewise
    drive_2: int  # in the second magnet, likewise
    cycles: int  # of the processor, in the longest tick so far; 0: not counted


@dataclass(frozen=True)
class AckAnswer(Message):
    """Done."""

    TYPE: ClassVar[int] = 0x83
    FIXED: ClassVar[struct.Struct] = struct.Struct("<HH")

    request: int  # type of the request
    detail: int  # see the request


@dataclass(frozen=True)
class NakAnswer(Message):
    """Not done, and nothing changed."""

    TYPE: ClassVar[int] = 0x84
    FIXED: ClassVar[struct.Struct] = struct.Struct("<HHH")

    request: int  # type of the request
    reason: int  # one of reason
    detail: int  # see the reason


@dataclass(frozen=True)
class SettingAnswer(Message):
    """The value of a setting."""

    TYPE: ClassVar[int] = 0x85
    FIXED: ClassVar[struct.Struct] = struct.Struct("<Hi")

    setting: int  # one of setting
    value: int


@dataclass(frozen=True)
class BlockWordsAnswer(Message):
    """Words of the block in force."""

    TYPE: ClassVar[int] = 0x86
    FIXED: ClassVar[struct.Struct] = struct.Struct("<H")
    TAIL: ClassVar[str] = "h"

    offset: int  # of the first of these words
    words: tuple[int, ...]


@dataclass(frozen=True)
class XcpPacketsAnswer(Message):
    """What the command is answered with, then events and samples: each packet behind its length."""

    TYPE: ClassVar[int] = 0x89
    FIXED: ClassVar[struct.Struct] = struct.Struct("<")
    TAIL: ClassVar[str] = "B"

    packets: tuple[int, ...]


@dataclass(frozen=True)
class PlantSample(PlantRecord):
    """Plant to controller: what the sensors show at the beginning of a tick."""

    FIXED: ClassVar[struct.Struct] = struct.Struct("<IiiiiiI")

    tick: int  # counts from 1
    gap: int  # q30: 0 is the low end of the model's gaps, 1.0 the high one
    force: int  # q30 of the full-scale force
    position: int  # q31 of the controller's full scale
    current: int  # q30 of the full-scale current, of the first magnet
    current_2: int  # of the second
    status: int  # bits of PORT_... in port/port.h


@dataclass(frozen=True)
class PlantDrive(PlantRecord):
    """Controller to plant: what is to flow from the beginning of the next tick on.

    Then signals that a plant does not know by itself.
    """

    FIXED: ClassVar[struct.Struct] = struct.Struct("<IiiIIiiii")

    tick: int  # of the sample from which this was computed
    drive: int  # q31 of the full-scale current, of the first magnet
    drive_2: int  # of the second
    state: int  # state + 256*fault
    mode: int  # flags + 65536*phase
    demand: int  # demand in force, q31 of the full-scale force
    reference: int  # position controlled to, q31 of the controller's full scale
    flux: int  # flux of the model of the first magnet after the commit, q30
    expected: int  # force that this model expects, q31


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
