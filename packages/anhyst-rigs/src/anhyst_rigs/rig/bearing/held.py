"""Determine from a recording whether and why a bearing lost levitation."""

from __future__ import annotations

import numpy as np

from anhyst.support.states import Flag
from anhyst_rigs.rig.bearing.loop import BearingSetup
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.loop import Scenario
from anhyst_rigs.rig.recording import (
    BREAKAWAY_CODE,
    DESCEND_CODE,
    FAULT_CODE,
    HOVER_CODE,
    READY_CODE,
    RISE_CODE,
    RUN_CODE,
    Recording,
    SignalBound,
    find_loss,
)


def levitation_loss_time(rig: BodyRig, recording: Recording, begin: int = 0) -> float | None:
    """Return when a stop was touched or the controller stopped levitating, s; None if never."""
    body = rig.settings.body
    is_fault = recording["state"] >= FAULT_CODE
    if is_fault.any():
        begin = min(begin, int(np.argmax(is_fault)))
    gap, state = recording["gap_m"][begin:], recording["state"][begin:]
    bounds = (
        SignalBound("an end stop was reached", gap, body.stop_low_m, body.stop_high_m),
        SignalBound("the controller gave up", state, RISE_CODE - 1, DESCEND_CODE + 1),
    )
    loss = find_loss(bounds, planned_ticks=len(gap))
    return None if loss is None else float(recording["t_s"][begin + loss.tick])


_MAX_HOVER_RMS_TO_TRAVEL = 0.01
"""Largest rms motion of a hovering armature, as a fraction of the travel; above it, it oscillates.
"""


def levitation_fault(setup: BearingSetup, run: Recording, steps: Scenario) -> str | None:
    """Return why levitation failed between lift-off and the last step; None if it did not fail."""
    rig, lift_end_tick, run = setup.rig, steps.lift_end_tick, run.slice_ticks(0, steps.ticks)
    gap, time = run["gap_m"], run["t_s"]
    loss_time = levitation_loss_time(rig, run, lift_end_tick)
    not_lifted = _rejection_failure(setup, run) or _lift_failure(setup, run, lift_end_tick)
    if not_lifted is not None:
        return not_lifted
    if loss_time is None and len(run) < steps.ticks:
        loss_time = float(time[-1])
    if loss_time is not None:
        return f"levitation was lost at {loss_time:.4f} s: the gains do not stabilise this bearing"
    body = rig.settings.body
    hover_rms = float(np.std(gap[lift_end_tick - lift_end_tick // 8 : lift_end_tick]))
    if hover_rms > _MAX_HOVER_RMS_TO_TRAVEL * (body.stop_high_m - body.stop_low_m):
        return (
            f"the armature oscillates by {1e6 * hover_rms:.3g} um rms at "
            f"{lift_end_tick * rig.dt:.2f} s: the gains do not stabilise this bearing"
        )
    return None


def _lift_failure(setup: BearingSetup, run: Recording, lift_end_tick: int) -> str | None:
    """Return why the armature did not reach its hover position in time; None if it did."""
    state, time = run["state"], run["t_s"]
    if not ((state >= RISE_CODE) & (state <= HOVER_CODE)).any():
        faults = state >= FAULT_CODE
        if faults.any():
            force = setup.controller.limits.force_high_N
            return (
                "the armature did not lift: it was still on its rest at "
                f"{time[np.argmax(faults)]:.4f} s, when {force:g} N were demanded; raise "
                "force_high_N or lower the load"
            )
        if (state >= RUN_CODE).any():
            return f"the armature had not left its rest at {time[-1]:.4f} s"
        return f"the command to lift was refused, the state is {state[-1]:.0f}"
    if len(run) > lift_end_tick and state[lift_end_tick] in (BREAKAWAY_CODE, RISE_CODE):
        text = f"the armature was still rising at {time[lift_end_tick]:.4f} s"
        return f"{text}; raise speed_m_per_s or force_rate_N_per_s of [lift_off]"
    return None


def _rejection_failure(setup: BearingSetup, run: Recording) -> str | None:
    """Return a text if rejected position samples ended the run of a controlled armature."""
    is_implausible = (run["flags"].astype(int) & int(Flag.SAMPLE_IMPLAUSIBLE)) != 0
    max_missing = setup.controller.safety.max_missing_samples
    # Whether this sample and the `max_missing` samples before it were implausible. The controller
    # then regards the position as lost.
    is_position_lost = np.convolve(is_implausible, np.ones(max_missing + 1), "valid") > max_missing + 0.5
    if (run["state"] >= RUN_CODE).any():
        is_position_lost &= run["state"][max_missing:] >= FAULT_CODE
    if not is_position_lost.any():
        return None
    end = int(np.argmax(is_position_lost)) + max_missing
    gap, body = run["gap_m"][: end + 1], setup.rig.settings.body
    lifted_gap = gap[int(np.argmax(gap < body.stop_high_m)) :]
    is_at_stop = (lifted_gap <= body.stop_low_m) | (lifted_gap >= body.stop_high_m)
    if (gap < body.stop_high_m).any() and is_at_stop.any():
        return None
    return (
        f"samples of the gap were rejected at {run['t_s'][end]:.4f} s, {max_missing + 1} in a "
        "row: see step_m, gap_low_m and gap_high_m of [limits], and the noise of the sensor"
    )


def losses_after_steps(rig: BodyRig, run: Recording, begin: int, landing_tick: int) -> list[str]:
    """Describe in words each loss of levitation in the load steps or the landing of a recording."""
    loads, landing_run = run.slice_ticks(begin, landing_tick), run.slice_ticks(landing_tick, len(run))
    if len(loads) and levitation_loss_time(rig, loads) is not None:
        return ["load steps of the recording"]
    is_at_stop = landing_run["gap_m"] <= rig.settings.body.stop_low_m
    if not len(landing_run) or landing_run["state"][-1] != READY_CODE or is_at_stop.any():
        return ["landing of the recording"]
    return []
