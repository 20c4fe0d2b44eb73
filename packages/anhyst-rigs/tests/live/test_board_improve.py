"""Test that a model of a running controller is measured, identified and swapped over XCP."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from anhyst.cli.app import main
from anhyst.support.states import Command, State
from anhyst_rigs.dashboard.improver import Improver
from anhyst_rigs.dashboard.session import LiveSession
from anhyst_rigs.link.firmware import build
from anhyst_rigs.rig.bench.force import StandPlant
from anhyst_rigs.study.bench import open_board, prepare_board
from anhyst_rigs.study.prepared_benches import PreparedForce
from tests.live.board import Board, running
from tests.live.conftest import wait_for
from tests.live.test_improve import done, order
from tests.refusals import refused
from tests.repository import ROOT


@pytest.fixture
def board(prepared: PreparedForce, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Board]:
    rig, plant = (prepared.complete_rig, StandPlant.with_operator(prepared.complete_rig, prepared.program, 0))
    program = build("host", folder_of(prepared), tmp_path_factory.mktemp("board") / "firmware")
    with running(program, plant, rig.settings.timing.rate_Hz) as started:
        wait_for(lambda: started.bus.state is State.IDLE)
        yield started


def folder_of(prepared: PreparedForce) -> Path:
    return prepared.firmware.parent / "controller"


@pytest.fixture
def session(prepared: PreparedForce, board: Board) -> Iterator[LiveSession]:
    folder = folder_of(prepared)
    bench = open_board(folder, board.xcp)
    improver = Improver(prepare_board(prepared.rig, folder), bench)
    opened = LiveSession(bench, improver=improver)
    opened.start()
    yield opened
    opened.close()


def force_error(session: LiveSession) -> float:
    """Condition the iron, then return the rms force error, N."""

    def swing() -> float:
        bench = session.bench
        at = {signal.name: 1 + n for n, signal in enumerate(bench.signals)}

        def reach(state: State) -> None:
            while bench.advance(20)[-1, at["state"]] != state:
                pass

        bench.command(Command.IDLE)
        reach(State.IDLE)
        bench.command(Command.CONDITION)
        reach(State.READY)
        bench.command(Command.RUN)
        reach(State.RUN)
        parts = []
        for force in (32.0, 6.0, 25.0, 12.0, 32.0, 2.0):
            bench.demand(force)
            parts.append(bench.advance(300)[150:])
        bench.command(Command.STOP)
        reach(State.READY)
        rows = np.concatenate(parts)
        error = rows[:, at["force"]] - rows[:, at["demand"]]
        return float(np.sqrt(np.mean(np.square(error))))

    return session.run_between_chunks(swing)


def settings(session: LiveSession) -> dict[str, float]:
    return {parameter.name: parameter.value for parameter in session.parameters}


# The module test_improve.py tests the virtual bench,
# packages/anhyst-rigs/tests/study/test_board_swap.py a swap on a board.
@pytest.mark.campaign
@pytest.mark.slow
def test_an_unknown_iron_is_measured_identified_and_swapped_in_on_a_board(
    session: LiveSession, board: Board
) -> None:
    order_command(session, "condition")
    wait_for(lambda: board.bus.state is State.READY)
    before, known = force_error(session), settings(session)
    measured = done(session, "measure")
    assert board.bus.state is State.READY
    assert settings(session) == known
    limits = measured["limits"]
    assert measured["gaps"][0]["current_max_A"] <= limits["current_A"]["value"]
    assert max(measured["played"]["current"]) <= 1.01 * limits["current_A"]["value"]
    found = done(session, "identify")
    assert found["new"]["rms_N"] < 0.4 * found["old"]["rms_N"]
    done(session, "compile")
    assert order(session, "swap")["applied"] > 0
    after = force_error(session)
    print(f"force error {before:.3f} N, {after:.3f} N after the swap")
    assert after < 0.4 * before
    order(session, "back")
    assert force_error(session) == pytest.approx(before, rel=0.1)


def order_command(session: LiveSession, name: str) -> None:
    from anhyst_rigs.dashboard.orders import perform

    session.run_between_chunks(lambda: perform(session, "browser 1", {"do": "command", "name": name}))


def test_a_stopped_measurement_restores_the_controller(session: LiveSession, board: Board) -> None:
    known = settings(session)
    for end in ("stop", "cancel"):
        order(session, "measure")
        wait_for(lambda: board.bus.state is State.RUN)
        with refused("busy"):
            order_command(session, "run")
        if end == "stop":
            session.run_between_chunks(lambda: session.stop("somebody"))
        else:
            order(session, "cancel")
        wait_for(lambda: not session.status()["improve"]["step"])
        wait_for(lambda: board.bus.state is State.IDLE)  # the previous state
        assert settings(session) == known
        why = "ready" if end == "stop" else "cancelled"
        assert why in session.status()["improve"]["trouble"]


@pytest.mark.slow
def test_a_force_limit_applies_from_the_first_tick(session: LiveSession) -> None:
    limit = 30.0
    at = 1 + [signal.name for signal in session.bench.signals].index("force")
    read: list[float] = []
    session.subscribe(lambda rows: read.append(float(rows[:, at].max())))
    order(session, "measure", limits={"force_N": limit})
    wait_for(lambda: session.status()["improve"]["share"] > 0.0 or not drives(session))
    order(session, "cancel")
    wait_for(lambda: not drives(session))
    assert 0.8 * limit < max(read) < limit


def drives(session: LiveSession) -> bool:
    assert session.improver is not None
    return session.improver.is_driving


def test_options_that_do_not_fit_a_board_are_refused(prepared: PreparedForce, tmp_path: Path) -> None:
    folder = folder_of(prepared)
    rig, out = str(prepared.rig), ["--out", str(tmp_path / "new.csv")]
    assert main(["excite", rig, *out, "--xcp", "127.0.0.1:9"]) == 2  # no folder
    assert main(["excite", rig, *out, "--folder", str(folder)]) == 2  # no XCP address
    assert main(["live", rig, "--rig", rig]) == 2
    bearing = ROOT / "examples" / "bearing" / "rig.toml"
    with refused("wrong-kind"):
        prepare_board(bearing, folder)
    manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    manifest["model"]["sha256"] = "0" * 64
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
    with refused("model-file-missing"):
        prepare_board(prepared.rig, tmp_path / "other")


@pytest.mark.slow
def test_loops_are_measured_through_a_board_without_a_page(
    prepared: PreparedForce, board: Board, tmp_path: Path
) -> None:
    out = tmp_path / "new.csv"
    reached = ["--xcp", board.xcp.removeprefix("socket://"), "--folder", str(folder_of(prepared))]
    assert main(["excite", str(prepared.rig), *reached, "--out", str(out)]) == 0
    assert board.bus.state is State.IDLE
    given = ["--law", "effective-field", "--out", str(tmp_path / "model.toml")]
    assert main(["identify", str(out), *given]) == 0
