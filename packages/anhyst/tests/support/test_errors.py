"""Errors keep their content when they are sent to another process or get a location."""

from __future__ import annotations

import pickle

from anhyst.model.predict import SampleError
from anhyst.support.errors import NegativeResult


def test_an_error_comes_back_from_another_process_as_it_was() -> None:
    sent = SampleError("drive", 3, "is too large")
    back = pickle.loads(pickle.dumps(sent))
    assert type(back) is SampleError
    assert (back.args, back.code, back.key) == (sent.args, "sample-refused", "drive")
    assert (back.sample, back.fault) == (3, "is too large")


def test_an_error_is_the_same_at_its_place() -> None:
    found = NegativeResult("no", code="drifted", key="k").with_location("run.csv")
    assert type(found) is NegativeResult
    assert (str(found), found.code, found.key) == ("run.csv: no", "drifted", "k")
