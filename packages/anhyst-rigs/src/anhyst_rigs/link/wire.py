"""Encode and decode frames, and open the ports that carry them.

Frames of the link contain a checksum, are encoded with COBS, and end with a zero byte
(``firmware/link/frame.c``). An XCP packet begins with a length and a counter of 16 bits each. On a
serial port, it is padded to whole words, followed by the sum of all words as a checksum
(``firmware/xcp/line.h``). A port is a serial port, a pseudo-terminal or a TCP socket.
"""

from __future__ import annotations

import errno
import os
import select
import socket
import struct
import zlib
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

from anhyst.support.errors import InputError
from anhyst.support.states import Fault, State
from anhyst.support.xcp_map import MAX_PACKET_BYTES, SEED_SECRET
from anhyst_rigs.link.frames import VERSION, Message, StatusAnswer

_FRAME_HEADER = struct.Struct("<BBBBI")
_CHECKSUM_FORMAT = struct.Struct("<I")
_MAX_FRAME_BYTES = 254
"""Number of stored bytes of an incomplete frame; every frame is shorter."""


class Frame(NamedTuple):
    """A frame that arrived without errors."""

    version: int
    type: int
    sequence: int
    tick: int
    payload: bytes


@dataclass(frozen=True, slots=True)
class Status:
    """The status of a controller at one tick."""

    tick: int  # number of the tick to which the frame belongs
    codes: StatusAnswer  # codes that were received

    @property
    def state(self) -> State:
        """State of the controller."""
        return State(self.codes.state)

    @property
    def fault(self) -> Fault:
        """Fault that the controller has latched."""
        return Fault(self.codes.fault)

    @property
    def drive(self) -> float:
        """Driven current, as a fraction of the full-scale current."""
        return self.codes.drive / (1 << 31)


def encode(message: Message, sequence: int, tick: int = 0, version: int = VERSION) -> bytes:
    """Return a message as a frame that ends with a zero byte."""
    payload = message.pack()
    body = _FRAME_HEADER.pack(version, message.TYPE, sequence, len(payload), tick) + payload
    return cobs_encode(body + _CHECKSUM_FORMAT.pack(zlib.crc32(body))) + b"\0"


def cobs_encode(body: bytes) -> bytes:
    """Encode up to 253 bytes by COBS, so that they contain no zero bytes."""
    return b"".join(bytes((len(block) + 1,)) + block for block in body.split(b"\0"))


def cobs_decode(encoded: bytes) -> bytes | None:
    """Decode the result of :func:`cobs_encode`; return None for bytes that are not such a result."""
    body = bytearray(encoded)
    index = 0
    while index < len(encoded):
        block_length, body[index] = encoded[index], 0
        if block_length == 0:
            return None
        index += block_length
    return bytes(body[1:]) if index == len(encoded) else None


class Receiver:
    """A search for frames in a stream of bytes; after invalid bytes, a zero byte synchronises it."""

    def __init__(self) -> None:
        self.bad_count = 0
        self._incomplete = b""

    def feed(self, data: bytes) -> list[Frame]:
        """Add received bytes; return the frames that are then complete."""
        if not data:
            return []
        *packets, incomplete = (self._incomplete + data).split(b"\0")
        frames = []
        for packet in packets:
            frame = _parse_frame(packet)
            if frame is not None:
                frames.append(frame)
            elif packet:
                self.bad_count += 1
        self._incomplete = incomplete[-_MAX_FRAME_BYTES:]
        return frames


def _parse_frame(encoded: bytes) -> Frame | None:
    body = cobs_decode(encoded)
    if body is None or len(body) < _FRAME_HEADER.size + _CHECKSUM_FORMAT.size:
        return None
    frame = body[: -_CHECKSUM_FORMAT.size]
    version, kind, sequence, length, tick = _FRAME_HEADER.unpack_from(frame)
    payload = frame[_FRAME_HEADER.size :]
    if length != len(payload) or body[-_CHECKSUM_FORMAT.size :] != _CHECKSUM_FORMAT.pack(zlib.crc32(frame)):
        return None
    return Frame(version, kind, sequence, tick, payload)


