"""Results come from the cache only for equal inputs and equal code."""

from __future__ import annotations

import os
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest

from anhyst.support import cache as module
from anhyst.support.atomic import cache_folder
from anhyst.support.cache import cached_result
from anhyst.support.numeric import FloatArray


@dataclass(frozen=True)
class Given:
    """Inputs of a computation."""

    values: FloatArray
    names: dict[str, float] = field(default_factory=dict)


HERE = Given(np.array([1.0, 2.0]), {"gap": 0.5})
OTHERS = [
    replace(HERE, values=np.array([1.0, np.nextafter(2.0, 3.0)])),
    replace(HERE, values=np.array([[1.0, 2.0]])),
    replace(HERE, values=HERE.values.astype(np.float32)),
    replace(HERE, names={"gap": 0.25}),
    replace(HERE, names={"gaps": 0.5}),
    replace(HERE, names={}),
]


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


class Computed(Exception):  # noqa: N818 - nothing went wrong
    """Error that shows that a result was computed, and not taken from the cache."""


def compute() -> str:
    raise Computed


def test_equal_inputs_are_computed_once() -> None:
    assert cached_result("words", lambda: "first", HERE, 1) == "first"
    again = Given(HERE.values.copy(), dict(HERE.names))
    assert cached_result("words", compute, again, 1) == "first"


@pytest.mark.parametrize("other", OTHERS)
def test_the_last_bit_of_an_input_counts_and_its_shape_its_type_and_its_names(other: Given) -> None:
    cached_result("words", lambda: "first", HERE)
    with pytest.raises(Computed):
        cached_result("words", compute, other)


def test_the_order_and_nesting_of_inputs_count() -> None:
    cached_result("words", lambda: "first", (1, 2), 3)
    for other in (((1,), 2, 3), ((1, 2, 3),), (3, (1, 2)), ((1, 2), 3.0)):
        with pytest.raises(Computed):
            cached_result("words", compute, *other)


def test_other_sources_and_another_kind_are_other_inputs(monkeypatch: pytest.MonkeyPatch) -> None:
    cached_result("words", lambda: "first", HERE)
    with pytest.raises(Computed):
        cached_result("others", compute, HERE)
    monkeypatch.setattr(module, "code_digest", lambda: b"other sources")
    with pytest.raises(Computed):
        cached_result("words", compute, HERE)


def test_a_truncated_cache_file_is_recomputed() -> None:
    cached_result("words", lambda: "first", HERE)
    (place,) = cache_folder("words").iterdir()
    place.write_bytes(place.read_bytes()[:-3])
    assert cached_result("words", lambda: "second", HERE) == "second"
    assert cached_result("words", compute, HERE) == "second"


@pytest.mark.parametrize("place_of_bit", [0, 40, -8, -2])
def test_a_flipped_bit_is_never_a_result(place_of_bit: int) -> None:
    cached_result("numbers", lambda: [0.5, {"gap": 0.25}], HERE)
    (place,) = cache_folder("numbers").iterdir()
    content = bytearray(place.read_bytes())
    content[place_of_bit] ^= 1
    place.write_bytes(bytes(content))
    assert cached_result("numbers", lambda: "anew", HERE) == "anew"


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="files have no owner here")
def test_cache_files_of_other_users_are_not_used(monkeypatch: pytest.MonkeyPatch) -> None:
    cached_result("words", lambda: "first", HERE)
    monkeypatch.setattr(os, "getuid", lambda: -1)
    with pytest.raises(Computed):
        cached_result("words", compute, HERE)


def test_who_has_no_home_computes_each_time(monkeypatch: pytest.MonkeyPatch) -> None:
    def homeless() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setattr(Path, "home", homeless)
    assert cached_result("words", lambda: "first", HERE) == "first"
    assert cached_result("words", lambda: "second", HERE) == "second"


def test_without_a_place_it_is_computed_each_time(tmp_path: Path) -> None:
    (tmp_path / "cache").write_text("no folder")
    assert cached_result("words", lambda: "first", HERE) == "first"
    assert cached_result("words", lambda: "second", HERE) == "second"


def test_the_cache_is_private_and_keeps_recent_results(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MAX_CACHED_RESULTS", 3)
    for number in range(5):
        cached_result("numbers", lambda number=number: number, number)  # type: ignore[misc]
    folder = cache_folder("numbers")
    assert folder.stat().st_mode & 0o077 == 0
    assert len(list(folder.iterdir())) == 3


def test_arguments_without_comparable_contents_are_refused() -> None:
    with pytest.raises(TypeError):
        cached_result("words", compute, object())
