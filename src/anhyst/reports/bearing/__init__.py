"""The report of a simulated bearing, and its figures."""

from __future__ import annotations

from anhyst.reports.bearing.page import write_simulation_report
from anhyst.reports.bearing.subject import SimulationSubject

__all__ = ["SimulationSubject", "write_simulation_report"]
