"""What is raised where a law has no answer."""

from __future__ import annotations

from anhyst.support.errors import InputError


class NoResponseError(ArithmeticError):
    """The law has no answer for these parameters."""


class NowhereNearError(InputError):
    """No set of parameters that a search begins with comes near the loops."""
