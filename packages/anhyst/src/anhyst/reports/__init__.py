"""The report of a model, and its figures.

``write_report`` makes one HTML file from a model file; ``write_plots`` makes picture files; the
functions of :mod:`anhyst.reports.figures` give the figures themselves.
"""

from __future__ import annotations

from anhyst.reports.page import write_plots, write_report

__all__ = ["write_plots", "write_report"]
