"""Open the bench of a rig, and serve the page of its session until ctrl-C."""

from __future__ import annotations

import gc
import socket
import sys
from collections.abc import Callable
from pathlib import Path

import uvicorn

from anhyst.support.atomic import PathLike
from anhyst.support.jobs import Progress, begin_step
from anhyst_rigs.dashboard.browsers import allowed_host_names
from anhyst_rigs.dashboard.connections import make_quiet_server
from anhyst_rigs.dashboard.improver import BlockHolder, Improver
from anhyst_rigs.dashboard.recording import RecordingFile, start_recording
from anhyst_rigs.dashboard.server import MAX_MESSAGE_BYTES, LiveServer
from anhyst_rigs.dashboard.session import LiveSession
from anhyst_rigs.rig.bench.foreign import open_foreign
from anhyst_rigs.rig.bench.pace import raised_priority
from anhyst_rigs.rig.bench.protocol import Bench
from anhyst_rigs.study.bench import open_board, prepare_board, prepare_cached
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
    started: Callable[[], None] | None = None,
) -> None:
    """Serve the page of a session until ctrl-C, then end the session."""
    server = make_server(session, title, listening_socket.getsockname()[:2], token)
    reduce_latency()
    session.start()
    try:
        if started is not None:
            started()
        with raised_priority():
            server.run(sockets=[listening_socket])
    except KeyboardInterrupt:
        pass  # Ctrl-C is the normal end of the server.
    finally:
        session.close()
        listening_socket.close()


def open_session(
    rig: Path,
    controller: PathLike | None,
    url: str | None,
    known: PathLike | None,
    recording_path: Path | None,
    progress: Progress,
) -> tuple[LiveSession, RecordingFile | None]:
    """Open a rig or a running controller, and return the session that will run it, and its recording."""
    bench, improver, learner = _open_bench(rig, controller, url, known, progress)
    try:
        recording = (
            None if recording_path is None else start_recording(recording_path, bench.signals, bench.rate)
        )
        session = LiveSession(
            bench,
            recording,
            Path() if recording_path is None else recording_path.parent,
            improver,
            improver.known_model.curves if improver else (),
            learner,
        )
    except BaseException:
        bench.close()
        raise
    return session, recording


def _open_bench(
    rig: Path, controller: PathLike | None, url: str | None, known: PathLike | None, progress: Progress | None
) -> tuple[Bench, Improver | None, BenchCalibrator | None]:
    """Open a virtual rig or a running controller, with an improver and an estimator if possible."""
    if url is not None:
        begin_step("connect to the controller")
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
    begin_step("open the bench")
    bench, learner = prepared.open_with_learner()
    if prepared.improvable is None:
        return bench, None, learner
    assert isinstance(bench, BlockHolder)
    return bench, Improver(prepared.improvable, bench), learner
