"""Rigs: a plant, its instruments and a controller, in lock-step."""
