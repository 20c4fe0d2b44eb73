"""Serve a session until somebody ends it."""

from __future__ import annotations

import gc
import socket
from collections.abc import Callable

import uvicorn

from anhyst.dashboard.guard import names_of
from anhyst.dashboard.server import MESSAGE_MOST, LiveServer
from anhyst.dashboard.session import LiveSession
from anhyst.support.errors import InputError

_HTTP_MOST = 64
"""Connections at a time, of pages that load and of those that are open."""

_SLOW_S = 60.0
"""A browser that has not read for so long has gone, s; a slow one has frames to draw before."""

_GO_S = 2
"""For browsers to go when the server ends, s."""


def listen_on(host: str, port: int) -> socket.socket:
    """Take an address."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    taken = socket.socket(family, socket.SOCK_STREAM)
    taken.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        taken.bind((host, port))
        taken.listen()
    except OSError as error:
        taken.close()
        raise InputError(
            f"--listen {host}:{port}: {error.strerror}; name another port",
            code="port-not-open",
            key="--listen",
        ) from None
    return taken


def make_server(
    session: LiveSession, title: str, address: tuple[str, int], token: str = ""
) -> uvicorn.Server:
    """Return the server of a page for a session."""
    return uvicorn.Server(
        uvicorn.Config(
            LiveServer(session, title, names_of(*address), token).app,
            ws="websockets-sansio",
            ws_max_size=MESSAGE_MOST,
            ws_per_message_deflate=False,
            ws_ping_timeout=_SLOW_S,
            limit_concurrency=_HTTP_MOST,
            timeout_graceful_shutdown=_GO_S,
            lifespan="off",
            log_level="critical",
            access_log=False,
            server_header=False,
        )
    )


def settle() -> None:
    """Let no collection of garbage go through all that stays, which takes tens of ms, later on."""
    gc.collect()
    gc.freeze()


def serve(
    session: LiveSession,
    title: str,
    taken: socket.socket,
    token: str = "",
    started: Callable[[str], None] | None = None,
) -> None:
    """Serve a page for a session until ctrl-C; the session is ended then."""
    host, port = taken.getsockname()[:2]
    server = make_server(session, title, (host, port), token)
    settle()
    session.start()
    try:
        if started is not None:
            started(f"http://{f'[{host}]' if ':' in host else host}:{port}/")
        server.run(sockets=[taken])
    except KeyboardInterrupt:
        pass  # the way to end it
    finally:
        session.close()
        taken.close()
