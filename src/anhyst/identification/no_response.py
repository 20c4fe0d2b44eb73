"""What is raised where a law has no answer."""

from __future__ import annotations


class NoResponseError(ArithmeticError):
    """The law has no answer for these parameters."""
