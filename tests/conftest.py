"""Fixtures shared by all tests; and, for a machine nobody watches, skips that count as failures."""

from __future__ import annotations

import os
import signal
from collections.abc import Generator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

# A shell that runs the tests in the background lets them ignore ctrl-C, and their children too.
signal.signal(signal.SIGINT, signal.default_int_handler)

NO_MEASUREMENTS = "real measurements are not here: set ANHYST_DATA to their folder"


@pytest.fixture(scope="session")
def measurements() -> Path:
    """Folder of real measurements; tests that need it skip where it is absent."""
    folder = Path(os.environ.get("ANHYST_DATA", ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(NO_MEASUREMENTS)
    return folder


def refuse_skip(report: pytest.TestReport | pytest.CollectReport) -> None:
    """With ANHYST_NO_SKIP=1, fail what was skipped; only absent measurements may be skipped."""
    if os.environ.get("ANHYST_NO_SKIP") != "1" or not report.skipped or hasattr(report, "wasxfail"):
        return
    reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
    if NO_MEASUREMENTS not in reason:
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
