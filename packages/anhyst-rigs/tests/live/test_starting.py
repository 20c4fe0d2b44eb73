"""Test the page and the output of the command while a rig is built."""

from __future__ import annotations

import json
import re
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from subprocess import PIPE, Popen, check_output
from typing import TYPE_CHECKING, Any
from urllib.error import HTTPError
from urllib.request import urlopen

import pytest

from anhyst import InputError
from anhyst.support.jobs import begin_step
from anhyst_rigs.dashboard.starting import serve_start_page
from anhyst_rigs.dashboard.verb import listen_on
from tests.cli.command import ENVIRONMENT
from tests.live.test_accessibility import faults
from tests.repository import ROOT

if TYPE_CHECKING:
    from playwright.sync_api import Browser

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


@contextmanager
def building(tmp_path: Path, **pipes: Any) -> Iterator[Popen[str]]:
    """Run the command line with an empty cache, and with buffered output as in a user's pipe."""
    variables = {**ENVIRONMENT, "XDG_CACHE_HOME": str(tmp_path)}
    variables.pop("PYTHONUNBUFFERED", None)
    command = [sys.executable, "-m", "anhyst.cli.app", "live", str(RIG), "--listen", "0"]
    with Popen(command, stdout=PIPE, text=True, env=variables, **pipes) as process:
        try:
            yield process
        finally:
            process.kill()


def opened_port(process: Popen[str]) -> int:
    """Return the port from the first line of the output."""
    assert process.stdout is not None
    first_line = process.stdout.readline()
    assert first_line.endswith("/  ctrl-C ends it\n")
    return int(first_line.split("/")[2].rpartition(":")[2])


def test_live_responds_while_building_and_ctrl_c_ends_the_build(tmp_path: Path) -> None:
    with building(tmp_path, stderr=PIPE) as process:
        assert start_of(opened_port(process))["title"] == "bearing"
        process.send_signal(signal.SIGINT)
        _, message = process.communicate(timeout=120.0)
    assert process.returncode == 130
    assert message.endswith("anhyst: interrupted\n")


class InterruptedDestructor:
    """An object whose destructor receives ctrl-C, so that Python ignores the exception."""

    def __del__(self) -> None:
        signal.raise_signal(signal.SIGINT)


def test_a_ctrl_c_that_python_loses_ends_the_build_at_the_next_step(monkeypatch: pytest.MonkeyPatch) -> None:
    lost: list[object] = []
    monkeypatch.setattr(sys, "unraisablehook", lambda one: lost.append(one.exc_type))
    previous = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with listen_on("127.0.0.1", 0) as taken, pytest.raises(KeyboardInterrupt):  # noqa: PT012, SIM117
            with serve_start_page(taken, "bearing", "building"):
                begin_step("read the rig")
                InterruptedDestructor()
                assert lost == [KeyboardInterrupt]
                begin_step("build the firmware")
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, previous)


def test_live_opens_its_port_before_it_loads_the_libraries(tmp_path: Path) -> None:
    with building(tmp_path) as process:
        first_step = start_of(opened_port(process))["steps"][0]
    assert first_step["work"] == "load the libraries of the bench"
    loaded = "import sys, anhyst_rigs.dashboard.verb; print(*sys.modules)"
    names = check_output([sys.executable, "-c", loaded], text=True).split()
    assert not {"scipy", "matplotlib", "anhyst_rigs.study.bench"} & set(names)


STEPS = [
    "load the libraries of the bench",
    "search the cache of prepared rigs",
    "read the rig, the controller and the loops",
    "identify the magnet",
    "compile the controller",
    "build the firmware",
    "open the bench",
]


def test_live_prints_each_step_with_its_time_through_a_pipe(tmp_path: Path) -> None:
    began = time.monotonic()
    with building(tmp_path) as process:
        port = opened_port(process)
        assert process.stdout is not None
        lines = [process.stdout.readline() for _ in STEPS]
        assert [line.rpartition(": ")[0] for line in lines] == STEPS
        seconds = [float(line.rpartition(": ")[2].removesuffix(" s\n")) for line in lines]
        total = time.monotonic() - began
        assert 0.5 * total < sum(seconds) < total
        assert process.stdout.readline() == "the rig runs\n"
        with pytest.raises(HTTPError, match="404"):
            start_of(port)
        assert "index" not in asked(port, "/assets/start.js")
        process.send_signal(signal.SIGINT)
        assert process.wait(60.0) == 0


def test_the_start_page_lists_each_step_with_its_time() -> None:
    with listen_on("127.0.0.1", 0) as taken:
        port = taken.getsockname()[1]
        with serve_start_page(taken, "bearing", "building"):
            assert start_of(port)["steps"] == []
            begin_step("read the rig")
            time.sleep(0.3)
            begin_step("build the firmware")
            time.sleep(0.1)
            found = [start_of(port)["steps"] for _ in range(2)]
    begin_step("a step that nobody listens to")
    for steps in found:
        assert [step["work"] for step in steps] == ["read the rig", "build the firmware"]
    ended, running = zip(*((step["seconds"] for step in steps) for steps in found), strict=True)
    assert ended[0] == ended[1] >= 0.3
    assert 0.1 <= running[0] < running[1]


@pytest.mark.needs("chromium")
def test_start_page_shows_steps_as_they_run_and_the_reason_of_a_failure(browser: Browser) -> None:
    page = browser.new_context(viewport={"width": 390, "height": 844}).new_page()
    with listen_on("127.0.0.1", 0) as taken, pytest.raises(InputError):  # noqa: SIM117, PT012
        with serve_start_page(taken, "bearing", "building"):
            begin_step("read the rig")
            page.goto(f"http://127.0.0.1:{taken.getsockname()[1]}/")
            entries = page.locator("#steps li")
            entries.filter(has_text="… Read the rig").wait_for()
            begin_step("build the firmware")
            entries.filter(has_text="… Build the firmware").wait_for()
            assert entries.evaluate_all("all => all.map(one => one.dataset.state)") == ["done", "running"]
            assert re.fullmatch(r"✓ Read the rig\d+\.\d s", entries.first.text_content() or "")
            raise InputError("no compiler", code="no-compiler")
    page.locator("#error").filter(has_text="no compiler").wait_for()
    assert faults(page) == []
    page.emulate_media(color_scheme="dark")
    assert faults(page) == []
    assert (entries.last.text_content() or "").startswith("✗ Build the firmware")
    page.context.close()
