"""Simulate magnetic bearings: plant, controller, and the benefit of compensation."""
