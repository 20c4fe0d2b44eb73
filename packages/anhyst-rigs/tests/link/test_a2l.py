"""Compare the A2L with its firmware; pya2l reads the A2L, and pyxcp the firmware."""

from __future__ import annotations

import json
import math
import re
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pya2l.a2lparser import A2LParser
from pya2l.api.inspect import Project
from pya2l.api.validate import Validator
from pyxcp.types import XcpResponseError

from anhyst.support.states import Command, Fault, Phase, State
from anhyst.support.xcp_map import INPUTS, SETTINGS, SIGNALS
from anhyst_rigs.link.firmware import build
from anhyst_rigs.link.virtual_boards import Reading, RunningFirmware, run_host
from tests.once import made_once
from tests.verification.conftest import Compile, compiled  # noqa: F401 - a fixture
from tests.verification.test_verify_controller import compile_bearing

from .plant import NoisyPlant
from .xcp_master import ECU, SEGMENT, SERIAL, XCP, master_on, refused

CODES = {"SLONG": "<i", "ULONG": "<I", "SWORD": "<h", "UWORD": "<H", "FLOAT32_IEEE": "<f"}


class Description:
    """An A2L as pya2l reads it, and a board with its firmware."""

    def __init__(self, folder: Path, board: RunningFirmware) -> None:
        self.manifest = json.loads((folder / "manifest.json").read_text())
        place = folder / f"{self.manifest['name']}.a2l"
        self.text = place.read_text()
        self.database = A2LParser().parse(str(place), in_memory=True)
        (self.module,) = Project(self.database.session).module
        self.measurements = {one.name: one for one in self.module.measurement.query()}
        self.characteristics = {one.name: one for one in self.module.characteristic.query()}
        self.board = board

    def code(self, master: Any, name: str) -> float:
        """Return the number at the address that the A2L states."""
        if name in self.measurements:
            one = self.measurements[name]
            address, kind = one.ecuAddress, one.datatype
        else:
            one = self.characteristics[name]
            address, kind = one.address, one.deposit.fncValues.data_type
        (number,) = struct.unpack(CODES[kind], master.shortUpload(struct.calcsize(CODES[kind]), address))
        return float(number)

    def worth(self, master: Any, name: str) -> float:
        """Return this number as a quantity, in the unit of the A2L."""
        one = self.measurements.get(name) or self.characteristics[name]
        return float(one.compuMethod.int_to_physical(self.code(master, name)))

    def write(self, master: Any, name: str, code: int) -> None:
        """Write a number to the address that the A2L states."""
        one = self.characteristics[name]
        master.setMta(one.address, 0)
        master.download(struct.pack(CODES[one.deposit.fncValues.data_type], code))


class Resting(NoisyPlant):
    """A plant whose position is in the middle, for a levitating body."""

    def step(self, tick: int, currents: tuple[float, ...]) -> Reading:
        return super().step(tick, currents)._replace(position=1e-4 * (tick % 2))


pytestmark = pytest.mark.slow


