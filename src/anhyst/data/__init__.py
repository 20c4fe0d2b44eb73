"""Measurements: reading, cleaning and judging loops."""
