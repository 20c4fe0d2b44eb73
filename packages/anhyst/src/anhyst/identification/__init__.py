"""Identify hysteresis models from measured loops."""

from __future__ import annotations

from anhyst.identification.identify import identify
from anhyst.identification.run import IdentifyResult

__all__ = ["IdentifyResult", "identify"]
