"""The report of a simulated bearing, and its figures."""

from __future__ import annotations

from anhyst.report.bearing.page import write_simulation_report
from anhyst.report.bearing.subject import SimulationSubject

__all__ = ["SimulationSubject", "write_simulation_report"]
