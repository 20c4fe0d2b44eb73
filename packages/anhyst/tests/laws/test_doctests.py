"""The examples in the docstrings of the laws are correct."""

from __future__ import annotations

import doctest
import importlib

import pytest


@pytest.mark.parametrize("name", ["langevin", "effective_field", "linear_anhysteretic", "iron"])
def test_examples_in_docstrings_are_true(name: str) -> None:
    result = doctest.testmod(importlib.import_module(f"tests.oracles.{name}"))
    assert result.attempted > 0
    assert result.failed == 0
