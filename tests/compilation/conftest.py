"""Controllers are compiled here by the dozen; their budget pages are written without a picture."""

from __future__ import annotations

from collections.abc import Iterator

import pytest


@pytest.fixture(scope="package", autouse=True)
def _undrawn() -> Iterator[None]:
    """Leave the picture of a budget out: it takes a fifth of compiling."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("anhyst.compilation.source._figure", lambda budget: None)
        patch.setattr("anhyst.compilation.source.svg_text", lambda figure, prefix: "<svg/>")
        yield
