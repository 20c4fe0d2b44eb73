"""The report of a simulated bearing, and its figures."""

from __future__ import annotations

from anhyst.simulate.report.page import write_simulation_report
from anhyst.simulate.report.subject import Subject

__all__ = ["Subject", "write_simulation_report"]
