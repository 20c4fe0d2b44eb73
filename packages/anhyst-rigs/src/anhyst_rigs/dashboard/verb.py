"""Open a rig or a running controller in a browser until ctrl-C: the command ``live``."""

from __future__ import annotations

import gc
import secrets
import socket
import sys
from collections.abc import Callable
from pathlib import Path

import uvicorn

from anhyst.support.atomic import PathLike, check_path
from anhyst.support.errors import InputError
from anhyst.support.jobs import Progress
from anhyst.support.kinds import COMPILED_FOLDER, file_kind
from anhyst_rigs.dashboard.browsers import allowed_host_names, read_address
from anhyst_rigs.dashboard.connections import make_quiet_server
from anhyst_rigs.dashboard.improver import BlockHolder, Improver
from anhyst_rigs.dashboard.recording import RecordingFile, start_recording
from anhyst_rigs.dashboard.server import MAX_MESSAGE_BYTES, LiveServer
from anhyst_rigs.dashboard.session import LiveSession
from anhyst_rigs.dashboard.starting import serve_start_page
from anhyst_rigs.rig.bench.foreign import is_description, open_foreign
from anhyst_rigs.rig.bench.pace import raised_priority
from anhyst_rigs.rig.bench.protocol import Bench
from anhyst_rigs.study.bench import controller_url, open_board, prepare_board, prepare_cached
from anhyst_rigs.study.prepared_benches import Prepared
from anhyst_rigs.study.tracking.online_calibration import BenchCalibrator

_MAX_CONNECTIONS = 512
"""Maximum number of connections: half of the number of files that most systems allow a process."""

_PING_TIMEOUT_S = 60.0
"""Time limit of a browser's answer to a ping, s; later, the browser counts as gone. A slow one
draws first.
"""

_SHUTDOWN_S = 2
"""Time for browsers to disconnect when the server ends, s."""


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


def make_server(
    session: LiveSession, title: str, address: tuple[str, int], token: str = ""
) -> uvicorn.Server:
    """Return the server for the page of a session."""
    return make_quiet_server(
        LiveServer(session, title, allowed_host_names(*address), token).app,
        ws="websockets-sansio",
        ws_max_size=MAX_MESSAGE_BYTES,
        ws_per_message_deflate=False,
        ws_ping_timeout=_PING_TIMEOUT_S,
        limit_concurrency=_MAX_CONNECTIONS,
        timeout_graceful_shutdown=_SHUTDOWN_S,
    )


_SWITCH_INTERVAL_S = 0.5e-3
"""Time after which a thread must yield to the pacer, s; Python's 5 ms would be several chunks."""


def reduce_latency() -> None:
    """Reduce the delays of the pacer that other threads and the garbage collection cause."""
    sys.setswitchinterval(_SWITCH_INTERVAL_S)
    gc.collect()
    gc.freeze()


def serve(
    session: LiveSession,
    title: str,
    listening_socket: socket.socket,
    token: str = "",
    started: Callable[[str], None] | None = None,
) -> None:
    """Serve the page of a session until ctrl-C, then end the session."""
    host, port = listening_socket.getsockname()[:2]
    server = make_server(session, title, (host, port), token)
    reduce_latency()
    session.start()
    try:
        if started is not None:
            started(f"http://{f'[{host}]' if ':' in host else host}:{port}/")
        with raised_priority():
            server.run(sockets=[listening_socket])
    except KeyboardInterrupt:
        pass  # Ctrl-C is the normal end of the server.
    finally:
        session.close()
        listening_socket.close()


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
    if url is None and (is_description(Path(rig)) or file_kind(rig) is COMPILED_FOLDER):
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
        with serve_start_page(listening_socket, title, build_title) as start_progress:

            def report_progress(completed: float, total: float) -> None:
                start_progress.update(completed, total)
                if progress is not None:
                    progress(completed, total)

            bench, improver, learner = _open_bench(rig, controller, url, known, report_progress)
            try:
                recording = (
                    None
                    if recording_path is None
                    else start_recording(recording_path, bench.signals, bench.rate)
                )
            except BaseException:
                bench.close()
                raise
        session = LiveSession(
            bench,
            recording,
            Path() if recording_path is None else recording_path.parent,
            improver,
            improver.known_model.curves if improver else (),
            learner,
        )
        serve(
            session,
            title,
            listening_socket,
            token_text,
            started and (lambda address: started(address, token_text)),
        )
    return recording


def _open_bench(
    rig: Path, controller: PathLike | None, url: str | None, known: PathLike | None, progress: Progress | None
) -> tuple[Bench, Improver | None, BenchCalibrator | None]:
    """Open a virtual rig or a running controller, with an improver and an estimator if possible."""
    if url is not None and rig.is_file():
        return open_foreign(rig, url), None, None
    if url is not None:
        on_board = None if known is None else prepare_board(known, rig)
        board_bench = open_board(rig, url)
        return board_bench, None if on_board is None else Improver(on_board, board_bench), None
    with prepare_cached(rig, controller, progress) as prepared:
        return open_prepared(prepared)  # The firmware does not need the folder any more.


def open_prepared(prepared: Prepared) -> tuple[Bench, Improver | None, BenchCalibrator | None]:
    """Open a prepared rig with its improver and its estimator."""
    bench, learner = prepared.open_with_learner()
    if prepared.improvable is None:
        return bench, None, learner
    assert isinstance(bench, BlockHolder)
    return bench, Improver(prepared.improvable, bench), learner
