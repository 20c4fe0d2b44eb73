/* SPDX-License-Identifier: Apache-2.0 */
/* States, phases, faults and commands of a controller. Made by tools/contract from
   contract/controller.toml. */
/* clang-format off */
#ifndef ANHYST_STATES_H
#define ANHYST_STATES_H

/* State of a controller, of force or of position. */
#define ANHYST_STATE_INIT 0U /* power on, before the first tick */
#define ANHYST_STATE_SELFTEST 1U /* sensors watched for a while, no current */
#define ANHYST_STATE_IDLE 2U /* no current, or conditioning (flag) */
#define ANHYST_STATE_READY 3U /* the memory of the iron is taken as known, no current */
/* the current follows the demand, or the armature is lifted, held, landed */
#define ANHYST_STATE_RUN 4U
#define ANHYST_STATE_FAULT 5U /* on the way to rest or there, reason latched */
#define ANHYST_STATE_COUNT 6U

/* What the currents of a controller of position do. */
#define ANHYST_PHASE_REST 0U /* go to zero along a ramp, and stay there */
#define ANHYST_PHASE_BREAKAWAY 1U /* the force rises until the armature has left its rest */
#define ANHYST_PHASE_RISE 2U /* controlled; the reference goes to the target at a limited speed */
#define ANHYST_PHASE_HOVER 3U /* controlled; the reference is the target */
#define ANHYST_PHASE_DESCEND 4U /* controlled; the reference goes to the rest at a limited speed */
/* the force falls, so that currents going to zero let nothing go */
#define ANHYST_PHASE_SET_DOWN 5U
#define ANHYST_PHASE_FALL 6U /* the position is lost in mid-air: the currents are let go */
#define ANHYST_PHASE_CONDITION 7U /* follow the conditioning sequence */
#define ANHYST_PHASE_COUNT 8U

/* Why the controller went to the state fault; the first reason is kept. */
#define ANHYST_FAULT_NONE 0U
#define ANHYST_FAULT_BLOCK 1U /* the parameter block built in is not valid */
#define ANHYST_FAULT_LINK_LOST 2U /* no new request for heartbeat_ticks while current may flow */
#define ANHYST_FAULT_MISSED_TICK 3U /* more ticks missed in a row than the board allows */
#define ANHYST_FAULT_SENSOR_FAILED 4U /* the port had no sample: the sensors did not answer */
#define ANHYST_FAULT_GAP_RESERVED 5U /* the gap's sensor sent its error code */
#define ANHYST_FAULT_GAP_RANGE 6U /* gap out of its plausible range */
#define ANHYST_FAULT_GAP_SLEW 7U /* gap changed faster than it can */
#define ANHYST_FAULT_GAP_STUCK 8U /* gap showed no noise although the current moved */
#define ANHYST_FAULT_FORCE_RESERVED 9U /* the force sensor sent its error code */
#define ANHYST_FAULT_FORCE_RANGE 10U /* force out of its plausible range */
#define ANHYST_FAULT_FORCE_SLEW 11U /* force changed faster than it can */
#define ANHYST_FAULT_FORCE_STUCK 12U /* force did not change although the current moved */
#define ANHYST_FAULT_CURRENT_RESERVED 13U /* the current's sensor sent its error code */
#define ANHYST_FAULT_CURRENT_RANGE 14U /* current out of its plausible range */
#define ANHYST_FAULT_CURRENT_SLEW 15U /* current changed faster than it can */
/* the measured current did not change although it should have */
#define ANHYST_FAULT_CURRENT_STUCK 16U
#define ANHYST_FAULT_POSITION_MISSING 17U /* no sample of the position */
#define ANHYST_FAULT_POSITION_RANGE 18U /* position out of its plausible range */
#define ANHYST_FAULT_POSITION_STEP 19U /* position changed faster than it can */
#define ANHYST_FAULT_POSITION_STUCK 20U /* position showed no noise although the current moved */
#define ANHYST_FAULT_NO_LIFT 21U /* the largest force did not lift the armature */
#define ANHYST_FAULT_STOPPED 22U /* the command stop came in the air */
#define ANHYST_FAULT_AMPLIFIER 23U /* an amplifier reports a fault or does not answer */
#define ANHYST_FAULT_EMERGENCY_STOP 24U /* the emergency stop is open */
#define ANHYST_FAULT_OVER_CURRENT 25U /* the hardware saw more current than can be */
#define ANHYST_FAULT_SUPPLY 26U /* the supply sags */
#define ANHYST_FAULT_TOO_WARM 27U /* winding or power stage: I^2 t has passed its limit */
/* the measured current does not follow the driven current */
#define ANHYST_FAULT_CURRENT_MISMATCH 28U
#define ANHYST_FAULT_COUNT 29U

/* What a command asks for. */
#define ANHYST_COMMAND_NONE 0U /* nothing */
/* idle or ready, at zero current: the conditioning sequence, then by itself to ready */
#define ANHYST_COMMAND_CONDITION 1U
/* idle or ready to ready, at zero current: the memory is set to that of demagnetised iron */
#define ANHYST_COMMAND_DEMAGNETISED 2U
/* position: ready to run, once the current is zero and the position plausible */
#define ANHYST_COMMAND_LIFT 3U
/* position: comes down in a controlled way, then by itself from run to ready */
#define ANHYST_COMMAND_LAND 4U
/* ends conditioning. Force: run to ready. Position: from run to fault, which lands */
#define ANHYST_COMMAND_STOP 5U
#define ANHYST_COMMAND_CLEAR 6U /* fault to selftest, once the current is zero */
#define ANHYST_COMMAND_IDLE 7U /* ready, conditioning, or the run of a force to idle */
#define ANHYST_COMMAND_ARM 8U /* idle to ready: the memory is taken as it stands */
#define ANHYST_COMMAND_RUN 9U /* force: ready to run, demand zero, once the current is zero */
#define ANHYST_COMMAND_COUNT 10U

#endif
