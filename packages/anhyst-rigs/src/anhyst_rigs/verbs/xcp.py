"""The command ``xcp``: connect a measurement tool to a controller on a serial port."""

from __future__ import annotations

from collections.abc import Callable

PLACE = 43, "During operation"


def xcp(port: str, listen: int = 5555, *, started: Callable[[int], None] | None = None) -> None:
    """Offer XCP over TCP for a serial controller, so that CANape, INCA or pyxcp can connect.

    XCP uses the link of the controller, so that one cable suffices. One tool can connect at a time.
    The firmware enforces the limits, the key and the heartbeat. Ctrl-C stops the command.

    Parameters
    ----------
    port : str, ``PORT``
        Link of a controller: /dev/ttyACM0, COM3 or socket://HOST:PORT.
    listen : int, 0 to 65535, ``NUMBER``
        TCP port on this machine for the tool; 0 selects a free port.
    started : callable, optional
        Called with the TCP port when the tool can connect.

    Raises
    ------
    InputError
        The port cannot be opened, or the firmware does not support XCP.

    Examples
    --------
    anhyst xcp /dev/ttyACM0
    """
    from anhyst.support.atomic import check_path
    from anhyst_rigs.link.client import ControllerLink
    from anhyst_rigs.link.xcp import XcpBridge

    check_path(port, "xcp: port", "the port of a controller")
    with ControllerLink(port) as controller:
        bridge = XcpBridge(controller, listen)
        if started is not None:
            started(bridge.port)
        try:
            while True:
                bridge.serve_one()
        finally:
            bridge.close()


def show_started(port: int) -> list[str]:
    """Return what the terminal shows while the command runs."""
    return [f"XCP on TCP: 127.0.0.1:{port}  ctrl-C ends it"]