class Framing(NamedTuple):
    """Head and tail of the XCP packets on a line."""

    head: str = "<HH"  # format of the length, and of a counter or of fill bytes
    checksum_bytes: int = 0  # size of the sum behind a packet; 0 on TCP, which needs none
    max_packet_bytes: int = MAX_PACKET_BYTES

    @property
    def has_counter(self) -> bool:
        """Whether the head counts the packets."""
        return len(self.head) == 3 and "x" not in self.head


TCP_FRAMING = Framing()
SERIAL_FRAMING = Framing(checksum_bytes=2)
"""Framing of the second serial port of a board."""


class SplitResult(NamedTuple):
    """Received bytes, divided into packets."""

    packets: list[bytes]  # complete packets
    incomplete_bytes: bytes  # beginning of a packet that is incomplete
    skipped_bytes: int  # number of serial bytes that do not belong to a complete packet
    is_broken: bool  # whether the remaining bytes cannot be a packet (only TCP)


def frame_packet(packet: bytes, counter: int = 0, framing: Framing = TCP_FRAMING) -> bytes:
    """Return an XCP packet with its head, and on a serial port with its checksum."""
    fields = [len(packet), counter & (0xFF if "B" in framing.head else 0xFFFF)]
    line_bytes = struct.pack(framing.head, *fields[: 1 + framing.has_counter]) + packet
    line_bytes += b"\0" * (len(line_bytes) % 2 if framing.checksum_bytes == 2 else 0)
    return line_bytes + _checksum(line_bytes, framing)


def split_packets(data: bytes, framing: Framing = TCP_FRAMING) -> SplitResult:
    """Split received bytes into packets; if there is a checksum, invalid bytes are skipped."""
    position, skipped_bytes = 0, 0
    packets: list[bytes] = []
    head = struct.Struct(framing.head)
    while position + head.size <= len(data):
        length = head.unpack_from(data, position)[0]
        begin = position + head.size
        end = begin + length
        end += (end - position) % 2 if framing.checksum_bytes == 2 else 0
        packet_end = end + framing.checksum_bytes
        is_possible = 0 < length <= framing.max_packet_bytes
        if is_possible and packet_end > len(data):
            break
        if is_possible and _checksum(data[position:end], framing) == data[end:packet_end]:
            packets.append(data[begin : begin + length])
            position = packet_end
        elif framing.checksum_bytes:
            skipped_bytes += 1
            position += 1
        else:
            return SplitResult(packets, data[position:], 0, True)
    return SplitResult(packets, data[position:], skipped_bytes, False)


def _checksum(data: bytes, framing: Framing) -> bytes:
    """Return the sum of all bytes or of all words, with the low byte first."""
    size = framing.checksum_bytes
    total = sum(struct.unpack(f"<{len(data) // 2}H", data) if size == 2 else data if size else b"")
    return (total & ((1 << 8 * size) - 1)).to_bytes(size, "little")


def compute_key(seed: bytes, secret: int = SEED_SECRET) -> bytes:
    """Return the key that belongs to a seed.

    The key prevents accidental writes by tools that should only measure. It is not secret.
    """
    return zlib.crc32(seed, secret).to_bytes(4, "little")


BAUD = 921600

_WRITE_TIMEOUT_S = 5.0
"""Longest time in which a port accepts no byte, s."""

_ERROR_TEXTS = {
    errno.ENOENT: "is missing; connect the controller, or enter another port",
    errno.ENXIO: "is missing; connect the controller, or enter another port",
    errno.EACCES: "permission denied; join the group that owns it (often dialout)",
    errno.EBUSY: "is used by another program; close that program",
    errno.EWOULDBLOCK: "is used by another program; close that program",
    errno.ENOTTY: "is not a serial port; enter a port such as /dev/ttyACM0 or socket://host:port",
}


