"""Simulate the rig of a magnetic bearing: plant, instruments and controller advance tick by tick."""
