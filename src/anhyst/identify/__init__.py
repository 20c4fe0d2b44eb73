"""From measured loops to a model."""

from __future__ import annotations

from anhyst.identify.identify import identify
from anhyst.identify.result import IdentifyResult

__all__ = ["IdentifyResult", "identify"]
