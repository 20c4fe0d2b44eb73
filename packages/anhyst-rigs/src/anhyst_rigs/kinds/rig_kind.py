"""The record of a kind of rig: its name, its commands, and the functions that do their work."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any

from anhyst.support.kinds import RIG_FORMAT, FileKind


@dataclass(frozen=True, eq=False)
class RigKind(FileKind):
    """A kind of rig: its name, the commands that accept it, and the functions that do their work.

    A package registers an instance as an entry point of the group ``anhyst.kinds``. The name of the
    entry point is the word of the kind. Each command defines the methods that it needs as a
    protocol. `places` contains the functions for the methods of all these protocols:

    - ``simulate``: :class:`anhyst_rigs.reports.studies.HasSimulation`; with the option ``--board`` also
      ``HasBoard``, with ``--monte-carlo`` ``HasPlants`` and with ``--benefit`` ``HasBenefit`` of that module;
      if ``benefit`` is :func:`anhyst_rigs.reports.benefit.map_plants`, also
      :class:`anhyst_rigs.study.benefit.HasIrons`
    - ``tune``: :class:`anhyst_rigs.study.tuning.tuning.HasTuning`
    - ``excite``: :class:`anhyst_rigs.study.excite.excite.HasSpecimen`
    - ``calibrate``: :class:`anhyst_rigs.study.tracking.calibrate.HasCalibration`
    - ``live``: :class:`anhyst_rigs.study.bench.HasBench`
    - ``export``: an entry point of the group ``anhyst.exports``, see ``anhyst_exchange.exporter``
    - ``compile``: :class:`anhyst.compilation.compiled_stage.HasController`

    A function is imported when it is first used, so that the kind of a file is known quickly. Every
    command that accepts a file imports the module of the record. Therefore, this module must not
    import large packages or print anything.

    `options` names, for each command, the options that this kind supports and others do not:
    ``--controller``, ``--board``, ``--calibrate``, and the requirements of ``tune``. `reasons`
    states, for each command that the kind does not support, why it is not useful.
    """

    # function of each method as "package.module:function"
    places: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Raise TypeError if the places are not a table."""
        if not isinstance(self.places, Mapping):
            raise TypeError("places is not a table")

    @property
    def format(self) -> str:
        """Value of the key ``format`` in such a file."""
        return RIG_FORMAT

    def __getattr__(self, method: str) -> Any:
        """Import the function of a method."""
        places: Mapping[str, str] = self.__dict__.get("places", {})  # not set yet while copying
        if method not in places:
            raise AttributeError(f"'{method}' is not among the places", name=method, obj=self)
        module, _, name = places[method].partition(":")
        return getattr(import_module(module), name)
