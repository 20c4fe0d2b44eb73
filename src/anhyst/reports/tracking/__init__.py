"""The report of a stage that follows set-points, and its figures."""

from __future__ import annotations

from anhyst.reports.tracking.page import write_tracking_report

__all__ = ["write_tracking_report"]
