"""How far long work is."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

Progress = Callable[[float, float], None]
"""Called with what is done and what there is in all, in units of the work's own choice."""


def in_parts(progress: Progress | None, work: Sequence[float]) -> Iterator[Progress]:
    """Yield for one part of some work after the other what makes its progress one of the whole."""

    def of_part(part: int) -> Progress:
        before = sum(work[:part])

        def update(done: float, total: float) -> None:
            if progress is not None:
                progress(before + work[part] * done / total, sum(work))

        return update

    return map(of_part, range(len(work)))
