"""Limit the processor time of a model."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def limited_time(limit_s: float) -> Iterator[None]:
    """Raise `TimeoutError` when the block exceeds a processor time, s. Blocks cannot be nested."""

    def stop(*_: object) -> None:
        raise TimeoutError(f"stopped after {limit_s:g} s of processor time")

    signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, limit_s)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
