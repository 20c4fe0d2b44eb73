"""Operate a controller over the serial link: queries, commands, demands and parameter blocks.

Every request has a sequence number and is repeated until an answer arrives. The controller executes
repeated requests only once. Therefore, a disturbed line cannot lose or duplicate one unnoticed.
"""

from __future__ import annotations

import secrets
import threading
import time
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from typing import Self, TypeVar

from anhyst.support.block_words import GENERATION_INDEX, LENGTH_INDEX, checksum, describe_scale_mismatch
from anhyst.support.errors import InputError
from anhyst.support.states import Command, State
from anhyst_rigs.link import frames
from anhyst_rigs.link.frames import Message, NakAnswer, Reason, Setting
from anhyst_rigs.link.wire import BAUD, Frame, LinkPort, Port, Receiver, Status, encode

_Answer = TypeVar("_Answer", bound=Message)

_MAX_FRAME_WORDS = 118
"""Maximum number of block words in one frame, in each direction."""

_REASON_TEXTS = {
    Reason.VERSION: "the protocol version differs",
    Reason.TYPE: "unknown request",
    Reason.LENGTH: "the request has the wrong length",
    Reason.OLD: "newer requests were answered before",
    Reason.STATE: "not in this state",
    Reason.VALUE: "a value is out of its range",
    Reason.ORDER: "the words of the block arrived out of order",
    Reason.CHECKSUM: "the received block is not the announced one",
    Reason.BLOCK: "the parameter block is not valid, or of another kind or layout",
    Reason.GENERATION: "the generation of the parameter block is not the announced one",
    Reason.SESSION: "no session is open, the controller was restarted; open the port again",
    Reason.CURRENT: "current still flows; repeat the request when it is zero",
    Reason.SCALE: "the parameter block is made for other signals than those of the board",
}


class RequestRefusedError(InputError):
    """Error: the controller refused a request and gave a reason. Its state did not change."""

    def __init__(self, url: str, request: Message, nak: NakAnswer) -> None:
        name = type(request).__name__.removesuffix("Request")
        try:
            self.reason = Reason(nak.reason)
            meaning = _REASON_TEXTS[self.reason]
        except (KeyError, ValueError):
            self.reason = Reason.NONE
            meaning = f"for reason {nak.reason}"
        self.detail = nak.detail
        if self.reason is Reason.STATE:
            meaning = f"not in the state {State(nak.detail).name.lower()}"
            command = request.command if isinstance(request, frames.CommandRequest) else None
            if nak.detail == State.IDLE and command in (Command.RUN, Command.LIFT):
                meaning += "; condition the magnet first, or declare it demagnetised"
        super().__init__(
            f"{url}: the controller refused {_split_words(name)}: {meaning}",
            code="refused",
            key=self.reason.name.lower(),
        )


