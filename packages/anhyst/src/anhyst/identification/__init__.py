"""From measured loops to a model."""

from __future__ import annotations

from anhyst.identification.identify import identify
from anhyst.identification.run import IdentifyResult

__all__ = ["IdentifyResult", "identify"]
