"""A serial port, a pty or a TCP socket: bytes out, bytes in."""

from __future__ import annotations

import errno
import os
import select
import socket
from contextlib import suppress
from typing import Any, Protocol

from anhyst.support.errors import InputError

BAUD = 921600

_PATIENCE = 5.0
"""How long a port may take no byte, s."""

_ADVICE = {
    errno.ENOENT: "is not there; plug the controller in, or name another port",
    errno.ENXIO: "is not there; plug the controller in, or name another port",
    errno.EACCES: "may not be opened; join the group that owns it (often dialout)",
    errno.EBUSY: "is taken by another program; close that first",
    errno.EWOULDBLOCK: "is taken by another program; close that first",
    errno.ENOTTY: "is not a serial port; name a port such as /dev/ttyACM0 or socket://host:port",
}


class LinkPort(Protocol):
    """An open port, as a link needs it."""

    url: str  # what it is called

    def write(self, data: bytes) -> None:
        """Send bytes."""

    def read(self, timeout: float) -> bytes:
        """Return what has arrived, after up to `timeout` seconds."""

    def close(self) -> None:
        """Let go of it."""


class Port:
    """An open port of the system."""

    def __init__(self, url: str, baud: int = BAUD) -> None:
        self.url = url
        self._serial = _open(url, baud)
        self._fd = _descriptor(self._serial)
        if url.startswith("socket://") and self._fd is not None:
            with socket.socket(fileno=os.dup(self._fd)) as same:
                same.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def close(self) -> None:
        """Let go of the port."""
        connection = getattr(self._serial, "_socket", None)
        self._serial.close()
        if connection is not None:
            connection.close()  # pyserial leaves it open where the other end hung up first

    def write(self, data: bytes) -> None:
        """Send bytes; returns once all are on their way."""
        import serial

        try:
            if self._fd is None:
                self._serial.write(data)
                return
            while data:
                if not select.select([], [self._fd], [], _PATIENCE)[1]:
                    raise OSError(errno.EIO, "it takes nothing")
                with suppress(BlockingIOError):
                    data = data[os.write(self._fd, data) :]
        except (OSError, serial.SerialException) as error:
            raise self._gone() from error

    def read(self, timeout: float) -> bytes:
        """Return what has arrived; waits up to `timeout` seconds for the first byte."""
        import serial

        try:
            if self._fd is None:
                self._serial.timeout = timeout
                first: bytes = self._serial.read(1)
                return first + bytes(self._serial.read(self._serial.in_waiting))
            if not select.select([self._fd], [], [], timeout)[0]:
                return b""
            try:
                data = os.read(self._fd, 65536)
            except BlockingIOError:
                return b""
        except (OSError, serial.SerialException) as error:
            raise self._gone() from error
        if not data:
            raise self._gone()
        return data

    def _gone(self) -> InputError:
        return InputError(
            f"{self.url}: the port is gone; see the cable and the controller's power",
            code="port-gone",
        )


def _open(url: str, baud: int) -> Any:
    try:
        import serial
    except ImportError as error:
        raise InputError(
            "pyserial is not installed; install it with: pip install 'anhyst[link]'",
            code="not-installed",
            key="pyserial",
        ) from error
    try:
        return serial.serial_for_url(url, baudrate=baud, timeout=0, exclusive=True)
    except serial.SerialException as error:
        raise InputError(f"{url}: {_why(error)}", code="port-not-open") from error
    except ValueError as error:
        raise InputError(
            f"{url}: {error}; name a port or socket://host:port", code="port-not-open"
        ) from error
    except OSError as error:
        raise InputError(f"{url}: {_why(error)}", code="port-not-open") from error


def _why(error: Exception) -> str:
    number = getattr(error, "errno", None)
    if number is None and isinstance(error.__context__, OSError):
        number = error.__context__.errno
    if number in _ADVICE:
        return _ADVICE[number]
    text = str(error)
    if "refused" in text:
        return "nobody listens there; start the controller first"
    if "exclusively lock" in text:
        return _ADVICE[errno.EBUSY]
    if "configure port" in text:
        return _ADVICE[errno.ENOTTY]
    return f"cannot be opened: {text}; name another port"


def _descriptor(port: Any) -> int | None:
    """Give the file descriptor where the system has one: reads are quicker past pyserial."""
    try:
        return int(port.fileno()) if os.name == "posix" else None
    except (AttributeError, OSError):
        return None
