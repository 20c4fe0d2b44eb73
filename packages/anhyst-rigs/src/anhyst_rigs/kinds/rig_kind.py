"""Define the record of a kind of rig: its name, its commands, and the functions that execute them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any

from anhyst.support.kinds import RIG_FORMAT, FileKind


@dataclass(frozen=True, eq=False)
class RigKind(FileKind):
    """A kind of rig: its name, the commands that accept it, and the functions that execute them.

    A package registers an instance as an entry point of the group ``anhyst.kinds``. The name of the
    entry point is the name of the kind in files. Each command defines the methods that it needs as
    a protocol. `places` names the functions for the methods of all these protocols:

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

    A function is imported when it is first used, so that the kind of a file is found quickly. Every
    command that accepts a file imports the module that defines this record. Therefore, that module
    must neither import large packages nor print anything.

    `options` names, for each command, the options that only some kinds support: ``--controller``,
    ``--board``, ``--calibrate``, and the requirements of ``tune``. `reasons` states, for each
    command that the kind does not support, why the command is not useful.
    """

    # location of the function of each method, as "package.module:function"
    places: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Raise TypeError if the attribute `places` is not a mapping."""
        if not isinstance(self.places, Mapping):
            raise TypeError("`places` is not a mapping")

    @property
    def format(self) -> str:
        """Value of the key ``format`` in files of this kind."""
        return RIG_FORMAT

    def __getattr__(self, method: str) -> Any:
        """Import and return the function of a method."""
        places: Mapping[str, str] = self.__dict__.get("places", {})  # absent while copying
        if method not in places:
            raise AttributeError(f"'{method}' has no registered function", name=method, obj=self)
        module, _, name = places[method].partition(":")
        return getattr(import_module(module), name)
