"""Simulate stages that follow set-points with feedforward, with and without compensation."""
