"""Simulate parts of virtual plants tick by tick: irons and magnets.

This package does not use the hysteresis laws that anhyst identifies. Otherwise, a model could
succeed only because the plant has the same structure.
"""
