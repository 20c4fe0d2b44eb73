"""The command ``live``: show and operate a running rig in a browser."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from anhyst.support.atomic import PathLike
    from anhyst.support.jobs import Progress
    from anhyst_rigs.dashboard.recording import RecordingFile

PLACE = 41, "During operation"
REQUIRED_PACKAGES = ("orjson", "starlette", "uvicorn", "websockets")
"""Packages that the page needs in addition to anhyst."""


def live(
    rig: PathLike,
    controller: PathLike | None = None,
    *,
    xcp: str | None = None,
    port: str | None = None,
    known: PathLike | None = None,
    record: PathLike | None = None,
    listen: str = "127.0.0.1:8642",
    token: bool = False,
    progress: Progress | None = None,
    opened: Callable[[str, str], None] | None = None,
    started: Callable[[str, str], None] | None = None,
) -> RecordingFile | None:
    """Show, operate and record a running rig in a browser.

    The controller is compiled and built into the firmware. The firmware levitates the simulated
    bearing, or drives the simulated magnet, in real time. With `xcp` or `port`, the firmware
    already runs on a board. A stage follows its set-point, and a piezo stage its triangle; both run
    without firmware. The page shows the signals and operates the rig. Ctrl-C stops the command.

    Parameters
    ----------
    rig : path-like
        Rig file of any kind. With `xcp` or `port`, the compiled folder of the firmware, or the A2L
        or ELF file of any firmware with XCP.
    controller : path-like, ``FILE``, optional
        Controller file. [default: 'controller.toml' next to the rig file]
    xcp : str, ``HOST:PORT``, optional
        Use a controller that runs independently and offers XCP at this address, instead of a
        simulated rig.
    port : str, ``PORT``, optional
        The same through a serial port with XCP, such as /dev/ttyACM0.
    known : path-like, ``--rig FILE``, optional
        Rig file of the actuator, with `xcp` or `port` only, to improve its model.
    record : path-like, ``FILE``, optional
        Write every tick from the first one to a new .csv or .mf4 (MDF) file. The page writes its
        recordings to the same folder, or to the working folder.
    listen : str, ``ADDRESS``
        Address of the page: HOST:PORT in digits, or PORT on this machine. Access from other
        machines requires `token`.
    token : bool
        Accept only browsers that send a token, which the command prints.
    progress : callable, optional
        Called with the work done and the total work while the rig is opened.
    opened : callable, optional
        Called with the address of the page and the token, which may be empty, before the rig is
        opened. The page shows the steps of the start.
    started : callable, optional
        Called with the same values when the rig runs.

    Returns
    -------
    RecordingFile or None
        The recording.

    Raises
    ------
    InputError
        A package is not installed, a file cannot be read or written, an address is not free, or no
        controller answers.

    Examples
    --------
    anhyst live examples/bearing/rig.toml

    anhyst live examples/piezo/rig.toml

    anhyst live firmware.a2l --xcp 192.168.1.7:5555
    """
    from importlib.util import find_spec

    from anhyst.support.errors import InputError

    for name in REQUIRED_PACKAGES:
        if find_spec(name) is None:
            text = f"live: {name} is not installed: pip install 'anhyst-rigs[live]'"
            raise InputError(text, code="not-installed", key=name)
    from anhyst_rigs.dashboard.verb import live as work

    return work(
        rig, controller, xcp=xcp, port=port, known=known, record=record, listen=listen,
        token=token, progress=progress, opened=opened, started=started,
    )  # fmt: skip


def show_opened(address: str, token: str) -> list[str]:
    """Return the output when the page is open: the address and the token."""
    return [*([f"token: {token}"] if token else []), f"{address}  ctrl-C ends it"]


def show_started(_address: str, _token: str) -> list[str]:
    """Return the output when the rig runs."""
    return ["the rig runs"]


def show(result: RecordingFile | None, _: Mapping[str, Any]) -> list[str]:
    """Return the terminal output after the command has ended: the recording."""
    from anhyst.support.wording import count_text

    if result is None:
        return []
    return [f"written: {result.path}, {count_text(result.rows, 'tick')}"]
