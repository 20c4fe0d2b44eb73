"""Provide a bench, a server and a browser for the tests of the page."""

from __future__ import annotations

import pickle
import shutil
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from anhyst_rigs.dashboard.browsers import RowQueue
from anhyst_rigs.dashboard.improver import Improver
from anhyst_rigs.dashboard.recording import start_recording
from anhyst_rigs.dashboard.serving import make_server, open_prepared
from anhyst_rigs.dashboard.session import LiveSession
from anhyst_rigs.dashboard.verb import listen_on
from anhyst_rigs.rig.bench.bearing import BearingBench
from anhyst_rigs.rig.bench.force import ForceBench
from anhyst_rigs.rig.bench.protocol import Bench
from anhyst_rigs.study.improve import DrawnLoop
from anhyst_rigs.study.prepared_benches import Prepared, PreparedForce
from anhyst_rigs.study.tracking.online_calibration import BenchCalibrator
from tests.live.improving import unknown_iron
from tests.once import made_once
from tests.rig import forces
from tests.study import bearings

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page


@pytest.fixture(scope="session")
def firmware(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Firmware of the example for the virtual bench."""
    return bearings.firmware(tmp_path_factory)


@pytest.fixture(scope="session")
def host_firmware(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Firmware of the example for a board with its own process."""
    return bearings.firmware(tmp_path_factory, "host")


@pytest.fixture(scope="session")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> PreparedForce:
    """A force rig whose iron differs from the model of its controller."""

    def make(folder: Path) -> None:
        (folder / "prepared").write_bytes(pickle.dumps(unknown_iron(folder / "rig")))

    folder = made_once(tmp_path_factory, "improve", make)
    found: PreparedForce = pickle.loads((folder / "prepared").read_bytes())
    return found


@pytest.fixture
def bench(firmware: Path) -> Iterator[BearingBench]:
    opened = BearingBench(bearings.single(), firmware)
    yield opened
    opened.close()


@pytest.fixture
def force_bench(tmp_path_factory: pytest.TempPathFactory) -> ForceBench:
    """A solenoid bench; its session closes it."""
    return ForceBench(forces.example(), forces.program(tmp_path_factory))


@dataclass(frozen=True)
class Served:
    """A session with its running server."""

    session: LiveSession
    port: int
    end: Callable[[], None]

    @property
    def address(self) -> str:
        return f"http://127.0.0.1:{self.port}/"


@contextmanager
def serving(
    bench: Bench,
    folder: Path,
    token: str = "",
    record: Path | None = None,
    improver: Improver | None = None,
    curves: Sequence[DrawnLoop] = (),
    learner: BenchCalibrator | None = None,
) -> Iterator[Served]:
    """Serve a session of a bench; both are closed at the end."""
    recording = start_recording(record, bench.signals, bench.rate) if record else None
    session = LiveSession(bench, recording, folder, improver, curves, learner)
    taken = listen_on("127.0.0.1", 0)
    port = int(taken.getsockname()[1])
    title = "bearing" if improver is None else "solenoid"
    server = make_server(session, title, ("127.0.0.1", port), token)
    thread = threading.Thread(target=server.run, kwargs={"sockets": [taken]})

    def end() -> None:
        server.should_exit = True
        thread.join()
        session.close()
        taken.close()

    session.start()
    thread.start()
    try:
        yield Served(session, port, end)
    finally:
        end()


Serve = Callable[..., Served]


@pytest.fixture
def serve(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Serve]:
    """Serve sessions until the test ends; without a bench argument, the bearing is served."""
    folder = tmp_path / "work"
    folder.mkdir()
    with ExitStack() as stack:

        def start(bench: Bench | None = None, prepared: Prepared | None = None, **given: Any) -> Served:
            improver, learner = None, None
            if prepared is not None:
                bench, improver, learner = open_prepared(prepared)
            bench = bench or BearingBench(bearings.single(), request.getfixturevalue("firmware"))
            return stack.enter_context(serving(bench, folder, improver=improver, learner=learner, **given))

        yield start


@pytest.fixture(scope="module")
def bearing(firmware: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A served bearing for all tests of a module; a test may leave it in any state."""
    bench = BearingBench(bearings.single(), firmware)
    with serving(bench, tmp_path_factory.mktemp("work")) as served:
        yield served


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """The system's Chromium."""
    api = pytest.importorskip(
        "playwright.sync_api", reason="playwright is not installed: pip install playwright"
    )
    with api.sync_playwright() as started:
        chromium = started.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        yield chromium
        chromium.close()


@contextmanager
def shown(browser: Browser, served: Served) -> Iterator[Page]:
    """Open the page of a session, and check at the end that no error occurred in the page."""
    wrong: list[str] = []
    context = browser.new_context(viewport={"width": 1440, "height": 860})
    page = context.new_page()
    page.set_default_timeout(180_000)
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on(
        "console",
        lambda message: (
            wrong.append(message.text) if message.type == "error" and "REFUSED" not in message.text else None
        ),
    )
    page.goto(served.address)
    try:
        yield page
    finally:
        context.close()
    assert wrong == []


@contextmanager
def sending_all_samples() -> Iterator[None]:
    """Send all samples even to a slow page, which otherwise receives fewer (test_frames.py)."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("anhyst_rigs.dashboard.server.RowQueue", partial(RowQueue, 10**8))
        yield


Show = Callable[[Served], "Page"]


@pytest.fixture
def show(browser: Browser) -> Iterator[Show]:
    """Open pages until the test ends."""
    with ExitStack() as stack:
        yield lambda served: stack.enter_context(shown(browser, served))


def wait_for(check: Callable[[], object], seconds: float = 180.0) -> None:
    """Wait until a check is true; fail after a time that is long enough for a busy machine."""
    end = time.monotonic() + seconds
    while not check():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.01)
