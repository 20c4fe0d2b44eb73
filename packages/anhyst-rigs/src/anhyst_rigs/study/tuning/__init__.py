"""Gains for stated aims, over gaps, step heights and loads at once."""
