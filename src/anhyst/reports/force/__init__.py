"""Figures and pages of open-loop force control."""
