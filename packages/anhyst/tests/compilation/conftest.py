"""Fixtures of compiled folders; tests of the rigs import them too."""

from tests.compilation.packaged import case, place, undrawn

__all__ = ["case", "place", "undrawn"]
