"""A rig file accepts the options of ``anhyst identify``."""

from __future__ import annotations

from typing import get_args

from anhyst.cli.generate import Verb
from anhyst.identification import run as identifyoptions
from anhyst.identification.run import IdentifyTable
from anhyst.verbs import identify as command

NOT_IN_A_RIG = {"loops", "out", "output", "force_at", "pole_area", "turns"}
"""A rig identifies the force of its own loops; a calibration belongs to the command."""


def test_a_rig_file_has_every_option_of_the_command_by_the_same_name() -> None:
    options = Verb("identify", command).parameters.keys() - NOT_IN_A_RIG
    assert set(IdentifyTable.model_fields) == options


def test_both_take_the_same_words() -> None:
    for words, ours in (
        (command.GapMap, identifyoptions.GapMap),
        (command.SearchMethod, identifyoptions.Search),
        (command.Weights, identifyoptions.Weights),
    ):
        assert set(get_args(words)) == set(get_args(ours))