@pytest.fixture(scope="module", params=["force", "position"])
def described(
    request: pytest.FixtureRequest,
    compiled: Compile,  # noqa: F811
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[Description]:
    if request.param == "force":
        folder = compiled("simplified", "q31")
    else:
        folder = made_once(tmp_path_factory, "compiled-bearing", compile_bearing) / "out"
    program = build("host", folder, tmp_path_factory.mktemp("a2l") / "firmware")
    with run_host(program, Resting(), xcp=0) as board:
        board.bus.step(100)
        yield Description(folder, board)


def test_nothing_is_wrong_with_the_file(described: Description) -> None:
    found = Validator(described.database.session)()  # type: ignore[no-untyped-call]
    # The memory has no EPK; identifiers may contain dots since version 1.6.
    assert {one.diag_code.name for one in found} <= {"MISSING_EPK", "MISSING_ADDR_EPK"}, found


def test_the_serial_line_is_described_as_a_master_uses_it(described: Description) -> None:
    """The Nucleo answers a master with these settings: test_xcp_lines.py."""
    (line,) = re.findall(r"/begin XCP_ON_SxI (.*) /end XCP_ON_SxI", described.text)
    _, baud, _, parity, stop, header, tail = line.split()
    assert (int(baud), header, tail) == tuple(SERIAL.values())
    assert (parity, stop) == ("PARITY_NONE", "ONE_STOP_BIT")


def test_every_signal_setting_and_input_has_its_name_and_place(described: Description) -> None:
    body = "force" if described.manifest["controller"] is None else "position"
    assert list(described.measurements) == [value.name for value in SIGNALS]
    operation = {value.name for value in (*SETTINGS, *INPUTS) if value.body in ("", body)}
    words = [name for name in described.characteristics if name.startswith("block.")]
    assert set(described.characteristics) == operation | {*words}
    with master_on(described.board) as master:
        assert master.identifier(1) == described.manifest["name"]
        for name in (*described.measurements, *described.characteristics):
            described.code(master, name)  # the value can be read


def test_states_have_their_names(described: Description) -> None:
    for name, kind in {"state": State, "fault": Fault, "phase": Phase}.items():
        method = described.measurements[name].compuMethod
        for one in kind:
            assert method.int_to_physical(one.value) == one.name.lower()
    method = described.characteristics["command"].compuMethod
    assert method.int_to_physical(Command.RUN.value) == "run"


def test_signals_have_the_scales_and_units_of_the_controller(described: Description) -> None:
    signals, controller = described.manifest["signals"], described.manifest["controller"]
    drive = described.measurements["drive"]
    assert drive.compuMethod.unit == signals["current"]["unit"] == "A"
    assert drive.upperLimit == pytest.approx(signals["current"]["scale"])
    assert described.measurements["force"].compuMethod.int_to_physical(1 << 30) == pytest.approx(
        signals["demand"]["scale"]
    )
    gap = described.measurements["gap"].compuMethod
    assert gap.unit == "m"
    assert gap.int_to_physical(0) == pytest.approx(signals["gap"]["low"])
    assert gap.int_to_physical(1 << 30) == pytest.approx(signals["gap"]["high"])
    with master_on(described.board) as master:
        if controller is not None:
            scale = controller["signals"]["position"]
            position = described.measurements["position"]
            assert position.compuMethod.unit == "m"
            assert position.upperLimit == pytest.approx(scale["scale"])
            # The gap of the controller belongs to the position that it reports.
            shown = described.worth(master, "position")
            at = scale["zero_gap"] - shown
            assert described.worth(master, "gap") == pytest.approx(at, abs=2e-8)


def test_words_of_the_block_are_worth_what_the_manifest_says(described: Description) -> None:
    signals, limits = described.manifest["signals"], described.manifest["limits"]
    with master_on(described.board) as master:
        for name in ("demand", "current"):
            scale = signals[name]["scale"]
            for end, value in zip(("low", "high"), limits[name], strict=True):
                word = f"block.{name}_{end}"
                assert described.worth(master, word) == pytest.approx(value, abs=scale / 2**14)
                assert described.characteristics[word].compuMethod.unit == signals[name]["unit"]
            assert described.worth(master, f"block.scale_{name}") == pytest.approx(scale)
        assert described.worth(master, "block.scale_rate") == described.manifest["rate_Hz"]
        assert described.worth(master, "block.scale_gap_high") == pytest.approx(signals["gap"]["high"])
        assert described.code(master, "block.length") == described.manifest["memory"]["parameters_bytes"] / 2


def ends(one: Any) -> tuple[int, int]:
    """Return the limits of a characteristic as numbers."""
    method = one.compuMethod
    if method.conversionType == "TAB_VERB":
        return int(one.lowerLimit), int(one.upperLimit)
    codes = [method.physical_to_int(limit) for limit in (one.lowerLimit, one.upperLimit)]
    return round(min(codes)), round(max(codes))


def test_settings_and_target_accept_only_values_within_their_limits(described: Description) -> None:
    names = [*(setting.name for setting in SETTINGS), "set_demand", "set_target"]
    with master_on(described.board, unlocked=True) as master:
        for name in filter(described.characteristics.__contains__, names):
            low, high = ends(described.characteristics[name])
            for code in (low, high):
                described.write(master, name, code)
                assert described.code(master, name) == code
            for code in (low - 1, high + 1):
                if -(1 << 31) <= code < 1 << 31:
                    with pytest.raises(XcpResponseError) as error:
                        described.write(master, name, code)
                    assert refused(error.value) == "ERR_OUT_OF_RANGE", name


def is_refused(master: Any) -> bool:
    """Try to activate page 1, and discard it in any case."""
    try:
        master.setCalPage(ECU, SEGMENT, 1)
    except XcpResponseError as error:
        master.copyCalPage(SEGMENT, 0, SEGMENT, 1)
        return refused(error) == "ERR_PAGE_NOT_VALID"
    return False


def test_words_beyond_their_limits_are_refused(described: Description) -> None:
    tried = 0
    taken: set[tuple[str, int]] = set()
    with master_on(described.board, unlocked=True) as master:
        master.setCalPage(XCP, SEGMENT, 1)
        for name, characteristic in described.characteristics.items():
            if not name.startswith("block.") or characteristic.deposit.fncValues.data_type != "SWORD":
                continue
            low, high = ends(characteristic)
            for code in {low - 1, high + 1} & set(range(-(1 << 15), 1 << 15)):
                before = int(described.code(master, name))
                described.write(master, name, code)
                tried += 1
                if not is_refused(master):
                    taken.add((name, code))
                    described.write(master, name, before)
                    assert not is_refused(master)
    # The check of a block accepts -1.0 for these two, one code below the table.
    assert taken <= {("block.demand_low", -(1 << 15)), ("block.current_low", -(1 << 15))}
    assert tried > 30


def test_time_follows_the_clock_of_the_slave(described: Description) -> None:
    """The period is equal in the A2L, in the slave and in the controller."""
    rate = described.manifest["rate_Hz"]
    with master_on(described.board) as master:
        resolution = master.getDaqInfo()["resolution"]
    ticks = resolution["timestampTicks"]
    unit = str(resolution["timestampMode"]["unit"]).rpartition("_")[2]
    assert math.isclose(ticks * {"1NS": 1, "10NS": 10}[unit], 1e9 / rate, rel_tol=1e-4)
    assert f"TIMESTAMP_SUPPORTED {ticks} SIZE_DWORD UNIT_{unit} TIMESTAMP_FIXED" in described.text
