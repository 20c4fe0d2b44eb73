"""Simulate rigs: a plant, its instruments and its controller advance together, tick by tick."""
