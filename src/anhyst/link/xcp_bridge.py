"""XCP on TCP for a controller that carries it in the frames of its own link."""

from __future__ import annotations

import select
import socket
from collections.abc import Callable, Iterator

from anhyst.link.client import ControllerLink, Refused
from anhyst.link.frames import Reason, XcpPacketsAnswer, XcpRequest
from anhyst.link.wire import framed, split
from anhyst.support.errors import InputError

_DISCONNECT = b"\xfe"
_PACE = 0.002
"""Between two questions for samples while none come, s."""

_PATIENCE = 5.0
"""How long a master may take no byte, s."""


class XcpBridge:
    """A port of this machine on which a master of XCP reaches the controller behind a link.

    One master at a time. What it sends goes to the controller as it is, so that every rule of the
    firmware holds: its key, its limits, its heartbeat, which this does not keep for it.
    """

    def __init__(self, controller: ControllerLink, port: int) -> None:
        self._controller = controller
        self._hang_up()
        try:
            self._listener = socket.create_server(("127.0.0.1", port))
        except OSError as error:
            raise InputError(
                f"port {port}: {error.strerror}; name another, or 0",
                code="port-not-open",
                key="port",
            ) from error
        self.port = int(self._listener.getsockname()[1])

    def close(self) -> None:
        """Listen no more."""
        self._listener.close()

    def serve_one(self) -> None:
        """Wait for a master and serve it until it is gone."""
        master, _ = self._listener.accept()
        with master:
            master.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            master.settimeout(_PATIENCE)
            try:
                self._serve(master)
            except OSError:
                pass  # it hung up, or takes nothing any more
            finally:
                self._hang_up()

    def _serve(self, master: socket.socket) -> None:
        arrived = b""
        counter = 0
        wait = _PACE
        while True:
            commands: list[bytes] = []
            if select.select([master], [], [], wait)[0]:
                data = master.recv(4096)
                if not data:
                    return
                commands, arrived, _, broken = split(arrived + data)
                if broken:
                    return
            packets = [packet for command in commands or [b""] for packet in self._carry(command)]
            wait = 0.0 if packets else _PACE
            if packets:
                master.sendall(b"".join(framed(one, counter + n) for n, one in enumerate(packets)))
                counter += len(packets)

    def _carry(self, command: bytes) -> list[bytes]:
        """Return what the slave says to a command, or to nothing."""
        answer = self._controller.request(XcpRequest(tuple(command)), XcpPacketsAnswer)
        return list(_packets(bytes(answer.packets)))

    def _hang_up(self) -> None:
        """Let no master find what another left behind: its key, its samples."""
        try:
            self._carry(_DISCONNECT)
            while self._carry(b""):
                pass
        except Refused as refused:
            if refused.reason is not Reason.TYPE:
                raise
            raise InputError(
                f"{self._controller.url}: this firmware carries no XCP; build it with this anhyst",
                code="no-xcp",
            ) from None


def _packets(answer: bytes) -> Iterator[bytes]:
    """Take the packets out of an answer."""
    at = 0
    while at < len(answer):
        yield answer[at + 1 : at + 1 + answer[at]]
        at += 1 + answer[at]


def xcp(port: str, listen: int = 5555, *, started: Callable[[int], None] | None = None) -> None:
    """Offer XCP on TCP for a controller on a serial port, until ctrl-C.

    Parameters
    ----------
    port : str
        Link of the controller: ``/dev/ttyACM0``, ``COM3`` or ``socket://HOST:PORT``.
    listen : int
        Port of this machine for the tool; 0 takes a free one.
    started : callable, optional
        Called with that port once it listens.

    Raises
    ------
    InputError
        The port cannot be opened, or the firmware carries no XCP.
    """
    with ControllerLink(port) as controller:
        bridge = XcpBridge(controller, listen)
        if started is not None:
            started(bridge.port)
        try:
            while True:
                bridge.serve_one()
        finally:
            bridge.close()
