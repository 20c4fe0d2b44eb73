"""Test that the buttons and the next step on a page agree with the controllers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from anhyst.support.states import Command, State
from anhyst_rigs.link.client import RequestRefusedError
from anhyst_rigs.rig.bench.bearing import BearingBench
from anhyst_rigs.rig.bench.force import ForceBench
from anhyst_rigs.rig.bench.protocol import Bench, controller_status, describe_next_step, refusal_reason
from tests.rig import forces
from tests.study import bearings

Open = Callable[[], Bench]

WAYS: dict[str, tuple[tuple[Command, float], ...]] = {
    "idle": (),
    "conditioning": ((Command.CONDITION, 0.01),),
    "ready": ((Command.DEMAGNETISED, 0.01),),
    "run": ((Command.DEMAGNETISED, 0.01), (Command.LIFT, 0.02)),
    "stopped": ((Command.DEMAGNETISED, 0.01), (Command.LIFT, 0.02), (Command.STOP, 0.01)),
}
"""Commands that lead to each state, with the time after each command, s."""


@pytest.fixture(params=["bearing", "force"])
def opening(request: pytest.FixtureRequest, firmware: Path, tmp_path_factory: pytest.TempPathFactory) -> Open:
    if request.param == "bearing":
        return lambda: BearingBench(bearings.single(), firmware)
    return lambda: ForceBench(forces.example(), forces.program(tmp_path_factory))


def values(bench: Bench, seconds: float) -> dict[str, float]:
    """Return the last values of all signals after this time."""
    rows = bench.advance(round(seconds * bench.rate))
    names = (signal.name for signal in bench.signals)
    return dict(zip(names, rows[-1, 1:].tolist(), strict=True))


def led(bench: Bench, way: Sequence[tuple[Command, float]]) -> dict[str, float]:
    last = values(bench, 0.1)
    for command, after in way:
        known = command is not Command.LIFT or command in bench.commands
        bench.command(command if known else Command.RUN)
        last = values(bench, after)
    return last


def is_refused(bench: Bench, command: Command) -> bool:
    try:
        bench.command(command)
    except RequestRefusedError:
        return True
    return False


@pytest.mark.first(8)
@pytest.mark.parametrize("way", WAYS)
def test_disabled_buttons_are_the_refused_commands(opening: Open, way: str) -> None:
    bench = opening()
    now = controller_status(led(bench, WAYS[way]))
    greyed = {command for command in bench.commands if refusal_reason(command, now)}
    refused = {command for command in greyed if is_refused(bench, command)}
    bench.close()
    assert greyed == refused
    for command in set(bench.commands) - greyed:
        bench = opening()
        led(bench, WAYS[way])
        assert not is_refused(bench, command), command
        bench.close()


def test_the_next_step_that_is_named_leads_back_to_run(opening: Open) -> None:
    bench = opening()
    now, pressed = controller_status(led(bench, WAYS["stopped"])), []
    for _ in range(200):
        if now.state is State.RUN:
            break
        message, _, steps = describe_next_step(bench.commands, now).partition("press ")
        if not message:
            pressed.append(Command[steps.split(maxsplit=1)[0].strip(",").upper()])
            bench.command(pressed[-1])
        now = controller_status(values(bench, 0.05))
    assert now.state is State.RUN
    assert describe_next_step(bench.commands, now) == ""
    bearing = [Command.CLEAR, Command.CONDITION, Command.LIFT]
    assert pressed == (bearing if Command.LIFT in bench.commands else [Command.RUN])
    bench.close()
