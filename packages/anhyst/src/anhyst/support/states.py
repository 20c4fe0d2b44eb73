"""States, phases, faults, commands and flags of a controller.

Made by tools/contract from contract/controller.toml: do not edit.
"""

from __future__ import annotations

from enum import IntEnum, IntFlag


class State(IntEnum):
    """State of a force or position controller."""

    INIT = 0  # power on, before the first tick
    SELFTEST = 1  # sensors are monitored for some time, no current
    IDLE = 2  # no current, or conditioning (flag)
    READY = 3  # the hysteresis state is assumed to be known, no current
    RUN = 4  # the current follows the demand, or the armature is lifted, held or landed
    FAULT = 5  # stopping or stopped, reason latched


class Phase(IntEnum):
    """Phase of a position controller."""

    REST = 0  # the currents fall to zero along a ramp and remain zero
    BREAKAWAY = 1  # the force rises until the armature leaves its rest position
    RISE = 2  # controlled; the reference moves to the target at a limited speed
    HOVER = 3  # controlled; the reference is the target
    DESCEND = 4  # controlled; the reference moves to the rest position at a limited speed
    # the demanded force falls until switching off the currents cannot drop the armature
    SET_DOWN = 5
    FALL = 6  # the position signal is lost during levitation: the currents are switched off
    CONDITION = 7  # the currents follow the conditioning sequence


class Fault(IntEnum):
    """Reason for the state fault; the first reason is latched."""

    NONE = 0
    BLOCK = 1  # the built-in parameter block is invalid
    LINK_LOST = 2  # no new request for heartbeat_ticks while current may flow
    MISSED_TICK = 3  # more consecutive missed ticks than the board allows
    SENSOR_FAILED = 4  # the port returned no sample: the sensors did not respond
    GAP_RESERVED = 5  # the gap sensor sent its error code
    GAP_RANGE = 6  # gap outside its plausible range
    GAP_SLEW = 7  # gap changed faster than is possible
    GAP_STUCK = 8  # gap showed no noise although the current moved
    FORCE_RESERVED = 9  # the force sensor sent its error code
    FORCE_RANGE = 10  # force outside its plausible range
    FORCE_SLEW = 11  # force changed faster than is possible
    FORCE_STUCK = 12  # force did not change although the current moved
    CURRENT_RESERVED = 13  # the current sensor sent its error code
    CURRENT_RANGE = 14  # current outside its plausible range
    CURRENT_SLEW = 15  # current changed faster than is possible
    CURRENT_STUCK = 16  # the measured current did not change although it should have
    POSITION_MISSING = 17  # no position sample
    POSITION_RANGE = 18  # position outside its plausible range
    POSITION_STEP = 19  # position changed faster than is possible
    POSITION_STUCK = 20  # position showed no noise although the current moved
    NO_LIFT = 21  # the largest force did not lift the armature
    STOPPED = 22  # command stop during levitation
    AMPLIFIER = 23  # an amplifier reports a fault or does not respond
    EMERGENCY_STOP = 24  # the emergency stop is open
    OVER_CURRENT = 25  # the over-current protection of the hardware tripped
    SUPPLY = 26  # the supply voltage is too low
    TOO_WARM = 27  # the I^2 t of winding or power stage exceeds its limit
    CURRENT_MISMATCH = 28  # the measured current does not follow the commanded current


class Command(IntEnum):
    """Commands."""

    NONE = 0  # no command
    CONDITION = 1  # idle or ready, at zero current: runs the conditioning sequence, then ready
    # idle or ready, at zero current: sets the state of demagnetised iron, then ready
    DEMAGNETISED = 2
    LIFT = 3  # position: ready to run, if the current is zero and the position is plausible
    LAND = 4  # position: lowers the armature under control, then run to ready
    # ends conditioning. Force: run to ready. Position: run to fault, which lands the armature
    STOP = 5
    CLEAR = 6  # fault to selftest, if the current is zero
    IDLE = 7  # ready, conditioning, or the state run of a force controller: to idle
    ARM = 8  # idle to ready: keeps the hysteresis state
    RUN = 9  # force: ready to run with zero demand, if the current is zero


class Flag(IntFlag):
    """Limits and events of a tick."""

    # the parameter block or the residual force limited the demand of the last tick
    DEMAND_LIMITED = 1
    CURRENT_LIMITED = 2  # the parameter block or the board limited the current
    FLUX_LIMITED = 4  # the parameter block limited the flux
    SAMPLE_IMPLAUSIBLE = 8  # the last plausible sample replaced an implausible one
    COMMAND_REFUSED = 16  # the command of this tick is not allowed in this state
    DEMAND_SLEWING = 32  # the slew limit delays the demand
    CONDITIONING = 64  # the conditioning sequence runs
    KNOWN = 128  # the hysteresis state is assumed to be known
    CURRENT_ZERO = 256  # the commanded current is zero
    GAP_LIMITED = 512  # the gap is outside the range of the parameter block
    UNCOMMITTED = 1024  # two solves without a commit between them
