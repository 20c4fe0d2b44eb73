"""Magnetic bearings in simulation: plant, controller, and what compensation is worth."""
