"""Open a rig or a running controller in a browser until ctrl-C: the command ``live``.

The port and the page are open before the libraries are loaded and the rig is read, which takes
seconds. Therefore, this module imports only what the page of the start needs.
"""

from __future__ import annotations

import secrets
import socket
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from anhyst.support.atomic import PathLike, check_path
from anhyst.support.errors import InputError
from anhyst.support.jobs import Progress, begin_step
from anhyst.support.kinds import COMPILED_FOLDER, FIRMWARE_FILE, file_kind
from anhyst_rigs.dashboard.browsers import read_address
from anhyst_rigs.dashboard.starting import serve_start_page

if TYPE_CHECKING:
    from anhyst_rigs.dashboard.recording import RecordingFile


def listen_on(host: str, port: int) -> socket.socket:
    """Return a socket that listens on an address."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listening_socket = socket.socket(family, socket.SOCK_STREAM)
    listening_socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening_socket.bind((host, port))
        listening_socket.listen(socket.SOMAXCONN)
    except OSError as error:
        listening_socket.close()
        raise InputError(
            f"--listen {host}:{port}: {error.strerror}; name another port",
            code="port-not-open",
            key="--listen",
        ) from None
    return listening_socket


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
    """Show, operate and record a rig in a browser until ctrl-C: `anhyst.live`."""
    check_path(rig, "live: rig", "the path of a rig file")
    url = controller_url(xcp, port)
    if url is None and known is not None:
        raise InputError(
            "--rig: the rig file of a virtual rig is the argument; leave --rig out",
            code="option-not-for-this",
            key="--rig",
        )
    is_foreign = url is not None and Path(rig).is_file()
    if is_foreign and known is not None:
        raise InputError(
            "--rig: the model of a foreign firmware cannot be improved; leave --rig out",
            code="option-not-for-this",
            key="--rig",
        )
    if url is not None and controller is not None:
        raise InputError(
            "--controller: a controller that runs has one already; leave it out",
            code="option-not-for-this",
            key="--controller",
        )
    if url is None and file_kind(rig) in (COMPILED_FOLDER, FIRMWARE_FILE):
        raise InputError(
            f"{rig}: runs on a controller; name it with --xcp or --port", code="options-missing", key="--xcp"
        )
    rig = Path(rig)
    recording_path = None if record is None else Path(record)
    token_text = secrets.token_urlsafe(16) if token else ""
    name = rig.resolve().parent.name if url is None else rig.resolve().name
    title = name if url is None else f"{name} at {url}"
    build_title = f"building model and controller of {name}" if url is None else f"connecting to {url}"
    with listen_on(*read_address(listen, token)) as listening_socket:
        host, port_number = listening_socket.getsockname()[:2]
        address = f"http://{f'[{host}]' if ':' in host else host}:{port_number}/"
        with serve_start_page(listening_socket, title, build_title) as start_progress:
            if opened is not None:
                opened(address, token_text)

            def report_progress(completed: float, total: float) -> None:
                start_progress.update(completed, total)
                if progress is not None:
                    progress(completed, total)

            begin_step("load the libraries of the bench")
            from anhyst_rigs.dashboard.serving import open_session, serve

            session, recording = open_session(rig, controller, url, known, recording_path, report_progress)
        serve(session, title, listening_socket, token_text, started and partial(started, address, token_text))
    return recording


def controller_url(xcp: str | None, port: str | None) -> str | None:
    """Return the XCP URL of a controller (TCP or serial); None if neither is given."""
    if xcp is not None and port is not None:
        raise InputError(
            "--port: one controller at a time; omit --port or --xcp", code="options-together", key="--port"
        )
    return port if xcp is None else f"socket://{xcp}"
