"""Hysteresis laws: the record of each, and the registry of all."""
