"""Read A2L files; pya2l, which shares no source with the reader, reads them too."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
from pya2l.a2lparser import A2LParser
from pya2l.api.inspect import CompuMethod, Project

from anhyst_rigs.link.foreign.a2l import read_a2l
from anhyst_rigs.link.foreign.variables import BitField, Description
from tests.link.foreign.slaves import MEASUREMENTS, PARAMETERS, a2l_text
from tests.refusals import refused
from tests.verification.conftest import Compile, compiled  # noqa: F401 - a fixture

ADDRESSES = {name: 0x1000 + 8 * n for n, name in enumerate((*MEASUREMENTS, *PARAMETERS))}


def read(folder: Path, text: str) -> Description:
    path = folder / "some.a2l"
    path.write_text(text, encoding="utf-8")
    return read_a2l(path)


def a2l(more: str) -> str:
    return a2l_text(ADDRESSES, more=more)


def characteristic(name: str, method: str, limits: str, kind: str = "SWORD") -> str:
    layout = f"/begin RECORD_LAYOUT of_{name} FNC_VALUES 1 {kind} ROW_DIR DIRECT /end RECORD_LAYOUT"
    return f'{layout}\n/begin CHARACTERISTIC {name} "" VALUE 0x10 of_{name} 0 {method} {limits} /end CHARACTERISTIC'


METHODS = {
    "linear": 'LINEAR "%.3" "mm" COEFFS_LINEAR -0.25 3',
    "straight": 'RAT_FUNC "%.3" "V" COEFFS 0 80 -4 0 0 2',
    "hyperbolic": 'RAT_FUNC "%.3" "1/min" COEFFS 0 1 0 0 0.5 20',
    "square": 'RAT_FUNC "%.3" "" COEFFS 2 1 5 0 0 1',
    "table": 'TAB_INTP "%.3" "C" COMPU_TAB_REF points',
    "codes": 'TAB_NOINTP "%.3" "" COMPU_TAB_REF points',
}
POINTS = '/begin COMPU_TAB points "" TAB_INTP 3 0 -40 50 20 200 150 DEFAULT_VALUE_NUMERIC 999 /end COMPU_TAB'


@pytest.mark.parametrize("name", METHODS)
def test_conversions_equal_those_of_pya2l(tmp_path: Path, name: str) -> None:
    """A value comes back from its raw number, with this reader and with pya2l."""
    method = f'/begin COMPU_METHOD the_{name} "" {METHODS[name]} /end COMPU_METHOD'
    limits = "0 30" if name in {"hyperbolic", "square"} else "-40 150"
    found = read(tmp_path, a2l("\n".join((method, POINTS, characteristic("value", f"the_{name}", limits)))))
    variable = found.variables["value"]
    database = A2LParser().parse(str(tmp_path / "some.a2l"), in_memory=True, loglevel="CRITICAL")
    oracle = CompuMethod.get(database.session, f"the_{name}")
    assert variable.unit == oracle.unit
    values = [-40.0, 20.0, 150.0] if name in {"table", "codes"} else [1.0, 7.5, 29.0]
    for value in values:
        raw = variable.conversion.to_raw(value)
        if name in {"table", "codes"}:  # pya2l inverts no table, and no other rational function
            assert oracle.int_to_physical(raw) == pytest.approx(value)
        else:
            assert oracle.physical_to_int(value) == pytest.approx(raw)
        assert variable.conversion.to_physical(np.array([raw]))[0] == pytest.approx(value)


def test_bit_masks_events_extensions_and_arrays(tmp_path: Path) -> None:
    """Optional keywords are read wherever they are, and texts are no keywords."""
    found = read(
        tmp_path,
        a2l_text(
            ADDRESSES,
            events='/begin DAQ DYNAMIC /begin EVENT "10 ms" "10ms" 3 DAQ 1 10 6 0 /end EVENT /end DAQ',
            more="""
            /begin MEASUREMENT masked "ECU_ADDRESS 0x99" UWORD plain 0 0 0 15 /* a comment */
              BIT_MASK 0x0F0 ECU_ADDRESS_EXTENSION 0x2 ECU_ADDRESS 0x2000 // another
              /begin IF_DATA XCP /begin DAQ_EVENT FIXED_EVENT_LIST EVENT 3 EVENT 0x5 /end DAQ_EVENT /end IF_DATA
            /end MEASUREMENT
            /begin MEASUREMENT row "" FLOAT32_IEEE plain 0 0 0 0 ECU_ADDRESS 0x3000 MATRIX_DIM 3 1 1
              BYTE_ORDER MSB_FIRST READ_WRITE
            /end MEASUREMENT
            /begin CHARACTERISTIC fixed "" VALUE 0x4000 as_FLOAT32_IEEE 0 plain 0 1 READ_ONLY /end CHARACTERISTIC
            """,
        ),
    )
    masked = found.variables["masked"]
    assert (masked.address, masked.extension, masked.bits, masked.events) == (
        0x2000,
        2,
        BitField(4, 4),
        (3, 5),
    )
    assert masked.value_of(b"\xa5\x00") == 0x0A
    assert [(one.name, one.number, one.period_s) for one in found.events] == [("10 ms", 3, 0.01)]
    assert [found.variables[f"row[{n}]"].address for n in range(3)] == [0x3000, 0x3004, 0x3008]
    assert found.variables["row[0]"].dtype == ">f4"
    assert found.variables["row[0]"].is_writable
    assert not found.variables["fixed"].is_writable
    assert '0 off, 5 half "on", 1' in found.variables["par_limited"].doc


def test_quantities_that_cannot_be_shown_rightly_are_counted(tmp_path: Path) -> None:
    """A formula, a curve, an ambiguous conversion and an unknown type are omitted with their reasons."""
    parts = [
        '/begin COMPU_METHOD formula "" FORM "%.3" "" /begin FORMULA "X1*2" /end FORMULA /end COMPU_METHOD',
        characteristic("by_formula", "formula", "0 1"),
        '/begin COMPU_METHOD vertex "" RAT_FUNC "%.3" "" COEFFS 1 0 0 0 0 1 /end COMPU_METHOD',
        characteristic("two_roots", "vertex", "-5 5"),
        characteristic("unknown_type", "plain", "0 1", "COMPLEX_IEEE"),
        '/begin CHARACTERISTIC curve "" CURVE 0x10 as_ULONG 0 plain 0 1 /end CHARACTERISTIC',
        '/begin MEASUREMENT virtual "" UWORD plain 0 0 0 1 /end MEASUREMENT',
        '/begin MEASUREMENT gaps "" UWORD plain 0 0 0 1 ECU_ADDRESS 1 BIT_MASK 5 /end MEASUREMENT',
        '/begin MEASUREMENT ends "" UWORD plain 0 0 0 1 ECU_ADDRESS 1 BYTE_ORDER BIG_ENDIAN /end MEASUREMENT',
        '/begin MEASUREMENT far "" UWORD plain 0 0 0 1 ECU_ADDRESS 0x55a0c80e7010 /end MEASUREMENT',
        '/begin MEASUREMENT over "" UWORD plain 0 0 0 1 ECU_ADDRESS 0xFFFFFFFE ARRAY_SIZE 2 /end MEASUREMENT',
    ]
    found = read(tmp_path, a2l("\n".join(parts)))
    assert set(found.variables) == set(ADDRESSES)
    assert sum(found.omitted.values()) == 9
    text = found.describe_omitted()
    for reason in (
        "conversion FORM",
        "not monotonic",
        "COMPLEX_IEEE",
        "type CURVE",
        "no address",
        "gaps",
        "32 bits",
    ):
        assert reason in text
    assert "BIG_ENDIAN (write MSB_FIRST or MSB_LAST)" in text


BAD = {
    "nothing": ("", "damaged-file: is not an A2L file"),
    "another file": ("[rig]\nname = 1\n", "damaged-file: is not an A2L file"),
    "unclosed text": ('/begin PROJECT p "x\n', "damaged-file: line 1; no closing quote"),
    "wrong end": (
        '/begin PROJECT p ""\n/begin MODULE m ""\n/end PROJECT',
        "damaged-file: line 3; /end PROJECT has no /begin",
    ),
    "missing field": (
        a2l('\n/begin MEASUREMENT short "" UWORD /end MEASUREMENT'),
        "damaged-file: MEASUREMENT short",
    ),
    "no address": (
        '/begin PROJECT p "" /begin MODULE m "" /begin MEASUREMENT a "" UWORD NO_COMPU_METHOD 0 0 0 1\n'
        "/end MEASUREMENT /end MODULE /end PROJECT",
        "no-data: 1 with no address",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_file_gives_one_line(tmp_path: Path, name: str) -> None:
    """The line names the file and the fault."""
    text, message = BAD[name]
    with refused(f"{message}; some.a2l"):
        read(tmp_path, text)


def test_a_file_cut_anywhere_gives_one_line(tmp_path: Path) -> None:
    """No cut is read as a shorter file."""
    text = a2l("")
    for end in range(0, len(text) - 20, 61):
        with refused("damaged-file: some.a2l"):
            read(tmp_path, text[:end])


def test_included_files_are_read(tmp_path: Path) -> None:
    """An included file counts as if its text were in the place of the command."""
    (tmp_path / "part.a2l").write_text(
        '/begin MEASUREMENT there "" UWORD plain 0 0 0 1 ECU_ADDRESS 8 /end MEASUREMENT', encoding="latin-1"
    )
    assert "there" in read(tmp_path, a2l('/include "part.a2l"')).variables
    with refused("cannot-be-read: missing.a2l"):
        read(tmp_path, a2l('/include "missing.a2l"'))


def test_twenty_thousand_quantities_are_read_and_searched_in_seconds(tmp_path: Path) -> None:
    """The time that an engineer waits for a large file."""
    quantity = '/begin MEASUREMENT Ctl.Axis_{n}.speed "" SLONG plain 0 0 0 1 ECU_ADDRESS {n} /end MEASUREMENT'
    begin = time.monotonic()
    found = read(tmp_path, a2l("\n".join(quantity.format(n=n) for n in range(20_000))))
    assert len(found.variables) == 20_000 + len(ADDRESSES)
    assert found.search("axis_199 SPEED", 3)[0].name == "Ctl.Axis_199.speed"
    assert len(found.search("", 200)) == 200
    assert time.monotonic() - begin < 20.0


@pytest.mark.slow
def test_the_file_of_a_controller_equals_what_pya2l_reads(compiled: Compile) -> None:  # noqa: F811
    """Every address, type, limit and unit of the file that anhyst writes."""
    folder = compiled("simplified", "q31")
    (path,) = folder.glob("*.a2l")
    found = read_a2l(path)
    database = A2LParser().parse(str(path), in_memory=True, loglevel="CRITICAL")
    (module,) = Project(database.session).module
    wanted = {one.name: (one.ecuAddress, one) for one in module.measurement.query()}
    wanted |= {one.name: (one.address, one) for one in module.characteristic.query()}
    assert {name.partition("[")[0] for name in found.variables} == set(wanted)
    for name, variable in found.variables.items():
        base, _, index = name.partition("[")
        address, oracle = wanted[base]
        assert variable.address == address + variable.size * int(index.rstrip("]") or 0)
        if oracle.compuMethod.conversionType in {"LINEAR", "IDENTICAL"}:
            assert variable.unit == (oracle.compuMethod.unit or "")
            raw = np.array([3.0])
            assert variable.decode(raw)[0] == pytest.approx(oracle.compuMethod.int_to_physical(3))
    assert [(one.name, one.number) for one in found.events] == [("tick", 0)]
    assert found.has_known_key
