"""Test each access limit of docs/live.md against a running server."""

from __future__ import annotations

import http.client
import json
import socket
from contextlib import ExitStack
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin

from anhyst.cli.app import main
from anhyst_rigs.dashboard.browsers import CONTENT_SECURITY_POLICY, read_address
from anhyst_rigs.dashboard.recording import RecordingSpan
from anhyst_rigs.dashboard.server import MAX_CLIENTS
from tests.live.conftest import Serve, Served, wait_for
from tests.refusals import refused, says


def get(served: Served, path: str = "/", **headers: str) -> http.client.HTTPResponse:
    line = http.client.HTTPConnection("127.0.0.1", served.port, timeout=10)
    line.request("GET", path, headers=headers)
    answer = line.getresponse()
    answer.read()
    line.close()
    return answer


def meet(served: Served, **options: Any) -> ClientConnection:
    options.setdefault("origin", Origin(f"http://127.0.0.1:{served.port}"))
    line: ClientConnection = connect(f"ws://127.0.0.1:{served.port}/live", max_size=None, **options)
    return line


def next_message(line: ClientConnection, kind: str) -> dict[str, Any]:
    while True:
        data = line.recv(timeout=20)
        if isinstance(data, str) and (message := json.loads(data))["kind"] == kind:
            return dict(message)


def order(line: ClientConnection, what: str, **fields: Any) -> dict[str, Any]:
    line.send(json.dumps({"do": what, "id": 5, **fields}))
    return next_message(line, "answer")


@pytest.mark.parametrize(
    ("text", "token", "why"),
    [
        ("192.168.1.5:8642", False, "token-missing"),
        ("0.0.0.0:8642", True, "bad-address"),
        ("here:8642", True, "bad-address"),
        ("127.0.0.1:99999", False, "out-of-range"),
    ],
)
def test_addresses_that_are_refused(text: str, token: bool, why: str) -> None:
    with refused(why):
        read_address(text, token)


def test_valid_addresses_are_accepted() -> None:
    assert read_address("8642", False) == ("127.0.0.1", 8642)
    assert read_address("[::1]:1", False) == ("::1", 1)
    assert read_address("192.168.1.5:8642", True) == ("192.168.1.5", 8642)


def test_host_and_origin_are_checked_on_http(serve: Serve) -> None:
    served = serve()
    here = f"127.0.0.1:{served.port}"
    assert get(served).status == 200
    assert get(served, Host=f"localhost:{served.port}").status == 200
    assert get(served, Origin=f"http://{here}").status == 200
    assert get(served, Host="evil.example").status == 403
    assert get(served, Host=f"evil.example:{served.port}").status == 403
    assert get(served, Origin="http://evil.example").status == 403
    assert get(served, "/assets/main.js", Host="evil.example").status == 403


def test_host_and_origin_are_checked_on_the_socket(serve: Serve) -> None:
    served = serve()
    for origin in ("http://evil.example", "null", None, "http://127.0.0.1:1"):
        with pytest.raises(InvalidStatus, match="403"):
            meet(served, origin=origin)
    # A foreign host name that resolves to this server matches its own origin, but must be rejected.
    with (
        socket.create_connection(("127.0.0.1", served.port)) as raw,
        pytest.raises(InvalidStatus, match="403"),
    ):
        connect("ws://evil.example/live", sock=raw, origin=Origin("http://evil.example"))
    with meet(served) as line:
        assert next_message(line, "bench")["you"] == 1


def test_the_page_may_load_only_its_own_files(serve: Serve) -> None:
    served = serve()
    for path in ("/", "/assets/main.js", "/assets/uplot/LICENSE"):
        answer = get(served, path)
        assert answer.status == 200
        assert answer.headers["content-security-policy"] == CONTENT_SECURITY_POLICY
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert answer.headers["set-cookie"] is None
    assert "unsafe" not in CONTENT_SECURITY_POLICY
    assert get(served, "/assets/../server.py").status == 404
    assert get(served, "/assets/%2e%2e/server.py").status == 404


def test_only_recordings_of_the_folder_are_sent_and_only_with_the_key(serve: Serve) -> None:
    served = serve(token="right-token")
    folder = served.session.recorder.folder
    (folder / "measured.csv").write_text("current_A,force_N\n0,0\n")
    (folder / "named.mf4").mkdir()
    recorder, record = served.session.recorder, served.session.record
    served.session.run_between_chunks(lambda: record("short.csv", RecordingSpan(0.0, 0.01)))
    wait_for(lambda: recorder.status() is None)
    served.session.run_between_chunks(lambda: record("unfinished.csv", RecordingSpan()))
    with meet(served) as line:
        line.recv(timeout=10)
        line.send(json.dumps({"token": "right-token"}))
        welcome = next_message(line, "bench")
    assert [one["name"] for one in welcome["recordings"]] == ["short.csv"]
    at = welcome["downloads"]
    assert get(served, f"{at}short.csv").status == 200
    for name in ("measured.csv", "unfinished.csv", "named.mf4", "%2e%2e%2fshort.csv", "../short.csv", ""):
        assert get(served, f"{at}{name}").status == 404
    assert get(served, "/recordings/guess/short.csv").status == 404
    assert get(served, f"{at}short.csv", Host="elsewhere:80").status == 403


