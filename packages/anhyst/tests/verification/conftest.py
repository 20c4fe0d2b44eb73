"""Compile compensators for the targets once, from loops of the bundled example."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from anhyst.compensate.plan import CompileRequest
from anhyst.compilation.output import compile_model
from tests.compensate.test_solid import LAYERS, magnet
from tests.once import made_once
from tests.truths import path_of

RATE = 10_000.0
NAME = "magnet"

Compile = Callable[[str, str], Path]
Seed = Callable[[str, str, str], Path]


@pytest.fixture(scope="session")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> Compile:
    """Return the folder of a kind of compensator and a signal format.

    ``full`` is Jiles-Atherton, ``cells`` is the same kind for play cells, and ``solid`` is play
    cells with two layers.
    """

    def make(kind: str, io: str, folder: Path) -> None:
        law = "effective-field" if kind in {"full", "simplified"} else "play-cells"
        model = path_of(f"electromagnet-{law}-scaling")
        if kind == "solid":
            model = folder / "solid.toml"
            magnet(LAYERS["two"]).save(model)
        expected = "simplified" if kind == "simplified" else "full"
        compile_model(model, folder / "out", CompileRequest(expected, io, RATE, name=NAME))  # type: ignore[arg-type]

    def give(kind: str, io: str) -> Path:
        name = f"compiled-{kind}-{io}"
        place = made_once(tmp_path_factory, name, lambda folder: make(kind, io, folder))
        return place / "out"

    return give


def sign(folder: Path) -> None:
    """Update the hashes of the manifest."""
    place = folder / "manifest.json"
    manifest = json.loads(place.read_text(encoding="utf-8"))
    for name in manifest["files"]:
        manifest["files"][name] = hashlib.sha256((folder / name).read_bytes()).hexdigest()
    place.write_text(json.dumps(manifest), encoding="utf-8")


@pytest.fixture
def with_fault(compiled: Compile, tmp_path: Path) -> Seed:
    """Return a copy of a compensator with a replaced text in one of its files."""

    def give(name: str, right: str, wrong: str) -> Path:
        folder = tmp_path / "faulty"
        shutil.copytree(compiled("full", "q31"), folder)
        text = (folder / name).read_text(encoding="utf-8")
        assert text.count(right) >= 1, f"{name} no longer holds {right!r}"
        (folder / name).write_text(text.replace(right, wrong, 1), encoding="utf-8")
        sign(folder)
        return folder

    return give
