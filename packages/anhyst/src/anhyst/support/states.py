"""States, phases, faults, commands and flags of a controller.

Made by tools/contract from contract/controller.toml: do not edit.
"""

from __future__ import annotations

from enum import IntEnum, IntFlag


class State(IntEnum):
    """State of a force or position controller."""

    INIT = 0  # power on, before the first tick
    SELFTEST = 1  # checks the sensors, no current
    IDLE = 2  # no current, or conditioning (flag)
    READY = 3  # the hysteresis state is assumed to be known, no current
    RUN = 4  # the current follows the demand, or the armature is lifted, held, landed
    FAULT = 5  # ramps to zero or at rest; the reason is latched


class Phase(IntEnum):
    """Phases of the currents of a position controller."""

    REST = 0  # ramp to zero, then no current
    BREAKAWAY = 1  # the force rises until the armature leaves its rest position
    RISE = 2  # controlled; the reference moves to the target at a limited speed
    HOVER = 3  # controlled; the reference is the target
    DESCEND = 4  # controlled; the reference moves to the rest position at a limited speed
    SET_DOWN = 5  # the force falls, so that the armature does not drop when the currents go to zero
    FALL = 6  # the position is lost in mid-air: the currents are reduced
    CONDITION = 7  # the currents the currents follow the conditioning sequence


class Fault(IntEnum):
    """Reasons for the state fault; the first reason is kept."""

    NONE = 0
    BLOCK = 1  # the built-in parameter block is not valid
    LINK_LOST = 2  # no new request for heartbeat_ticks while current may flow
    MISSED_TICK = 3  # more consecutive ticks missed than the board allows
    SENSOR_FAILED = 4  # the port had no sample: the sensors did not answer
    GAP_RESERVED = 5  # the gap sensor sent its error code
    GAP_RANGE = 6  # gap out of its plausible range
    GAP_SLEW = 7  # gap changed faster than possible
    GAP_STUCK = 8  # gap showed no noise although the current moved
    FORCE_RESERVED = 9  # the force sensor sent its error code
    FORCE_RANGE = 10  # force out of its plausible range
    FORCE_SLEW = 11  # force changed faster than possible
    FORCE_STUCK = 12  # force did not change although the current moved
    CURRENT_RESERVED = 13  # the current sensor sent its error code
    CURRENT_RANGE = 14  # current out of its plausible range
    CURRENT_SLEW = 15  # current changed faster than possible
    CURRENT_STUCK = 16  # the measured current did not change although it should have
    POSITION_MISSING = 17  # no sample of the position
    POSITION_RANGE = 18  # position out of its plausible range
    POSITION_STEP = 19  # position changed faster than possible
    POSITION_STUCK = 20  # position showed no noise although the current moved
    NO_LIFT = 21  # the largest force did not lift the armature
    STOPPED = 22  # command stop while levitated
    AMPLIFIER = 23  # an amplifier reports a fault or does not answer
    EMERGENCY_STOP = 24  # the emergency stop is open
    OVER_CURRENT = 25  # the hardware detected an excessive current
    SUPPLY = 26  # the supply voltage is too low
    TOO_WARM = 27  # winding or power stage: I^2 t exceeds its limit
    CURRENT_MISMATCH = 28  # the measured current does not follow the driven current


class Command(IntEnum):
    """Commands."""

    NONE = 0  # nothing
    # idle or ready, at zero current: runs the conditioning sequence, then enters ready
    CONDITION = 1
    # idle or ready to ready, at zero current: sets the state to that of demagnetised iron
    DEMAGNETISED = 2
    LIFT = 3  # position: ready to run, once the current is zero and the position plausible
    LAND = 4  # position: lands under control, then enters ready
    STOP = 5  # ends conditioning. Force: run to ready. Position: from run to fault, which lands
    CLEAR = 6  # fault to selftest, once the current is zero
    IDLE = 7  # ready, conditioning, or the run of a force to idle
    ARM = 8  # idle to ready: assumes that the present hysteresis state is known
    RUN = 9  # force: ready to run, demand zero, once the current is zero


class Flag(IntFlag):
    """Limits that applied at a tick, and states."""

    DEMAND_LIMITED = 1  # by the parameter block or the residual force, as of the last tick
    CURRENT_LIMITED = 2  # by the parameter block or the board
    FLUX_LIMITED = 4  # by the parameter block
    SAMPLE_IMPLAUSIBLE = 8  # an implausible sample was replaced by the last plausible one
    COMMAND_REFUSED = 16  # this state does not allow the command of this tick
    DEMAND_SLEWING = 32  # the demand still ramps to its target
    CONDITIONING = 64  # the conditioning sequence runs
    KNOWN = 128  # the hysteresis state is assumed to be known
    CURRENT_ZERO = 256  # the driven current is zero
    GAP_LIMITED = 512  # the gap is out of the range of the parameter block
    UNCOMMITTED = 1024  # this solve follows another solve without a commit between them
