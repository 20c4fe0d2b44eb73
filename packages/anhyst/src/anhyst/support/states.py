"""States, phases, faults, commands and flags of a controller.

Made by tools/contract from contract/controller.toml: do not edit.
"""

from __future__ import annotations

from enum import IntEnum, IntFlag


class State(IntEnum):
    """State of a controller, of force or of position."""

    INIT = 0  # power on, before the first tick
    SELFTEST = 1  # sensors watched for a while, no current
    IDLE = 2  # no current, or conditioning (flag)
    READY = 3  # the memory of the iron is taken as known, no current
    RUN = 4  # the current follows the demand, or the armature is lifted, held, landed
    FAULT = 5  # on the way to rest or there, reason latched


class Phase(IntEnum):
    """What the currents of a controller of position do."""

    REST = 0  # go to zero along a ramp, and stay there
    BREAKAWAY = 1  # the force rises until the armature has left its rest
    RISE = 2  # controlled; the reference goes to the target at a limited speed
    HOVER = 3  # controlled; the reference is the target
    DESCEND = 4  # controlled; the reference goes to the rest at a limited speed
    SET_DOWN = 5  # the force falls, so that currents going to zero let nothing go
    FALL = 6  # the position is lost in mid-air: the currents are let go
    CONDITION = 7  # follow the conditioning sequence


class Fault(IntEnum):
    """Why the controller went to the state fault; the first reason is kept."""

    NONE = 0
    BLOCK = 1  # the parameter block built in is not valid
    LINK_LOST = 2  # no new request for heartbeat_ticks while current may flow
    MISSED_TICK = 3  # more ticks missed in a row than the board allows
    SENSOR_FAILED = 4  # the port had no sample: the sensors did not answer
    GAP_RESERVED = 5  # the gap's sensor sent its error code
    GAP_RANGE = 6  # gap out of its plausible range
    GAP_SLEW = 7  # gap changed faster than it can
    GAP_STUCK = 8  # gap showed no noise although the current moved
    FORCE_RESERVED = 9  # the force sensor sent its error code
    FORCE_RANGE = 10  # force out of its plausible range
    FORCE_SLEW = 11  # force changed faster than it can
    FORCE_STUCK = 12  # force did not change although the current moved
    CURRENT_RESERVED = 13  # the current's sensor sent its error code
    CURRENT_RANGE = 14  # current out of its plausible range
    CURRENT_SLEW = 15  # current changed faster than it can
    CURRENT_STUCK = 16  # the measured current did not change although it should have
    POSITION_MISSING = 17  # no sample of the position
    POSITION_RANGE = 18  # position out of its plausible range
    POSITION_STEP = 19  # position changed faster than it can
    POSITION_STUCK = 20  # position showed no noise although the current moved
    NO_LIFT = 21  # the largest force did not lift the armature
    STOPPED = 22  # the command stop came in the air
    AMPLIFIER = 23  # an amplifier reports a fault or does not answer
    EMERGENCY_STOP = 24  # the emergency stop is open
    OVER_CURRENT = 25  # the hardware saw more current than can be
    SUPPLY = 26  # the supply sags
    TOO_WARM = 27  # winding or power stage: I^2 t has passed its limit
    CURRENT_MISMATCH = 28  # the measured current does not follow the driven current


class Command(IntEnum):
    """What a command asks for."""

    NONE = 0  # nothing
    # idle or ready, at zero current: the conditioning sequence, then by itself to ready
    CONDITION = 1
    # idle or ready to ready, at zero current: the memory is set to that of demagnetised iron
    DEMAGNETISED = 2
    LIFT = 3  # position: ready to run, once the current is zero and the position plausible
    LAND = 4  # position: comes down in a controlled way, then by itself from run to ready
    STOP = 5  # ends conditioning. Force: run to ready. Position: from run to fault, which lands
    CLEAR = 6  # fault to selftest, once the current is zero
    IDLE = 7  # ready, conditioning, or the run of a force to idle
    ARM = 8  # idle to ready: the memory is taken as it stands
    RUN = 9  # force: ready to run, demand zero, once the current is zero


class Flag(IntFlag):
    """What was in the way at a tick, and more."""

    DEMAND_LIMITED = 1  # by the parameter block or the residual force, as of the last tick
    CURRENT_LIMITED = 2  # by the parameter block or the board
    FLUX_LIMITED = 4  # by the parameter block
    SAMPLE_IMPLAUSIBLE = 8  # an implausible sample was replaced by the last plausible one
    COMMAND_REFUSED = 16  # the command of this tick cannot be done in this state
    DEMAND_SLEWING = 32  # the demand in force is still on its way
    CONDITIONING = 64  # the conditioning sequence runs
    KNOWN = 128  # the memory of the iron is taken as known
    CURRENT_ZERO = 256  # the current driven is zero
    GAP_LIMITED = 512  # a gap out of the range of the parameter block
    UNCOMMITTED = 1024  # this solve follows another one without a commit between them
