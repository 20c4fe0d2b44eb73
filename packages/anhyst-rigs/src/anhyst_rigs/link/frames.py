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
    """Opens a session: the sequence starts again with this frame.

    Where this very session is open already it is answered and changes nothing.
    """

    version: int  # protocol version of the PC
    session: int  # number of the session, drawn at random by the PC


@dataclass(frozen=True)
class HeartbeatRequest(Message, code=0x02, answer=0x82, form="<"):
    """Asks for the status."""


@dataclass(frozen=True)
class DemandRequest(Message, code=0x03, answer=0x82, form="<i"):
    """The demanded force, in force from the next tick.

    Without effect outside run and on a position.
    """

    force: int  # q31 of the full-scale force


@dataclass(frozen=True)
class CommandRequest(Message, code=0x04, answer=0x83, form="<H"):
    """Changes the state.

    Detail of the answer: the state entered.
    """

    command: int  # one of command


@dataclass(frozen=True)
class SettingReadRequest(Message, code=0x05, answer=0x85, form="<H"):
    """Asks for a setting."""

    setting: int  # one of setting


@dataclass(frozen=True)
class SettingWriteRequest(Message, code=0x06, answer=0x85, form="<Hi"):
    """Sets a setting, in force from the next tick."""

    setting: int  # one of setting
    value: int


@dataclass(frozen=True)
class BlockBeginRequest(Message, code=0x07, answer=0x83, form="<HHI"):
    """Announces a parameter block; what had arrived of another is forgotten."""

    words: int  # length of the block
    generation: int  # of the block
    checksum: int  # CRC-32 of all its words, low byte first


@dataclass(frozen=True)
class BlockDataRequest(Message, code=0x08, answer=0x83, form="<H", tail="h"):
    """The next words of the block.

    Detail of the answer: the next offset.
    """

    offset: int  # of the first of these words in the block
    words: tuple[int, ...]


@dataclass(frozen=True)
class BlockSwapRequest(Message, code=0x09, answer=0x83, form="<H"):
    """Checks the block and puts it in force between two ticks.

    On any error the old one stays. Detail of the answer: the generation in force.
    """

    generation: int  # of the block


@dataclass(frozen=True)
class BlockReadRequest(Message, code=0x0A, answer=0x86, form="<HH"):
    """Asks for words of the block in force."""

    offset: int  # first word wanted
    words: int  # number of words, 1..118


@dataclass(frozen=True)
class TargetRequest(Message, code=0x0E, answer=0x82, form="<i"):
    """The position to go to and hold, from the next tick on; before lifting, the first one.

    Refused beyond the positions that can be, and by a controller of force.
    """

    position: int  # q31 of the controller's full scale


@dataclass(frozen=True)
class KeepRequest(Message, code=0x0F, answer=0x83, form="<"):
    """Keeps the block in force for the next start, where the board has room for one.

    In idle or ready at zero current alone: the board's time may stand still meanwhile, for seconds.
    Detail: its generation.
    """


@dataclass(frozen=True)
class XcpRequest(Message, code=0x10, answer=0x89, form="<", tail="B"):
    """A command of XCP, or nothing where only samples are wanted.

    Is no sign of life by itself: the command is, of a master that has shown the key.
    """

    command: tuple[int, ...]


@dataclass(frozen=True)
class InfoAnswer(Message, code=0x81, form="<HHHHHHHIIHH"):
    """Who the controller is."""

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
class StatusAnswer(Message, code=0x82, form="<BBHiiiiiHHHHHiiiiI"):
    """What the controller did in the tick that its head names."""

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
class AckAnswer(Message, code=0x83, form="<HH"):
    """Done."""

    request: int  # type of the request
    detail: int  # see the request


@dataclass(frozen=True)
class NakAnswer(Message, code=0x84, form="<HHH"):
    """Not done, and nothing changed."""

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
    """Words of the block in force."""

    offset: int  # of the first of these words
    words: tuple[int, ...]


@dataclass(frozen=True)
class XcpPacketsAnswer(Message, code=0x89, form="<", tail="B"):
    """What the command is answered with, then events and samples: each packet behind its length."""

    packets: tuple[int, ...]


@dataclass(frozen=True)
class PlantSample(PlantRecord, form="<IiiiiiI"):
    """Plant to controller: what the sensors show at the beginning of a tick."""

    tick: int  # counts from 1
    gap: int  # q30: 0 is the low end of the model's gaps, 1.0 the high one
    force: int  # q30 of the full-scale force
    position: int  # q31 of the controller's full scale
    current: int  # q30 of the full-scale current, of the first magnet
    current_2: int  # of the second
    status: int  # bits of PORT_... in port/port.h


@dataclass(frozen=True)
class PlantDrive(PlantRecord, form="<IiiIIiiii"):
    """Controller to plant: what is to flow from the beginning of the next tick on.

    Then signals that a plant does not know by itself.
    """

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
