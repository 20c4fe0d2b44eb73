"""Readable double-precision references of the hysteresis laws: the oracle of the C core."""
