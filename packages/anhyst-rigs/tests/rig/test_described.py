"""Check that the pages of the files describe every key and no other."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any, get_args

import pytest
from pydantic import BaseModel

from anhyst.control.controller_file import ControllerTable
from anhyst.support.kinds import MethodName
from anhyst_rigs.rig.file import RigFile
from anhyst_rigs.rig.force.file import SolenoidFile
from anhyst_rigs.rig.sensor_table import GAP_SENSOR_DEFAULTS
from tests.repository import ROOT

DOCS = ROOT / "docs"


def keys(table: type[BaseModel]) -> Iterator[str]:
    for name, field in table.model_fields.items():
        yield field.alias or name
        for inner in tables(field.annotation):
            yield from keys(inner)


def tables(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for inner in get_args(annotation):
        yield from tables(inner)


def described(page: str) -> set[str]:
    """Return all keys that a page mentions."""
    text = (DOCS / page).read_text(encoding="utf-8")
    return {part for name in re.findall(r"`([\w.-]+)`", text) for part in name.split(".")}


def listed(page: str) -> set[str]:
    """Return the keys with their own rows in the tables of a page."""
    return {
        name
        for line in (DOCS / page).read_text(encoding="utf-8").splitlines()
        if line.startswith("| `")
        for name in re.findall(r"`([\w-]+)`", line.split("|")[1])
    }


@pytest.mark.parametrize(
    ("page", "table", "others"),
    [
        ("rig-file.md", RigFile, set[str]()),
        ("controller-file.md", ControllerTable, set(get_args(MethodName))),
    ],
)
def test_every_key_is_described_and_no_other(page: str, table: type[BaseModel], others: set[str]) -> None:
    known = set(keys(table))
    assert known - described(page) == set()
    assert listed(page) - known == others


def test_every_key_of_a_solenoid_is_described() -> None:
    assert set(keys(SolenoidFile)) - described("force-control.md") == set()


def test_the_page_lists_the_defaults_of_each_sensor_kind() -> None:
    text = (DOCS / "rig-file.md").read_text(encoding="utf-8")
    scale = {"nm": 1e-9, "us": 1e-6, "kHz": 1e3, "Hz": 1.0}
    for kind, usual in GAP_SENSOR_DEFAULTS.items():
        (row,) = re.findall(rf"^\| {kind} \| (.*) \|$", text, re.MULTILINE)
        cells = [cell.split() for cell in row.split(" | ")]
        values = [float(c[0]) * scale[c[1]] if c[1:] and c[1] in scale else 0.0 for c in cells]
        expected = [usual.get(key, 0.0) for key in ("step_m", "noise_m", "bandwidth_Hz", "delay_s")]
        assert values == pytest.approx(expected), kind
