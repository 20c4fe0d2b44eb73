"""Simulate a short-stroke stage: a body between magnets, which ride on a long stroke."""
