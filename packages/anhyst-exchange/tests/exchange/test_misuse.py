"""Wrong calls of a tool give an error each, and change nothing."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

import anhyst
import anhyst_exchange
from anhyst_exchange.exporter import ExportedPart
from anhyst_exchange.part import FmiVersion
from tests.exchange.conftest import Fmu
from tests.exchange.slave import Slave, fmi2, needs_binary, slave
from tests.exchange.test_actuator import magnet
from tests.refusals import refused
from tests.repository import ROOT

pytestmark = needs_binary


@pytest.fixture(scope="module")
def model() -> anhyst.Model:
    return magnet("effective-field", "reluctance")


@pytest.fixture(scope="module", params=["2.0", "3.0"])
def fmi(request: pytest.FixtureRequest) -> FmiVersion:
    version: FmiVersion = request.param
    return version


@pytest.fixture(scope="module")
def actuator(fmi: FmiVersion, model: anhyst.Model, fmu: Fmu) -> Path:
    return fmu(model, "actuator", fmi)


def refuses(made: Slave, call: Callable[[], object]) -> None:
    """Check that a call gives an error, and does not change the force now or later."""
    before, state = made.read("force"), made.save()
    with pytest.raises(Exception, match="status"):
        call()
    assert made.read("force") == before
    following = made.run({"current": [1.5]}, ["force"], 1e-3, 1.0)
    made.restore(state)
    assert made.run({"current": [1.5]}, ["force"], 1e-3, 1.0) == following
    made.restore(state)


def test_bad_values_and_steps_are_refused(actuator: Path, tmp_path: Path) -> None:
    with slave(actuator, tmp_path) as made:
        made.run({"current": [2.0, 1.0]}, ["force"], 1e-3)
        for bad in (math.nan, math.inf, -math.inf):
            refuses(made, partial(made.write, {"current": bad}))
            refuses(made, partial(made.write, {"gap": bad}))
        for bad in (-1e-3, math.nan, math.inf):
            refuses(made, partial(made.raw.doStep, 2e-3, bad))
        refuses(made, lambda: made.write({"force": 1.0}))
        refuses(made, lambda: made.write({"M_s_A_per_m": 1.0}))


def test_a_current_or_gap_beyond_all_bounds_is_refused_and_forgotten(actuator: Path, tmp_path: Path) -> None:
    with slave(actuator, tmp_path) as made:
        made.run({"current": [2.0], "gap": [4e-4]}, ["force"], 1e-3)

        def at(name: str, value: float, back: float) -> None:
            made.write({name: value})
            try:
                made.raw.doStep(1e-3, 1e-3)
            finally:
                made.write({name: back})

        refuses(made, lambda: at("current", 1e12, 2.0))
        refuses(made, lambda: at("gap", -1.0, 4e-4))
        beyond = made.run({"current": [2.0], "gap": [7e-4]}, ["force"], 1e-3, 1e-3)
        assert 0.0 < beyond[0][0] < made.run({"current": [2.0], "gap": [4e-4]}, ["force"], 1e-3,
                                             2e-3)[0][0]  # fmt: skip


def test_calls_in_the_wrong_order_are_refused(actuator: Path, tmp_path: Path) -> None:
    made = Slave(actuator, tmp_path)
    for call in (lambda: made.raw.doStep(0.0, 1e-3), made.raw.exitInitializationMode, made.raw.terminate):
        with pytest.raises(Exception, match="status"):
            call()
    made.begin()
    with pytest.raises(Exception, match="status"):
        made.begin()
    made.raw.terminate()
    with pytest.raises(Exception, match="status"):
        made.raw.doStep(0.0, 1e-3)
    made.raw.freeInstance()


def test_after_a_reset_it_is_as_new(actuator: Path, tmp_path: Path) -> None:
    record = {"current": [0.5, 2.0, 4.0, 1.0]}
    with slave(actuator, tmp_path) as made:
        first = made.run(record, ["force"], 1e-3)
        assert made.run(record, ["force"], 1e-3, 4e-3) != first
        made.raw.reset()
        made.begin(0.25)
        assert made.run(record, ["force"], 1e-3, 0.25) == first


def test_bytes_of_another_fmu_are_no_state(
    actuator: Path, fmi: FmiVersion, fmu: Fmu, identified: anhyst.Model, tmp_path: Path
) -> None:
    other = fmu(identified, "compensator", fmi)
    with slave(actuator, tmp_path / "a") as made, slave(other, tmp_path / "b") as foreign:
        kept = foreign.to_bytes(foreign.save())
        with pytest.raises(Exception, match="status"):
            made.from_bytes(kept)
        with pytest.raises(Exception, match="status"):
            made.from_bytes(made.to_bytes(made.save())[:-1])


@pytest.mark.parametrize("of", ["compensator", "actuator"])
def test_a_thousand_instances_leave_nothing_behind(
    of: ExportedPart, fmu: Fmu, identified: anhyst.Model, model: anhyst.Model, tmp_path: Path
) -> None:
    def resident() -> int:
        return 4096 * int(Path("/proc/self/statm").read_text().split()[1])

    path = fmu(identified if of == "compensator" else model, of, "2.0")
    with slave(path, tmp_path) as made:
        first = made.raw
        assert isinstance(first, fmi2.FMU2Slave)
        for count in range(1100):
            if count == 100:
                before = resident()
            component = first.fmi2Instantiate(b"x", 1, first.guid.encode(), b"", first.callbacks, 0, 0)
            assert component
            first.fmi2EnterInitializationMode(component)
            first.fmi2ExitInitializationMode(component)
            first.fmi2DoStep(component, 0.0, 1e-4, 0)
            first.fmi2FreeInstance(component)
        assert resident() - before < 2_000_000
        assert not first.fmi2Instantiate(b"x", 1, b"another", b"", first.callbacks, 0, 0)


def test_heads_on_the_ground_are_not_in_an_fmu(tmp_path: Path) -> None:
    text = (ROOT / "examples" / "planar" / "rig.toml").read_text()
    stands = text.replace('of = "position"', 'of = "position"\nstands = true')
    (tmp_path / "rig.toml").write_text(stands)
    for name in ("loops.csv", "loops.toml"):
        (tmp_path / name).write_bytes((ROOT / "examples" / "planar" / name).read_bytes())
    with refused("not-compiled-controller sensor.stands"):
        anhyst_exchange.export(tmp_path / "rig.toml", tmp_path / "stage.fmu")
    assert not list(tmp_path.glob("*.fmu"))
