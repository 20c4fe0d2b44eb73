"""An instance of an FMU in fmpy, with the same interface for both versions of the standard."""

from __future__ import annotations

import platform
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from anhyst.support.numeric import FloatArray
from anhyst_exchange.exporter import PLATFORMS

fmpy = pytest.importorskip("fmpy")
fmi2, fmi3 = pytest.importorskip("fmpy.fmi2"), pytest.importorskip("fmpy.fmi3")

RATE = 2e4
"""Ticks per second of a compensator."""

HERE = f"{platform.machine().replace('AMD64', 'x86_64')}-linux"
needs_binary = pytest.mark.skipif(HERE not in PLATFORMS, reason=f"no FMU is built for {HERE}")


class Slave:
    """One instance; variables are accessed by name.

    Parameters
    ----------
    path : Path
        The FMU.
    folder : Path
        Folder into which it is unpacked.
    """

    def __init__(self, path: Path, folder: Path) -> None:
        about = fmpy.read_model_description(path)
        self.second = about.fmiVersion == "2.0"
        self.references = {one.name: int(one.valueReference) for one in about.modelVariables}
        self.raw: Any = (fmi2.FMU2Slave if self.second else fmi3.FMU3Slave)(
            guid=about.guid,
            unzipDirectory=str(folder)
            if (folder / "modelDescription.xml").exists()
            else fmpy.extract(str(path), str(folder)),
            modelIdentifier=about.coSimulation.modelIdentifier,
            instanceName="one",
        )
        self.raw.instantiate()

    def begin(self, start: float = 0.0) -> None:
        if self.second:
            self.raw.setupExperiment(startTime=start)
            self.raw.enterInitializationMode()
        else:
            self.raw.enterInitializationMode(startTime=start)
        self.raw.exitInitializationMode()

    def write(self, values: Mapping[str, float]) -> None:
        put = self.raw.setReal if self.second else self.raw.setFloat64
        put([self.references[name] for name in values], [float(one) for one in values.values()])

    def read(self, *names: str) -> list[float]:
        get = self.raw.getReal if self.second else self.raw.getFloat64
        return [float(one) for one in get([self.references[name] for name in names])]

    def run(
        self,
        inputs: Mapping[str, Sequence[float] | FloatArray],
        outputs: Sequence[str],
        step: float,
        begin: float = 0.0,
    ) -> list[list[float]]:
        """Return the outputs after each step, one row per step."""
        found = []
        for place, row in enumerate(zip(*inputs.values(), strict=True)):
            self.write(dict(zip(inputs, row, strict=True)))
            self.raw.doStep(begin + place * step, step)
            found.append(self.read(*outputs))
        return found

    def save(self) -> Any:
        return self.raw.getFMUstate() if self.second else self.raw.getFMUState()

    def restore(self, state: Any) -> None:
        (self.raw.setFMUstate if self.second else self.raw.setFMUState)(state)

    def to_bytes(self, state: Any) -> Any:
        return (self.raw.serializeFMUstate if self.second else self.raw.serializeFMUState)(state)

    def from_bytes(self, kept: Any) -> Any:
        if self.second:
            return self.raw.deSerializeFMUstate(kept)
        return self.raw.deserializeFMUState(kept)


@contextmanager
def slave(path: Path, folder: Path) -> Iterator[Slave]:
    """Yield an instance that runs from time 0."""
    made = Slave(path, folder)
    made.begin()
    yield made
    made.raw.terminate()
    made.raw.freeInstance()
