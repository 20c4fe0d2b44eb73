"""What became of a run: held, or lost, and why."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from anhyst.control.states import Command, Flag
from anhyst.rig.bearing.loop import Setup, lost_at
from anhyst.rig.bearing.scenario import Scenario, Script, land_time, steps_up_and_down
from anhyst.rig.recording import BREAKAWAY, FAULT, HOVER, READY, RISE, RUN, Recording

_RESTLESS = 0.01
"""Part of the travel: an armature that moves by more in its hover, rms, is not held."""


@dataclass(frozen=True)
class LevitationRun:
    """A run from power on until the armature lies again."""

    setup: Setup
    recording: Recording  # lift-off, steps, load steps, landing
    steps: Scenario  # the first part of it: lift-off and steps
    landing: int  # tick of the command to land

    def fault(self) -> str | None:
        """Say why the armature was not held until the end of the steps, or None if it was."""
        rig, lifted = self.setup.rig, self.steps.lifted
        steps = self.recording.part(0, self.steps.ticks)
        lost = lost_at(rig, steps, lifted)
        late = self._late(steps)
        if late is not None:
            return late
        if lost is None and len(steps) < self.steps.ticks:
            lost = float(steps["t_s"][-1])
        if lost is not None:
            return f"levitation was lost at {lost:.4f} s: the gains do not hold this bearing"
        body = rig.settings.body
        hover = steps["gap_m"][lifted - lifted // 8 : lifted]
        if float(np.std(hover)) > _RESTLESS * (body.stop_high_m - body.stop_low_m):
            return (
                f"the armature oscillates by {1e6 * float(np.std(hover)):.3g} um rms at "
                f"{lifted * rig.dt:.2f} s: the gains do not hold this bearing"
            )
        return None

    def _late(self, steps: Recording) -> str | None:
        """Say what kept it from levitating, if it was anything but the gains."""
        state, time = steps["state"], steps["t_s"]
        rejected = self._rejected(steps)
        if rejected is not None:
            return rejected
        if not ((state >= RISE) & (state <= HOVER)).any():
            faults = state >= FAULT
            if faults.any():
                force = self.setup.controller.limits.force_high_N
                return (
                    "the armature did not lift: it lay on its rest at "
                    f"{time[np.argmax(faults)]:.4f} s, when {force:g} N were demanded; raise "
                    "force_high_N or lower the load"
                )
            if (state >= RUN).any():
                return f"the armature had not left its rest at {time[-1]:.4f} s"
            return f"the command to lift was refused, the state is {state[-1]:.0f}"
        if len(steps) > self.steps.lifted and state[self.steps.lifted] in (BREAKAWAY, RISE):
            text = f"the armature was still rising at {time[self.steps.lifted]:.4f} s"
            return f"{text}; raise speed_m_per_s or force_rate_N_per_s of [lift_off]"
        return None

    def _rejected(self, steps: Recording) -> str | None:
        """Say whether rejected samples, and no armature out of control, ended the run."""
        implausible = (steps["flags"].astype(int) & int(Flag.SAMPLE_IMPLAUSIBLE)) != 0
        missing = self.setup.controller.safety.max_missing_samples
        # Whether every one of the last samples, and this one, was implausible: the position is lost.
        row = np.convolve(implausible, np.ones(missing + 1), "valid") > missing + 0.5
        if (steps["state"] >= RUN).any():
            row &= steps["state"][missing:] >= FAULT
        if not row.any():
            return None
        end = int(np.argmax(row)) + missing
        gap, body = steps["gap_m"][: end + 1], self.setup.rig.settings.body
        lifted = gap[int(np.argmax(gap < body.stop_high_m)) :]
        touched = (lifted <= body.stop_low_m) | (lifted >= body.stop_high_m)
        if (gap < body.stop_high_m).any() and touched.any():
            return None
        return (
            f"samples of the gap were rejected at {steps['t_s'][end]:.4f} s, {missing + 1} in a "
            "row: see step_m, gap_low_m and gap_high_m of [limits], and the noise of the sensor"
        )

    def lost_later(self) -> list[str]:
        """Say whether the armature was lost in the load steps or the landing of the recording."""
        after = self.recording.part(self.steps.ticks, self.landing)
        if len(after) and lost_at(self.setup.rig, after) is not None:
            return ["load steps of the recording"]
        landing = self.recording.part(self.landing, len(self.recording))
        state, gap = landing["state"], landing["gap_m"]
        hit = gap <= self.setup.rig.settings.body.stop_low_m
        if not len(landing) or state[-1] != READY or hit.any():
            return ["landing of the recording"]
        return []


def parts_of_run(setup: Setup) -> tuple[Scenario, Scenario, int]:
    """Return the run that a simulation records: lift-off and steps; then loads and a landing."""
    rig = setup.rig
    cases, load = rig.settings, rig.settings.load.force_N
    steps = steps_up_and_down(rig, setup.controller, cases.gap_m, cases.step.heights_m)
    script = Script(rig, float(steps.target[-1]))
    for step in cases.load_steps_N:
        script.set_load(load + step).hold(0.15).set_load(load).hold(0.15)
    landing = steps.ticks + script.ticks
    script.command(Command.LAND).hold(land_time(rig, setup.controller))
    return steps, script.build(), landing


def lost_blocks(figures: Mapping[str, Any]) -> list[str]:
    """Name every block of ``figures.json`` in which its own variant lost levitation."""
    own = figures["variant"]
    found = {}
    for row in figures["steps"]:
        if row["variant"] == own and row["lost"]:
            found[f"steps at {1e3 * row['gap_m']:g} mm"] = row["lost"]
    for title, variants in _blocks(figures):
        if variants[own]["lost"]:
            found[title] = variants[own]["lost"]
    blocks = [f"{title} ({_runs(count)})" for title, count in found.items()]
    return blocks + (["sensitivity"] if figures["sensitivity"][own] is None else [])


def _blocks(figures: Mapping[str, Any]) -> Iterator[tuple[str, Mapping[str, Any]]]:
    yield "standstill", figures["standstill"]
    for one in figures["trajectories"]:
        yield f"{one['kind']} of {1e6 * one['amplitude_m']:g} um", one["variants"]
    for one in figures["load_steps"]:
        yield f"load step of {one['force_N']:g} N", one["variants"]
    yield from figures["events"].items()


def _runs(count: int) -> str:
    return "1 run" if count == 1 else f"{count} runs"