class LinkPort(Protocol):
    """An open port of a link."""

    url: str  # name of the port

    def write(self, data: bytes) -> None:
        """Send bytes."""

    def read(self, timeout: float) -> bytes:
        """Return the received bytes after at most `timeout`, s."""

    def close(self) -> None:
        """Close the port."""


class Port:
    """A port that the operating system has opened."""

    def __init__(self, url: str, baud: int = BAUD) -> None:
        self.url = url
        self._serial = _open_serial(url, baud)
        self._fd = _file_descriptor(self._serial)
        if url.startswith("socket://") and self._fd is not None:
            with socket.socket(fileno=os.dup(self._fd)) as connection:
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def close(self) -> None:
        """Close the port."""
        connection = getattr(self._serial, "_socket", None)
        self._serial.close()
        if connection is not None:
            connection.close()  # pyserial does not close it if the other end was closed first

    def write(self, data: bytes) -> None:
        """Send bytes, and return when the operating system has accepted all of them."""
        import serial

        try:
            if self._fd is None:
                self._serial.write(data)
                return
            while data:
                if not select.select([], [self._fd], [], _WRITE_TIMEOUT_S)[1]:
                    raise OSError(errno.EIO, "no byte was accepted")
                with suppress(BlockingIOError):
                    data = data[os.write(self._fd, data) :]
        except (OSError, serial.SerialException) as error:
            raise self._make_gone_error() from error

    def read(self, timeout: float) -> bytes:
        """Return the received bytes; wait at most `timeout`, s, for the first byte."""
        import serial

        try:
            if self._fd is None:
                self._serial.timeout = timeout
                first_byte: bytes = self._serial.read(1)
                return first_byte + bytes(self._serial.read(self._serial.in_waiting))
            if not select.select([self._fd], [], [], timeout)[0]:
                return b""
            try:
                data = os.read(self._fd, 65536)
            except BlockingIOError:
                return b""
        except (OSError, serial.SerialException) as error:
            raise self._make_gone_error() from error
        if not data:
            raise self._make_gone_error()
        return data

    def _make_gone_error(self) -> InputError:
        return InputError(
            f"{self.url}: the port is gone; check the cable and the power of the controller", code="port-gone"
        )


def _open_serial(url: str, baud: int) -> Any:
    try:
        import serial
    except ImportError as error:
        text = "pyserial is not installed; install it with: pip install 'anhyst-rigs[link]'"
        raise InputError(text, code="not-installed", key="pyserial") from error
    try:
        return serial.serial_for_url(url, baudrate=baud, timeout=0, exclusive=True)
    except serial.SerialException as error:
        raise InputError(f"{url}: {_explain_error(error)}", code="port-not-open") from error
    except ValueError as error:
        raise InputError(
            f"{url}: {error}; enter a port or socket://host:port", code="port-not-open"
        ) from error
    except OSError as error:
        raise InputError(f"{url}: {_explain_error(error)}", code="port-not-open") from error


def _explain_error(error: Exception) -> str:
    error_number = getattr(error, "errno", None)
    if error_number is None and isinstance(error.__context__, OSError):
        error_number = error.__context__.errno
    if error_number in _ERROR_TEXTS:
        return _ERROR_TEXTS[error_number]
    text = str(error)
    if "refused" in text:
        return "connection refused; start the controller first"
    if "exclusively lock" in text:
        return _ERROR_TEXTS[errno.EBUSY]
    if "configure port" in text:
        return _ERROR_TEXTS[errno.ENOTTY]
    return f"cannot be opened: {text}; enter another port"


def _file_descriptor(port: Any) -> int | None:
    """Return the file descriptor on POSIX systems for faster reads than those of pyserial."""
    try:
        return int(port.fileno()) if os.name == "posix" else None
    except (AttributeError, OSError):
        return None
