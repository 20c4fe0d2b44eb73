"""How far long work is."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[float, float], None]
"""Called with what is done and what there is in all, in units of the work's own choice."""
