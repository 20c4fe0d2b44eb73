"""Test that unusable ports are reported in one line."""

from __future__ import annotations

import os
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path

import pytest

from anhyst.support.errors import InputError
from anhyst_rigs.link import frames
from anhyst_rigs.link.client import ControllerLink
from anhyst_rigs.link.frames import HelloRequest, InfoAnswer, NakAnswer, Reason, StatusAnswer
from anhyst_rigs.link.virtual_boards import RunningFirmware, run_host
from anhyst_rigs.link.wire import Receiver, encode
from tests.refusals import says

from .plant import NoisyPlant


def refusal(url: str) -> str:
    with pytest.raises(InputError) as error:
        ControllerLink(url, timeout=0.02, attempts=3)
    text = str(error.value)
    assert "\n" not in text
    assert text.startswith(url)
    return text


def test_a_missing_port_is_reported() -> None:
    assert "is missing; connect the controller" in refusal("/dev/ttyNONE7")


def test_a_host_without_a_server_is_reported() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    assert "connection refused" in refusal(f"socket://127.0.0.1:{port}")


def test_something_that_is_not_a_port(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    assert "is not a serial port" in refusal(str(tmp_path / "file"))
    assert says(refusal("nonsense://x"), "port-not-open")


def test_a_port_in_use_is_reported(board: RunningFirmware) -> None:
    with ControllerLink(board.url, timeout=1.0) as first:
        assert "is used by another program" in refusal(board.url)
        assert first.status().tick == board.bus.tick


def test_a_port_without_a_controller() -> None:
    ours, theirs = os.openpty()
    try:
        assert says(refusal(os.ttyname(theirs)), "no-answer: 0.1")
    finally:
        os.close(ours)
        os.close(theirs)


def test_a_controller_that_vanishes(host_firmware: Path) -> None:
    with (
        run_host(host_firmware, NoisyPlant()) as started,
        ControllerLink(started.url, timeout=0.02, attempts=3) as controller,
    ):
        assert started.bus_socket is not None
        started.bus_socket.close()  # the firmware ends when its plant disconnects
        with pytest.raises(InputError) as caught:
            list(controller.stream(range(100)))
        assert caught.value.code in {"no-answer", "port-gone"}


@contextmanager
def fake(answer: bytes) -> Iterator[str]:
    """A controller that answers everything with the same frame."""
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def serve() -> None:
            connection, _ = listener.accept()
            receiver = Receiver()
            with connection:
                while data := connection.recv(4096):
                    for _ in receiver.feed(data):
                        connection.sendall(answer)

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        yield f"socket://127.0.0.1:{listener.getsockname()[1]}"
        thread.join()


INFO = InfoAnswer(frames.VERSION + 1, 1, 1, 1, 0, 1024, 20, 0, 4000, 0, 1)
NAK = NakAnswer(HelloRequest.TYPE, Reason.VERSION, frames.VERSION + 1)
STATUS = StatusAnswer(2, *[0] * (len(fields(StatusAnswer)) - 1))


@pytest.mark.parametrize(
    "answer", [encode(INFO, 1), encode(NAK, 1), encode(STATUS, 1, version=frames.VERSION + 1)]
)
def test_firmware_of_another_protocol_version(answer: bytes) -> None:
    with fake(answer) as url:
        text = refusal(url)
    ours = frames.VERSION
    assert says(text, f"other-protocol-version: version {ours + 1}; version {ours}")


def test_firmware_reports_a_pc_of_another_version(board: RunningFirmware, monkeypatch: object) -> None:
    patch, its = monkeypatch, frames.VERSION
    assert isinstance(patch, pytest.MonkeyPatch)
    patch.setattr(frames, "VERSION", its + 7)
    text = refusal(board.url)
    assert says(text, f"other-protocol-version: version {its}; version {its + 7}")


@pytest.mark.parametrize("answer", [encode(STATUS, 1), b"\1\2\3\0", b"\0\0\0"])
def test_unrelated_answers_are_ignored(answer: bytes) -> None:
    with fake(answer) as url:
        assert says(refusal(url), "no-answer")


def test_a_line_that_only_echoes() -> None:
    assert says(refusal("loop://"), "other-firmware: 0x01")
