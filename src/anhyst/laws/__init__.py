"""Hysteresis laws: the record of each, the registry of all, and readable oracles for tests."""
