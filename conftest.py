"""Provide the fixtures of all tests, and turn skipped tests into failures if that is requested."""

from __future__ import annotations

import os
import shutil
import signal
import sys
from collections import Counter
from collections.abc import Generator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

# Hypothesis has no deadline, because the machine may be busy. It uses the same examples everywhere,
# so that a test that passed on one machine passes on another. `make fuzz` uses other examples in
# each run.
settings.register_profile(
    "same",
    deadline=None,
    derandomize=os.environ.get("ANHYST_RANDOM") != "1",
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("same")

# Each test worker already uses a core. The limit is set before any import of numpy.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

# Tests start Python hundreds of times. Each start would otherwise compile all sources again.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

ROOT = Path(__file__).resolve().parent

# Processes that tests start also find the test helpers of all parts (pythonpath in pyproject.toml).
FOLDERS = (ROOT, *sorted((ROOT / "packages").glob("*")))
os.environ["PYTHONPATH"] = os.pathsep.join(map(str, FOLDERS))

# A shell that runs the tests in the background lets them and their child processes ignore Ctrl-C.
signal.signal(signal.SIGINT, signal.default_int_handler)

NO_MEASUREMENTS = "real measurements are not here: set ANHYST_DATA to their folder"
HELD = "as recorded in tests/held.toml"


@pytest.fixture(scope="session")
def measurements() -> Path:
    """Folder of real measurements. A test that needs the folder is skipped if it does not exist."""
    folder = Path(os.environ.get("ANHYST_DATA", ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(NO_MEASUREMENTS)
    return folder


@pytest.fixture(scope="session")
def cases() -> Path:
    """Folder of measurement files from other users. A test is skipped if it does not exist."""
    folder = ROOT.parent / "shared" / "cases" / "files"
    if not folder.is_dir():
        pytest.skip(NO_MEASUREMENTS)
    return folder


PACKAGES = {
    "/usr/include/simavr/sim_avr.h": "simavr libsimavr-dev libelf-dev",
    "arduino-builder": "arduino-builder arduino-core-avr arduino-ctags",
    "avr-gcc": "gcc-avr avr-libc",
    "cc": "gcc libc6-dev",
    "clang": "clang libclang-rt-dev",
}
"""Packages to install for a program or a header whose package has another name."""


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip a test before its fixtures are made if a required program or file is not installed."""
    for name in (name for mark in item.iter_markers("needs") for name in mark.args):
        if not (Path(name).exists() if name.startswith("/") else shutil.which(name)):
            pytest.skip(f"{name} is not installed: apt install {PACKAGES.get(name, name)}")


def pytest_configure(config: pytest.Config) -> None:
    """Use or write the record of passed tests if the variable ANHYST_HELD is set."""
    if mode := os.environ.get("ANHYST_HELD"):
        from tests.held import Held

        config.pluginmanager.register(Held(recording=mode == "record"))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the cases of a test after the first n as slow if the test is marked ``first(n)``."""
    seen: Counter[str] = Counter()
    for item in items:
        if mark := item.get_closest_marker("first"):
            case = item.nodeid.partition("[")[0]
            seen[case] += 1
            if seen[case] > mark.args[0]:
                item.add_marker("slow")


def refuse_skip(report: pytest.TestReport | pytest.CollectReport) -> None:
    """Fail a skipped test if ANHYST_NO_SKIP=1, except absent measurements and recorded tests."""
    if os.environ.get("ANHYST_NO_SKIP") != "1" or not report.skipped or hasattr(report, "wasxfail"):
        return
    reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
    if NO_MEASUREMENTS not in reason and HELD not in reason:
        report.outcome = "failed"
        report.longrepr = f"{report.nodeid} was skipped, which ANHYST_NO_SKIP=1 forbids: {reason}"


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    refuse_skip(report)
    return report


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report() -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    report = yield
    refuse_skip(report)
    return report
