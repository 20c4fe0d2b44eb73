"""Measure the frequency response of a position loop while it runs."""
