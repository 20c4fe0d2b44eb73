"""Controller programs: models compiled to fixed point and built into a firmware."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from anhyst._core import FixedCompensator
from anhyst.compensate.block import Block, Kind, Scales
from anhyst.compensate.interface import MethodName
from anhyst.compensate.plan import CompileRequest
from anhyst.compilation.output import compile_model
from anhyst.link.firmware import build
from anhyst.model.actuator import Model
from anhyst.model.writer import write_model
from anhyst.support.arrays import FloatArray

Codes = NDArray[np.int64]

ONE = 1 << 31


@dataclass(frozen=True)
class Program:
    """A controller program, as it is flashed."""

    kind: Kind  # ``"full"`` or ``"simplified"``
    name: MethodName  # the same, or ``"at-rest"``
    model: Model  # what it was compiled from
    block: Block  # its parameters, of the kind that the model's law has
    cycles: int  # of the start-up sequence
    firmware: Path  # built for the board it runs on

    @property
    def scales(self) -> Scales:
        """What 1.0 of each signal means."""
        return self.block.scales

    @property
    def conditioning(self) -> list[float]:
        """Turning points of the start-up sequence, A: between the limits of the current."""
        low, high = self.block.limits.current
        return [high, low] * self.cycles

    def demand_codes(self, force: FloatArray) -> Codes:
        """Force, N, as the link carries it: q31 of full scale."""
        codes: Codes = np.rint(force / self.scales.demand * ONE).astype(np.int64)
        return np.clip(codes, -ONE, ONE - 1)


@dataclass(frozen=True)
class Session:
    """What passed between a firmware and the bench, tick by tick from power on, as codes."""

    gap: Codes  # gap that the controller used, q31
    drive: Codes  # current it drove, q31 of full scale
    demand: Codes  # demand in force at the ticks of the run, q31
    first: int  # first tick of the run
    # whether the controller got this command just before: what was before does not count
    demagnetised: bool


def prepare(name: MethodName, model: Model, rate: float, board: str, folder: Path) -> Program:
    """Compile a model and build the firmware around it."""
    kind: Kind = "simplified" if name == "simplified" else "full"
    model = model if name == "full" else model.at_rest
    folder.mkdir(parents=True, exist_ok=True)
    write_model(model, folder / "model.toml")
    compiled = compile_model(
        folder / "model.toml", folder / "controller", CompileRequest(kind, "q31", rate)
    )
    block = compiled.plan.block
    assert isinstance(block, Block)
    return Program(
        kind=kind,
        name=name,
        model=model,
        block=block,
        cycles=compiled.plan.builder.conditioning.cycles,
        firmware=build(board, folder / "controller", folder / "firmware"),
    )


def ticks_that_differ(program: Program, session: Session) -> int:
    """Compute a session again in this process, and count where the firmware did otherwise.

    Every tick is repeated with the gap and the demand that the firmware had: what comes out is
    what the simulated program gives, and it must be the same to the last bit.
    """
    core = FixedCompensator(program.block.kind, program.block.words)
    gaps, drives = session.gap.tolist(), session.drive.tolist()
    if not session.demagnetised:
        for gap, drive in zip(gaps[: session.first], drives[: session.first], strict=True):
            core.commit_q31(drive, gap)
    differing = 0
    run = zip(session.demand.tolist(), gaps[session.first :], drives[session.first :], strict=True)
    for demand, gap, drive in run:
        found = core.solve_q31(demand, gap)
        core.commit_q31(found, gap)
        differing += found != drive
    return differing
