"""Test that clients with open but idle or slow connections do not block others."""

from __future__ import annotations

import http.client
import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import pytest

from anhyst_rigs.dashboard import connections
from anhyst_rigs.dashboard.connections import MAX_WAITING, MIN_WAIT_S
from tests.live.conftest import Serve, Served, wait_for
from tests.live.test_guard import get, meet, next_message

HALF = b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n"
ANSWERED_S = 2.0


@contextmanager
def half_open(served: Served, count: int, said: bytes = HALF) -> Iterator[list[socket.socket]]:
    with ExitStack() as open_sockets:
        yield [open_sockets.enter_context(said_half(served, said)) for _ in range(count)]


def said_half(served: Served, said: bytes) -> socket.socket:
    line = socket.create_connection(("127.0.0.1", served.port), timeout=10.0)
    line.sendall(said)
    return line


def is_closed(line: socket.socket) -> bool:
    line.setblocking(False)
    try:
        while line.recv(4096):
            pass
        return True
    except BlockingIOError:
        return False
    except ConnectionError:
        return True


def count_open(lines: list[socket.socket]) -> int:
    return sum(not is_closed(line) for line in lines)


def seconds_to_answer(served: Served) -> float:
    begun = time.monotonic()
    for path in ("/", "/assets/main.js", "/assets/live.css"):
        assert get(served, path).status == 200
    return time.monotonic() - begun


@pytest.mark.parametrize("said", [b"", HALF, b"POST / HTTP/1.1\r\nHost: a\r\nContent-Length: 9\r\n\r\n"])
def test_page_loads_beside_half_open_connections(serve: Serve, said: bytes) -> None:
    served = serve()
    with half_open(served, 200, said) as lines:
        assert seconds_to_answer(served) < ANSWERED_S
        time.sleep(MIN_WAIT_S)
        get(served)  # a new connection closes the oldest waiting ones
        wait_for(lambda: count_open(lines) <= MAX_WAITING)
        with meet(served) as line:
            assert next_message(line, "bench")["you"] == 1
        assert seconds_to_answer(served) < ANSWERED_S


def test_client_with_few_connections_is_not_closed_for_another(serve: Serve) -> None:
    """The oldest connection stays open, because another client has more connections."""
    served = serve()
    with socket.socket() as own:
        try:
            own.bind(("127.0.0.2", 0))
        except OSError:
            pytest.skip("127.0.0.2 is no address of this machine")
        own.connect(("127.0.0.1", served.port))
        begun = time.monotonic()
        with half_open(served, 2 * MAX_WAITING) as others:
            time.sleep(MIN_WAIT_S)
            get(served)
            wait_for(lambda: count_open(others) < MAX_WAITING)
            assert time.monotonic() - begun > connections.MAX_WAIT_S or not is_closed(own)


def test_slow_header_is_closed_in_time(serve: Serve, monkeypatch: pytest.MonkeyPatch) -> None:
    """Single bytes at intervals do not extend the time."""
    monkeypatch.setattr(connections, "MAX_WAIT_S", 1.0)
    served = serve()
    with half_open(served, 1, b"GET / HTTP/1.1\r\nX: ") as (line,):
        begun = time.monotonic()
        while not is_closed(line) and time.monotonic() - begun < 10.0:
            time.sleep(0.1)
            try:
                line.send(b"x")
            except ConnectionError:
                break
        assert 0.8 < time.monotonic() - begun < 3.0


def test_slow_body_is_closed_in_time(serve: Serve, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connections, "MAX_WAIT_S", 1.0)
    served = serve()
    said = f"POST / HTTP/1.1\r\nHost: 127.0.0.1:{served.port}\r\nContent-Length: 999\r\n\r\n"
    with half_open(served, 1, said.encode()) as (line,):
        begun = time.monotonic()
        try:
            while time.monotonic() - begun < 10.0:
                time.sleep(0.1)
                line.send(b"x")
        except ConnectionError:
            pass
        assert time.monotonic() - begun < 4.0


def test_websocket_stays_open_for_longer_than_a_request_may_take(
    serve: Serve, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connections, "MAX_WAIT_S", 0.5)
    served = serve()
    with meet(served) as line:
        next_message(line, "bench")
        with half_open(served, 2 * MAX_WAITING):
            until = time.monotonic() + 2.0
            while time.monotonic() < until:
                next_message(line, "status")
    assert served.session.end_reason == ""


def test_connection_serves_one_request_after_the_other(serve: Serve, monkeypatch: pytest.MonkeyPatch) -> None:
    """The time starts at the previous answer, not at the start of the connection."""
    monkeypatch.setattr(connections, "MAX_WAIT_S", 0.6)
    served = serve()
    line = http.client.HTTPConnection("127.0.0.1", served.port, timeout=10)
    line.connect()
    own = line.sock
    for _ in range(4):
        time.sleep(0.3)
        line.request("GET", "/assets/main.js")
        answer = line.getresponse()
        assert answer.status == 200
        assert answer.read()
    assert line.sock is own
    line.close()
