"""Test the page while a rig is built."""

from __future__ import annotations

import json
import signal
import socket
import sys
import threading
import time
from pathlib import Path
from subprocess import PIPE, Popen
from typing import Any
from urllib.error import HTTPError, URLError
from urllib.request import urlopen

import pytest

from anhyst import InputError
from anhyst_rigs.dashboard.starting import serve_start_page
from anhyst_rigs.dashboard.verb import listen_on
from tests.cli.command import ENVIRONMENT
from tests.repository import ROOT

RIG = ROOT / "examples/bearing/rig.toml"


def asked(port: int, path: str = "/start") -> str:
    with urlopen(f"http://127.0.0.1:{port}{path}", timeout=10.0) as reply:
        text: str = reply.read().decode()
    return text


def start_of(port: int) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(asked(port))
    return found


def test_the_start_page_shows_progress() -> None:
    with listen_on("127.0.0.1", 0) as taken:
        port = taken.getsockname()[1]
        with serve_start_page(taken, "bearing", "building") as start:
            assert "/assets/start.js" in asked(port, "/")
            assert "fetch(" in asked(port, "/assets/start.js")
            assert start_of(port)["share"] == 0.0
            start.update(1.0, 4.0)
            start.update(0.0, 4.0)  # the progress never falls
            found = start_of(port)
            assert found["share"] == 0.25
            assert (found["title"], found["work"]) == ("bearing", "building")
            assert found["error"] == ""


def test_the_start_page_releases_its_port() -> None:
    with listen_on("127.0.0.1", 0) as taken:
        port = taken.getsockname()[1]
        for title in ("first", "second"):
            with serve_start_page(taken, title, "building"):
                assert start_of(port)["title"] == title


def test_start_page_shows_why_the_start_failed() -> None:
    with listen_on("127.0.0.1", 0) as taken:
        port = taken.getsockname()[1]
        shown: list[str] = []

        def watch() -> None:
            while not shown or not shown[-1]:
                shown.append(start_of(port)["error"])
                time.sleep(0.05)

        page = threading.Thread(target=watch)

        def fail() -> None:
            with serve_start_page(taken, "bearing", "building"):
                page.start()
                while not shown:
                    time.sleep(0.01)
                raise InputError("loops.csv: no loops", code="no-loops")

        with pytest.raises(InputError, match="no loops"):
            fail()
        page.join(10.0)
        assert shown[-1] == "loops.csv: no loops"


def test_start_page_does_not_wait_for_a_page_that_is_not_open() -> None:
    began = time.monotonic()
    with listen_on("127.0.0.1", 0) as taken, pytest.raises(InputError):  # noqa: SIM117
        with serve_start_page(taken, "bearing", "building"):
            raise InputError("no loops", code="no-loops")
    assert time.monotonic() - began < 2.5


def free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


def test_live_responds_while_building_and_ctrl_c_ends_the_build(tmp_path: Path) -> None:
    port = free_port()
    command = [sys.executable, "-m", "anhyst.cli.app", "live", str(RIG), "--listen", str(port)]
    variables = {**ENVIRONMENT, "XDG_CACHE_HOME": str(tmp_path)}  # the cache is empty
    with Popen(command, stdout=PIPE, stderr=PIPE, text=True, env=variables) as process:
        try:
            found = None
            while found is None and process.poll() is None:
                try:
                    found = start_of(port)
                except HTTPError:
                    raise
                except (URLError, OSError):
                    time.sleep(0.1)
            assert found is not None
            assert found["title"] == "bearing"
            process.send_signal(signal.SIGINT)
            printed, message = process.communicate(timeout=120.0)
        finally:
            process.kill()
    assert (process.returncode, printed) == (130, "")
    assert message.endswith("anhyst: interrupted\n")
