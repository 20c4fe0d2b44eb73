"""Show and change the variables of a foreign firmware: the server chooses signals while it runs."""

from __future__ import annotations

import json
import struct
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin

from anhyst.cli.app import main
from anhyst.support.states import State
from anhyst_rigs.rig.bench.force import StandPlant
from anhyst_rigs.rig.bench.foreign import open_foreign
from anhyst_rigs.rig.force.programs import Program
from tests.link.foreign import slaves
from tests.link.foreign.slaves import a2l_text
from tests.live.board import running
from tests.live.conftest import Serve, Served, Show, wait_for
from tests.live.test_page import until
from tests.refusals import says
from tests.rig import forces


@pytest.fixture(scope="module")
def slave(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return slaves.build(tmp_path_factory)


class Browser:
    """A browser without a page: it sends orders and counts the columns of the frames."""

    def __init__(self, socket: ClientConnection) -> None:
        self._socket = socket
        self.bench: dict[str, Any] = {}
        self.status: dict[str, Any] = {}
        self.log: list[str] = []
        self.columns: list[int] = []
        self._answers: dict[int, dict[str, Any]] = {}
        self._last = 0

    def listen(self, until: Any) -> None:
        """Receive messages until a check is true."""
        end = time.monotonic() + 60.0
        while not until():
            assert time.monotonic() < end
            message = self._socket.recv(timeout=30.0)
            if isinstance(message, bytes):
                rows, columns = struct.unpack_from("<II", message)
                ticks, *values = (
                    np.frombuffer(message, "<f8", rows, 24),
                    *np.frombuffer(message, "<f4", rows * columns, 24 + 8 * rows).reshape(columns, rows),
                )
                self.columns.append(columns)
                self.ticks, self.values = ticks, values
                continue
            content = json.loads(message)
            if content["kind"] == "bench":
                self.bench, self.columns = content, []
            elif content["kind"] == "status":
                self.status = content
                self.log += [entry["text"] for entry in content["log"]]
            elif content["kind"] == "answer":
                self._answers[content["id"]] = content

    def order(self, what: str, **fields: Any) -> dict[str, Any]:
        """Send an order and return its answer."""
        self._last += 1
        self._socket.send(json.dumps({"do": what, "id": self._last, **fields}))
        self.listen(lambda: self._last in self._answers)
        return self._answers[self._last]


@contextmanager
def browsing(served: Served) -> Iterator[Browser]:
    with connect(
        f"ws://127.0.0.1:{served.port}/live", origin=Origin(f"http://127.0.0.1:{served.port}")
    ) as socket:
        browser = Browser(socket)
        browser.listen(lambda: browser.bench and browser.status)
        yield browser


@pytest.mark.parametrize("big", [0, 1])
def test_signals_and_parameters_are_searched_chosen_and_changed(
    serve: Serve, slave: Path, tmp_path: Path, big: int
) -> None:
    """Frames contain only the chosen signals, also for a second browser; nothing else is streamed."""
    with slaves.running(slave, big=big) as running_slave:
        path = tmp_path / "slave.a2l"
        path.write_text(a2l_text(running_slave.addresses, big=bool(big)), encoding="utf-8")
        served = serve(open_foreign(path, running_slave.url))
        with browsing(served) as browser, browsing(served) as watcher:
            assert browser.bench["catalogue"]["variable_count"] == 14
            assert browser.bench["commands"] == []
            found = browser.order("find", text="sig_f")["found"]
            assert [one["name"] for one in found] == ["sig_f32", "sig_f64"]
            assert not found[0]["writable"]
            browser.order(
                "choose", signals=["tick", "sig_f64", "par_gain"], parameters=["par_gain"], event=None
            )
            for one in (browser, watcher):
                one.listen(lambda one=one: len(one.bench["signals"]) == 3 and len(one.columns) > 3)
                assert set(one.columns) == {3}
            np.testing.assert_array_equal(browser.values[1], -0.125 * browser.values[0])
            applied = browser.order("apply", values={"par_gain": 7.5})
            assert [one["value"] for one in applied["parameters"]] == [7.5]
            browser.listen(lambda: browser.values[2][-1] == 7.5)
            refused = browser.order("apply", values={"par_gain": 101.0})
            assert "choose a value from 0 to 100" in refused["reason"]
            assert (
                "no variable 'nonsense'"
                in browser.order("choose", signals=["nonsense"], parameters=[])["reason"]
            )
            assert len(browser.bench["signals"]) == 3


def test_a_recording_contains_every_chosen_signal_and_forbids_another_choice(
    serve: Serve, slave: Path, tmp_path: Path
) -> None:
    """The rows in the file are those of the slave; the choice waits until the recording ends."""
    with slaves.running(slave) as running_slave:
        path = tmp_path / "slave.a2l"
        path.write_text(a2l_text(running_slave.addresses), encoding="utf-8")
        served = serve(open_foreign(path, running_slave.url))
        with browsing(served) as browser:
            browser.order("choose", signals=["tick", "sig_i16"], parameters=[], event=0)
            assert "reason" not in browser.order("record", file="run.csv", before=0, lasts=0.5)
            assert "stop it first" in browser.order("choose", signals=["tick"], parameters=[])["reason"]
            browser.listen(lambda: any("written" in text for text in browser.log))
        lines = (served.session.recorder.folder / "run.csv").read_text("utf-8").splitlines()
        rows = [line for line in lines if not line.startswith("#")]
        assert rows[0].split(",")[-2:] == ["tick", "sig_i16_mm"]
        numbers = np.array([[float(part) for part in row.split(",")[-2:]] for row in rows[1:]])
        assert len(numbers) == pytest.approx(500, abs=2)
        assert set(np.diff(numbers[:, 0])) == {1.0}
        np.testing.assert_array_equal(
            numbers[:, 1], 0.5 * ((-3 * numbers[:, 0] + 32768) % 65536 - 32768) + 10
        )


def test_stop_and_target_say_that_they_are_not_known(serve: Serve, slave: Path) -> None:
    """A foreign firmware is not stopped by a button that does nothing."""
    with slaves.running(slave) as running_slave:
        served = serve(open_foreign(slave, running_slave.url))
        with browsing(served) as browser:
            assert "no command" in browser.order("stop now")["reason"]
            assert "no target" in browser.order("target", value=1.0)["reason"]
            assert "no target" in browser.status["refused"]["target"]
            assert browser.status["state"] is None
            assert "fixed" not in browser.order("find", text="controller.axis[2]")
            assert browser.bench["parameters"] == []


@pytest.mark.needs("chromium")
@pytest.mark.parametrize("size", [(1440, 900), (390, 844)])
def test_the_page_searches_chooses_and_changes_variables(
    serve: Serve, show: Show, slave: Path, tmp_path: Path, size: tuple[int, int]
) -> None:
    """A ticked variable becomes a signal of the plot; a changed parameter arrives in the slave."""
    with slaves.running(slave) as running_slave:
        path = tmp_path / "slave.a2l"
        path.write_text(a2l_text(running_slave.addresses), encoding="utf-8")
        served = serve(open_foreign(path, running_slave.url))
        page = show(served)
        page.set_viewport_size({"width": size[0], "height": size[1]})
        page.get_by_role("tab", name="Variables").click()
        page.get_by_label("search variables").fill("gain")
        page.get_by_label("tick as signal").wait_for(state="detached")
        page.get_by_label("par_gain as signal").check()
        page.locator("#choose").click()
        until(page, "window.anhyst.bench.signals.some((one) => one.name === 'par_gain')")
        page.get_by_role("tab", name="4 parameters").click()
        field = page.locator("#parameters").get_by_label("par_gain", exact=True)
        field.fill("7.5")
        page.get_by_role("button", name="Apply").click()
        column = "window.anhyst.bench.signals.findIndex((one) => one.name === 'par_gain')"
        until(page, f"window.anhyst.store.value({column}, window.anhyst.store.count - 1) === 7.5")
        assert "no stop" in str(page.locator("#stop").get_attribute("title"))
        assert page.evaluate("document.documentElement.scrollWidth") <= size[0]
        page.screenshot(path=str(tmp_path / "variables.png"))


@pytest.mark.slow
def test_our_own_firmware_works_through_its_description(
    serve: Serve, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """The A2L that anhyst writes serves like any other: every tick arrives, and a setting is written."""
    program: Program = forces.program(tmp_path_factory, "host")
    (path,) = (program.firmware.parent / "controller").glob("*.a2l")
    rig = forces.example()
    with running(
        program.firmware, StandPlant.with_operator(rig, program, 0), rig.settings.timing.rate_Hz
    ) as board:
        wait_for(lambda: board.bus.state is State.IDLE)
        served = serve(open_foreign(path, board.xcp))
        with browsing(served) as browser:
            assert browser.bench["rate"] == pytest.approx(rig.settings.timing.rate_Hz, rel=1e-4)
            names = [signal["name"] for signal in browser.bench["signals"]]
            assert {"force", "current", "state"} <= set(names)
            assert browser.bench["catalogue"]["sampling"].startswith("event tick")
            chosen = {"signals": ["force", "state"], "parameters": ["command", "ratio"]}
            assert "reason" not in browser.order("choose", **chosen)
            browser.listen(lambda: len(browser.bench["signals"]) == 2 and len(browser.columns) > 3)
            assert browser.status["missing"] == 0
            assert "reason" not in browser.order("apply", values={"command": 2.0})
            assert "reason" not in browser.order("apply", values={"command": 9.0})
            browser.listen(lambda: browser.values[1][-1] == float(State.RUN))
            time.sleep(0.5)  # longer than the time after which the controller misses its operator
            browser.listen(lambda: browser.ticks[-1] > 0)
            assert browser.values[1][-1] == float(State.RUN)


BAD = {
    "cut.a2l": ("damaged-file: cut.a2l", '/begin PROJECT p ""\n/begin MODULE m ""'),
    "empty.a2l": ("damaged-file: empty.a2l", ""),
    "cut.elf": ("damaged-file: cut.elf", "\x7fELF"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_file_gives_one_line_and_exit_code_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    """The file is read before the slave is connected."""
    wording, content = BAD[name]
    (tmp_path / name).write_text(content, encoding="latin-1")
    assert main(["live", str(tmp_path / name), "--xcp", "127.0.0.1:9", "--listen", "0"]) == 2
    said = capsys.readouterr().err
    assert says(said, wording)
    assert said.count("\n") == 1


def test_a_description_needs_an_address(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], slave: Path
) -> None:
    """An ELF file alone is no rig; with --rig, there is no model to improve."""
    assert main(["live", str(slave)]) == 2
    assert says(capsys.readouterr().err, "options-missing --xcp")
    assert main(["live", str(slave), "--xcp", "127.0.0.1:9", "--rig", str(tmp_path)]) == 2
    assert says(capsys.readouterr().err, "option-not-for-this --rig")
    assert main(["live", str(slave), "--xcp", "127.0.0.1:9", "--listen", "0"]) == 2
    assert says(capsys.readouterr().err, "port-not-open")
