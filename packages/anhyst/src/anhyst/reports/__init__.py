"""The report of a model, and its figures.

``write_report`` writes an HTML file, and ``write_plots`` writes picture files. The functions of
:mod:`anhyst.reports.figures` return single figures.
"""

from __future__ import annotations

from anhyst.reports.page import write_plots, write_report

__all__ = ["write_plots", "write_report"]
