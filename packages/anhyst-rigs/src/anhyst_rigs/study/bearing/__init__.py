"""Simulate magnetic bearings with their controllers, and assess the benefit of compensation."""
