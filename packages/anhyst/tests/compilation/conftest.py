"""Controllers are compiled here by the dozen; their budget pages are written without a picture."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.compilation.packaged import PARAMS, Plain, plain


@pytest.fixture(scope="package", autouse=True)
def _undrawn() -> Iterator[None]:
    """Leave the picture of a budget out: it takes a fifth of compiling."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("anhyst.compilation.source._figure", lambda budget: None)
        patch.setattr("anhyst.compilation.source.svg_text", lambda figure, prefix: "<svg/>")
        yield


@pytest.fixture(scope="package")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder in which the cases of packages are compiled, once each."""
    return tmp_path_factory.mktemp("packages")


@pytest.fixture(params=PARAMS)
def case(place: Path, request: pytest.FixtureRequest) -> Plain:
    """Return one case after the other."""
    return plain(place, request.param)
