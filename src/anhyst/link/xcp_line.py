"""The PC's end of a line that carries XCP: commands and their answers, samples beside them."""

from __future__ import annotations

import threading
import time
from collections import deque
from queue import Empty, Queue

from anhyst.link.transport import Port
from anhyst.link.wire import framed, split
from anhyst.support.errors import InputError

_EVENT = 0xFD
_COMMAND_LEAST = 0xFC
_SYNCH, _IN_STEP = b"\xfc", b"\xfe\x00"
_POLL_S = 0.05
_SILENCE_S = 0.12
"""After it a controller forgets what was left half said, s."""

_TOGETHER_S = 0.001
"""What comes within it is taken at once: to wake up costs more than to read, s."""

_ANSWER_S = 1.0
"""For an answer on a serial port, where one may get lost, s."""

_MOST = 1 << 19
"""Samples that wait to be taken; more, and the oldest are lost."""


class AnswerLost(InputError):  # noqa: N818 - the command may have been done
    """A serial port lost an answer; the line is in step again."""


class XcpLine:
    """An open line. One command at a time; a thread of its own takes what comes."""

    def __init__(self, url: str, timeout: float) -> None:
        self.url = url
        self.timeout = timeout
        self.serial = not url.startswith("socket://")
        self.overloads = 0
        self.skipped = 0
        self.lock = threading.RLock()
        self._answers: Queue[bytes] = Queue()
        self._samples: deque[bytes] = deque(maxlen=_MOST)
        self._came = threading.Condition()
        self._gone = threading.Event()
        self._port = Port(url)
        if self.serial:
            time.sleep(_SILENCE_S)
        self._reader = threading.Thread(target=self._read, name="xcp", daemon=True)
        self._reader.start()

    def close(self) -> None:
        """Hang up."""
        self._gone.set()
        self._reader.join()
        self._port.close()

    def ask(self, command: bytes) -> bytes:
        """Send a command and return its answer."""
        with self.lock:
            self._port.write(self._framed(command))
            answer = self._next()
            if answer is None and self.serial and not self._gone.is_set():
                self._synchronise()  # a late answer would be taken for that to the next command
                raise AnswerLost(
                    f"{self.url}: an answer was lost; see whether the command was done",
                    code="answer-lost",
                )
            if answer is None:
                self._gone.set()
                raise self.lost()
            return answer

    def take(self) -> bytes:
        """Return the samples that came, one behind the other; waits for the first."""
        with self._came:
            self._came.wait_for(lambda: self._samples or self._gone.is_set(), self.timeout)
            if not self._samples:
                raise self.lost() if self._gone.is_set() else self._stands()
            packets = b"".join(self._samples)
            self._samples.clear()
        return packets

    def lost(self) -> InputError:
        """Return the error of a controller that hung up or does not answer."""
        return InputError(
            f"{self.url}: the controller is gone; see its power and the line", code="port-gone"
        )

    def _stands(self) -> InputError:
        return InputError(
            f"{self.url}: no tick came for {self.timeout:g} s; the controller stands",
            code="no-tick",
        )

    def _next(self) -> bytes | None:
        end = time.monotonic() + (_ANSWER_S if self.serial else self.timeout)
        while time.monotonic() < end and not self._gone.is_set():
            try:
                return self._answers.get(timeout=_POLL_S)
            except Empty:
                continue
        return None

    def _synchronise(self) -> None:
        """Be in step again with a controller one of whose answers was lost."""
        for _ in range(3):
            self._port.write(self._framed(_SYNCH))
            while (answer := self._next()) is not None:
                if answer == _IN_STEP:
                    return
        self._gone.set()
        raise self.lost()

    def _framed(self, packet: bytes) -> bytes:
        return framed(packet, serial=self.serial)

    def _read(self) -> None:
        rest = b""
        try:
            while not self._gone.is_set():
                packets, rest = self._split(rest + self._port.read(_POLL_S))
                self._hand_on(packets)
                time.sleep(_TOGETHER_S)
        except InputError:
            pass  # whoever waits learns of it below
        with self._came:
            self._gone.set()
            self._came.notify_all()

    def _split(self, data: bytes) -> tuple[list[bytes], bytes]:
        """Return whole packets, and the rest."""
        packets = split(data, self.serial)
        self.skipped += packets.skipped
        if packets.broken:
            raise InputError(f"{self.url}: does not speak XCP", code="no-xcp")
        return packets.packets, packets.rest

    def _hand_on(self, packets: list[bytes]) -> None:
        samples = [packet for packet in packets if packet[0] < _COMMAND_LEAST]
        for packet in packets:
            if packet[0] == _EVENT:
                self.overloads += 1
            elif packet[0] > _EVENT:
                self._answers.put(packet)
        if samples:
            with self._came:
                self._samples.extend(samples)
                self._came.notify_all()