@pytest.mark.slow
def test_without_the_token_nothing_is_shown(serve: Serve) -> None:
    served = serve(token="right-token")
    for shown in ({"token": "wrong"}, {"do": "stop now"}, {"token": None}):
        with meet(served) as line:
            assert json.loads(line.recv(timeout=10)) == {"kind": "token"}
            line.send(json.dumps(shown))
            with pytest.raises(ConnectionClosed):
                line.recv(timeout=10)
    with meet(served) as line:
        line.recv(timeout=10)
        line.send(json.dumps({"token": "right-token"}))
        assert next_message(line, "bench")["title"] == "bearing"


def test_a_message_that_is_too_large_or_no_json_ends_the_connection(serve: Serve) -> None:
    served = serve()
    for text in ('{"do": "' + 20_000 * "x" + '"}', "no json", "[1]", "[" * 9000):
        with meet(served) as line:
            next_message(line, "bench")
            line.send(text)
            with pytest.raises(ConnectionClosed):
                next_message(line, "never")


def flood(line: ClientConnection) -> None:
    for _ in range(5000):
        line.send('{"do": "load", "value": 150}')
    next_message(line, "never")


def test_a_flood_of_messages_ends_the_connection_and_not_the_bench(serve: Serve) -> None:
    served = serve()
    with meet(served) as line:
        next_message(line, "bench")
        with pytest.raises(ConnectionClosed):
            flood(line)
    before = served.session.bench.tick
    wait_for(lambda: served.session.bench.tick > before + 1000)
    assert served.session.end_reason == ""


def test_the_number_of_browsers_is_limited(serve: Serve) -> None:
    served = serve()
    with ExitStack() as lines:
        for n in range(MAX_CLIENTS):
            assert next_message(lines.enter_context(meet(served)), "bench")["you"] == n + 1
        with meet(served) as line, pytest.raises(ConnectionClosed):
            next_message(line, "bench")


@pytest.mark.slow
def test_a_browser_that_does_not_read_does_not_stall_the_bench(serve: Serve) -> None:
    served = serve()
    with meet(served, max_queue=1) as slow, meet(served) as quick:
        # The slow browser is never read, so that its buffers fill.
        next_message(quick, "bench")
        bench = served.session.bench
        then, covered = bench.tick, 0
        while bench.tick < then + 2.0 * bench.rate:
            data = quick.recv(timeout=30)
            covered += len(data) if isinstance(data, bytes) else 0
        ticks = bench.tick - then
        slow.socket.close()
    assert covered > ticks * 4


def test_two_operators_cannot_command_at_once(serve: Serve) -> None:
    served = serve()
    with meet(served) as first, meet(served) as second:
        next_message(first, "bench")
        next_message(second, "bench")
        assert "reason" not in order(first, "load", value=140.0)
        for what in ("load", "target", "command", "generator", "apply", "pace"):
            assert says(order(second, what, value=100.0)["reason"], "another-operates")
        order(second, "hand over", yes=True)  # only the operator may hand over
        order(second, "ask")
        assert says(order(second, "load", value=90.0)["reason"], "another-operates")
        order(first, "hand over", yes=True)
        assert "reason" not in order(second, "load", value=90.0)
        assert says(order(first, "load", value=80.0)["reason"], "another-operates")
        assert served.session.bench.load_N == 90.0


@pytest.mark.parametrize(
    ("what", "fields", "why"),
    [
        ("load", {"value": "1"}, "is no number"),
        ("load", {"value": float("nan")}, "is no number"),
        ("target", {}, "is no number"),
        ("command", {"name": "lift"}, "state"),
        ("command", {"name": "explode"}, "no command"),
        ("generator", {"shape": "noise", "amplitude": 0, "frequency": 1}, "no shape"),
        ("generator", {"shape": "sine", "amplitude": 0, "frequency": 1e9}, "frequency"),
        ("pace", {"speed": 2.0}, "speed"),
        ("fly", {}, "no order 'fly'"),
        ("apply", {"values": [1]}, "no parameter"),
    ],
)
def test_a_refusal_gives_its_reason(serve: Serve, what: str, fields: dict[str, Any], why: str) -> None:
    with meet(serve()) as line:
        next_message(line, "bench")
        assert why in order(line, what, **fields)["reason"]


def test_a_missing_extra_is_named(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert main(["live", "rig.toml"]) == 2
    assert says(capsys.readouterr().err, "not-installed")