class ControllerLink:
    """The link to a controller through a port.

    The constructor opens the port and a session, and checks that both protocol versions are equal.
    """

    def __init__(
        self, port: str | LinkPort, baud: int = BAUD, timeout: float = 0.1, attempts: int = 20
    ) -> None:
        self._port = Port(port, baud) if isinstance(port, str) else port
        self.url = self._port.url
        self.timeout = timeout
        self.attempts = attempts
        self.repeated_count = 0
        self._receiver = Receiver()
        self._sequence = 0
        self._lock = threading.RLock()
        try:
            self._port.write(b"\0")  # ends an incomplete frame of a previous session
            hello_request = frames.HelloRequest(frames.VERSION, secrets.randbits(32))
            self.info = self.request(hello_request, frames.InfoAnswer)
        except BaseException:
            self._port.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the port. A controller that drives current then enters its safe state."""
        self._port.close()

    def status(self) -> Status:
        """Return the status of the last tick; this request is also a heartbeat."""
        return self._request_status(frames.HeartbeatRequest())

    def demand(self, force: int) -> Status:
        """Demand a force from the next tick on, as q31 of the full-scale force."""
        return self._request_status(demand_request(force))

    def stream(self, forces: Iterable[int], window: int = 24) -> Iterator[Status]:
        """Send many demands, several of which may be unanswered at the same time.

        All demands reach the controller in order. A lost demand is repeated. If the controller has
        already accepted newer demands, they are repeated after it. Therefore, the controller may
        receive a demand twice, but an old demand never remains active after a newer one.
        """
        if not 1 <= window <= MAX_WINDOW:
            raise InputError(f"window {window}: choose 1 to {MAX_WINDOW}", code="out-of-range", key="window")
        demand_window, remaining_forces = _DemandWindow(self), iter(forces)
        with self._lock:
            while True:
                demand_window.send(islice(remaining_forces, window - len(demand_window.unanswered_demands)))
                if not demand_window.unanswered_demands:
                    return
                demand_window.receive()
                yield from demand_window.take_answered()

    def command(self, command: Command) -> State:
        """Send a command that changes the state of the controller; return the new state."""
        return State(self.request(frames.CommandRequest(command), frames.AckAnswer).detail)

    def read_setting(self, setting: Setting) -> int:
        """Return the value of a setting."""
        return self.request(frames.SettingReadRequest(setting), frames.SettingAnswer).value

    def write_setting(self, setting: Setting, value: int) -> int:
        """Write a setting from the next tick on; return the value that the controller stores."""
        return self.request(frames.SettingWriteRequest(setting, value), frames.SettingAnswer).value

    def write_block(self, block_words: Sequence[int]) -> int:
        """Send a parameter block and activate it between two ticks; return the active generation."""
        all_words = [int(word) for word in block_words]
        if len(all_words) <= GENERATION_INDEX:
            text = f"a block of {len(all_words)} words: is too short; send a complete block"
            raise InputError(text, code="block-too-short")
        generation = all_words[GENERATION_INDEX] & 0xFFFF
        with self._lock:
            announcement = frames.BlockBeginRequest(len(all_words), generation, checksum(all_words))
            self.request(announcement, frames.AckAnswer)
            for offset in range(0, len(all_words), _MAX_FRAME_WORDS):
                data = frames.BlockDataRequest(offset, tuple(all_words[offset : offset + _MAX_FRAME_WORDS]))
                self.request(data, frames.AckAnswer)
            try:
                return self.request(frames.BlockSwapRequest(generation), frames.AckAnswer).detail
            except RequestRefusedError as error:
                if error.reason is Reason.SCALE:
                    active_words: list[int] = []
                    with suppress(RequestRefusedError):  # There is no active block.
                        active_words = self.read_block()
                    error.args = (f"{self.url}: {describe_scale_mismatch(all_words, active_words)}",)
                raise

    def keep_block(self) -> int:
        """Store the active parameter block for the next start of the board; return its generation."""
        return self.request(frames.KeepRequest(), frames.AckAnswer).detail

    def read_block(self) -> list[int]:
        """Return the active parameter block."""
        block_words: list[int] = []
        with self._lock:
            length = self._read_block_words(0, LENGTH_INDEX + 1)[LENGTH_INDEX]
            while len(block_words) < length:
                block_words += self._read_block_words(
                    len(block_words), min(length - len(block_words), _MAX_FRAME_WORDS)
                )
        return block_words

    def _read_block_words(self, offset: int, count: int) -> tuple[int, ...]:
        return self.request(frames.BlockReadRequest(offset, count), frames.BlockWordsAnswer).words

    def _request_status(self, request: Message) -> Status:
        with self._lock:
            answer, tick = self._exchange(request)
            return Status(tick, _check_answer(self.url, request, answer, frames.StatusAnswer))

    def request(self, request: Message, kind: type[_Answer]) -> _Answer:
        """Send a request and return the answer to it."""
        with self._lock:
            return _check_answer(self.url, request, self._exchange(request)[0], kind)

    def _exchange(self, request: Message) -> tuple[Message, int]:
        """Send a request until it is answered; return the answer and its tick."""
        sequence = self.next_sequence()
        frame_bytes = encode(request, sequence)
        for attempt in range(self.attempts):
            self.repeated_count += attempt > 0
            self._port.write(frame_bytes)
            deadline = time.monotonic() + self.timeout
            while (remaining_s := deadline - time.monotonic()) > 0.0:
                for frame in self.receive(remaining_s):
                    if frame.sequence == sequence:
                        answer = self.read_answer(frame)
                        if _is_answer_to(answer, request):
                            return answer, frame.tick
        raise self.make_timeout_error()

    def next_sequence(self) -> int:
        """Return the sequence number of the next request."""
        self._sequence = (self._sequence + 1) & 0xFF
        return self._sequence

    def send(self, wire: bytes) -> None:
        """Write encoded frames to the line."""
        self._port.write(wire)

    def receive(self, timeout: float) -> list[Frame]:
        """Return the frames that arrive next, or none after `timeout` s."""
        return self._receiver.feed(self._port.read(timeout))

    def read_answer(self, frame: Frame) -> Message:
        """Decode an answer; raise InputError if its version or its type is unknown."""
        kind = frames.ANSWERS.get(frame.type)
        if frame.version != frames.VERSION:
            raise self._make_version_error(frame.version)
        try:
            answer = kind.unpack(frame.payload) if kind else None
        except ValueError:
            answer = None
        if answer is None:
            raise InputError(
                f"{self.url}: an answer of type {frame.type:#04x} that is unknown to this version; "
                "use the firmware of this version of anhyst",
                code="other-firmware",
            )
        if isinstance(answer, NakAnswer) and answer.reason == Reason.VERSION:
            raise self._make_version_error(answer.detail)
        if isinstance(answer, frames.InfoAnswer) and answer.version != frames.VERSION:
            raise self._make_version_error(answer.version)
        return answer

    def _make_version_error(self, version: int) -> InputError:
        return InputError(
            f"{self.url}: the firmware uses protocol version {version}, this anhyst version "
            f"{frames.VERSION}; build and flash the firmware of this anhyst",
            code="other-protocol-version",
        )

    def make_timeout_error(self) -> InputError:
        """Return the error for a controller that does not answer."""
        return InputError(
            f"{self.url}: no answer within {self.timeout * self.attempts:.1f} s; check that "
            "the controller runs, that cable and baud rate are correct, and that no other program "
            "uses the port",
            code="no-answer",
        )


def _is_answer_to(answer: Message, request: Message) -> bool:
    """Whether an answer belongs to this request, and not to a previous session."""
    if isinstance(answer, NakAnswer | frames.AckAnswer):
        return answer.request == request.TYPE
    return request.ANSWER == answer.TYPE


def _check_answer(url: str, request: Message, answer: Message, kind: type[_Answer]) -> _Answer:
    if isinstance(answer, kind):
        return answer
    if isinstance(answer, NakAnswer):
        raise RequestRefusedError(url, request, answer)
    text = f"{url}: {type(answer).__name__} in answer to {type(request).__name__}"
    raise InputError(text, code="unexpected-answer")


def _split_words(name: str) -> str:
    return "".join(f" {letter.lower()}" if letter.isupper() else letter for letter in name).strip()


MAX_WINDOW = 32
"""Maximum number of unanswered requests. The controller remembers as many answered requests."""


_READ_PAUSE_S = 0.2e-3
"""Pause between two reads, s: an emulated board sends single bytes, and every read takes time."""


@dataclass(slots=True)
class _SentDemand:
    """A demand that was sent, with its status if it was answered."""

    force: int
    sequence: int
    wire: bytes
    attempts: int = 1
    status: Status | None = None


def demand_request(force: int) -> frames.DemandRequest:
    """Return the request for a force that is given as q31 of the full-scale force."""
    if not -(1 << 31) <= force < 1 << 31:
        text = f"demand {force}: does not fit q31; keep it within -2^31 and 2^31 - 1"
        raise InputError(text, code="beyond-full-scale", key="demand")
    return frames.DemandRequest(int(force))


class _DemandWindow:
    """Several demands without answer at the same time; none is lost or reordered."""

    def __init__(self, controller: ControllerLink) -> None:
        self.controller = controller
        self.unanswered_demands: deque[_SentDemand] = deque()
        self._deadline = 0.0

    def send(self, forces: Iterable[int]) -> None:
        """Send several demands in one write."""
        new_demands = [self._make_demand(force) for force in forces]
        if new_demands:
            self.unanswered_demands.extend(new_demands)
            self._send_demands(new_demands)

    def _make_demand(self, force: int) -> _SentDemand:
        sequence = self.controller.next_sequence()
        return _SentDemand(force, sequence, encode(demand_request(force), sequence))

    def _send_demands(self, demands: Iterable[_SentDemand]) -> None:
        self.controller.send(b"".join(demand.wire for demand in demands))
        self._deadline = time.monotonic() + self.controller.timeout

    def receive(self) -> None:
        """Process the answers that arrive, and repeat lost demands."""
        if len(self.unanswered_demands) > 1:
            time.sleep(_READ_PAUSE_S)
        answers = self.controller.receive(max(self._deadline - time.monotonic(), 0.0))
        demands_by_number = {demand.sequence: demand for demand in self.unanswered_demands}
        for frame in answers:
            demand = demands_by_number.get(frame.sequence)
            if demand is not None and demand.status is None and not self._store_answer(demand, frame):
                return
        oldest_demand = self.unanswered_demands[0]
        if oldest_demand.status is not None:
            return
        if time.monotonic() >= self._deadline:
            self._repeat_demands([demand for demand in self.unanswered_demands if demand.status is None])
        elif oldest_demand.attempts == 1 and any(demand.status for demand in self.unanswered_demands):
            self._repeat_demands([oldest_demand])  # A newer demand was answered, so this one was lost.

    def _store_answer(self, demand: _SentDemand, frame: Frame) -> bool:
        """Store an answer; return False if this demand and all later ones had to be sent again."""
        answer = self.controller.read_answer(frame)
        if isinstance(answer, frames.StatusAnswer):
            demand.status = Status(frame.tick, answer)
            return True
        if isinstance(answer, NakAnswer) and answer.reason == Reason.OLD:
            self._renumber_from(demand)
            return False
        raise InputError(f"{self.controller.url}: {answer} in answer to a demand", code="unexpected-answer")

    def _repeat_demands(self, demands: list[_SentDemand]) -> None:
        if demands[0].attempts >= self.controller.attempts:
            raise self.controller.make_timeout_error()
        for demand in demands:
            demand.attempts += 1
        self.controller.repeated_count += len(demands)
        self._send_demands(demands)

    def _renumber_from(self, oldest_lost: _SentDemand) -> None:
        """Send a demand and all later ones again, because a newer one was accepted before."""
        demands = list(self.unanswered_demands)
        lost_index = demands.index(oldest_lost)
        renumbered = [self._make_demand(demand.force) for demand in demands[lost_index:]]
        self.controller.repeated_count += len(renumbered)
        self.unanswered_demands = deque(demands[:lost_index] + renumbered)
        self._send_demands(renumbered)

    def take_answered(self) -> Iterator[Status]:
        """Remove the statuses that are available, and yield them in order."""
        while self.unanswered_demands and self.unanswered_demands[0].status is not None:
            status = self.unanswered_demands.popleft().status
            if status is not None:
                yield status
