"""A rig file takes the options of ``anhyst identify``."""

from __future__ import annotations

import inspect
from typing import get_args

from anhyst.cli import identify as command
from anhyst.identification import run as identifyoptions
from anhyst.identification.run import IdentifyTable

NOT_IN_A_RIG = {"loops", "out", "as_json", "_verbose"}


def test_a_rig_file_has_every_option_of_the_command_by_the_same_name() -> None:
    options = set(inspect.signature(command.identify).parameters) - NOT_IN_A_RIG
    assert set(IdentifyTable.model_fields) == options


def test_both_take_the_same_words() -> None:
    for words, ours in (
        (command.GapMapChoice, identifyoptions.GapMap),
        (command.SearchChoice, identifyoptions.Search),
        (command.Weights, identifyoptions.Weights),
    ):
        assert set(get_args(words)) == set(get_args(ours))
