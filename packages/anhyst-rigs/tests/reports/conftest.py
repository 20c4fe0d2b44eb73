"""Provide the report subject for the tests of a bearing's report."""

from __future__ import annotations

import pytest

from anhyst.control.controller_file import ControllerTable
from anhyst_rigs.reports.bearing.subject import SimulationSubject
from anhyst_rigs.rig.body import BodyRig
from tests.reports import bearing_reports


@pytest.fixture(scope="module", name="rig")
def _rig() -> BodyRig:
    return bearing_reports.rig()


@pytest.fixture(scope="module", name="controller")
def _controller() -> ControllerTable:
    return bearing_reports.controller()


@pytest.fixture(scope="module", name="subject")
def _subject() -> SimulationSubject:
    return bearing_reports.subject()
