"""FMUs for this machine. Each is made once and shared by all tests and workers."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path

import pytest

import anhyst
from anhyst.model.writer import model_text
from anhyst_exchange.exporter import ExportedPart, export_fmu
from anhyst_exchange.part import FmiVersion
from tests.exchange.slave import HERE, RATE
from tests.once import made_once
from tests.truths import truth

Fmu = Callable[[anhyst.Model, ExportedPart, FmiVersion], Path]


@pytest.fixture(scope="session")
def identified() -> anhyst.Model:
    return truth("electromagnet-effective-field-reluctance")


@pytest.fixture(scope="session")
def fmu(tmp_path_factory: pytest.TempPathFactory) -> Fmu:
    """Return the FMU of a model; a compensator runs at :data:`RATE`."""

    def made(model: anhyst.Model, of: ExportedPart, fmi: FmiVersion) -> Path:
        rate = RATE if of == "compensator" else None

        def make(folder: Path) -> None:
            export_fmu(model, folder / "m.fmu", of=of, rate=rate, fmi=fmi, platforms=[HERE])

        content = hashlib.sha256(f"{of} {fmi} {model_text(model)}".encode()).hexdigest()[:16]
        return made_once(tmp_path_factory, f"fmu-{content}", make) / "m.fmu"

    return made
