"""Jobs for another process, in a module with few imports."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

from anhyst.support.jobs import Progress


def forever(progress: Progress) -> Mapping[str, Any]:
    progress(1.0, 4.0)
    time.sleep(600.0)
    return {}


def dies(progress: Progress) -> Mapping[str, Any]:
    del progress
    raise SystemExit(3)
