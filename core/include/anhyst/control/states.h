/* SPDX-License-Identifier: Apache-2.0 */
/* States, phases, faults and commands of a controller. Made by tools/contract from
   contract/controller.toml. */
/* clang-format off */
#ifndef ANHYST_STATES_H
#define ANHYST_STATES_H

/* State of a force or position controller. */
#define ANHYST_STATE_INIT 0U /* power on, before the first tick */
#define ANHYST_STATE_SELFTEST 1U /* sensors are monitored for some time, no current */
#define ANHYST_STATE_IDLE 2U /* no current, or conditioning (flag) */
#define ANHYST_STATE_READY 3U /* the hysteresis state is assumed to be known, no current */
/* the current follows the demand, or the armature is lifted, held or landed */
#define ANHYST_STATE_RUN 4U
#define ANHYST_STATE_FAULT 5U /* stopping or stopped, reason latched */
#define ANHYST_STATE_COUNT 6U

/* Phase of a position controller. */
#define ANHYST_PHASE_REST 0U /* the currents fall to zero along a ramp and remain zero */
#define ANHYST_PHASE_BREAKAWAY 1U /* the force rises until the armature leaves its rest position */
#define ANHYST_PHASE_RISE 2U /* controlled; the reference moves to the target at a limited speed */
#define ANHYST_PHASE_HOVER 3U /* controlled; the reference is the target */
/* controlled; the reference moves to the rest position at a limited speed */
#define ANHYST_PHASE_DESCEND 4U
/* the demanded force falls until switching off the currents cannot drop the armature */
#define ANHYST_PHASE_SET_DOWN 5U
/* the position signal is lost during levitation: the currents are switched off */
#define ANHYST_PHASE_FALL 6U
#define ANHYST_PHASE_CONDITION 7U /* the currents follow the conditioning sequence */
#define ANHYST_PHASE_COUNT 8U

/* Reason for the state fault; the first reason is latched. */
#define ANHYST_FAULT_NONE 0U
#define ANHYST_FAULT_BLOCK 1U /* the built-in parameter block is invalid */
#define ANHYST_FAULT_LINK_LOST 2U /* no new request for heartbeat_ticks while current may flow */
#define ANHYST_FAULT_MISSED_TICK 3U /* more consecutive missed ticks than the board allows */
#define ANHYST_FAULT_SENSOR_FAILED 4U /* the port returned no sample: the sensors did not respond */
#define ANHYST_FAULT_GAP_RESERVED 5U /* the gap sensor sent its error code */
#define ANHYST_FAULT_GAP_RANGE 6U /* gap outside its plausible range */
#define ANHYST_FAULT_GAP_SLEW 7U /* gap changed faster than is possible */
#define ANHYST_FAULT_GAP_STUCK 8U /* gap showed no noise although the current moved */
#define ANHYST_FAULT_FORCE_RESERVED 9U /* the force sensor sent its error code */
#define ANHYST_FAULT_FORCE_RANGE 10U /* force outside its plausible range */
#define ANHYST_FAULT_FORCE_SLEW 11U /* force changed faster than is possible */
#define ANHYST_FAULT_FORCE_STUCK 12U /* force did not change although the current moved */
#define ANHYST_FAULT_CURRENT_RESERVED 13U /* the current sensor sent its error code */
#define ANHYST_FAULT_CURRENT_RANGE 14U /* current outside its plausible range */
#define ANHYST_FAULT_CURRENT_SLEW 15U /* current changed faster than is possible */
/* the measured current did not change although it should have */
#define ANHYST_FAULT_CURRENT_STUCK 16U
#define ANHYST_FAULT_POSITION_MISSING 17U /* no position sample */
#define ANHYST_FAULT_POSITION_RANGE 18U /* position outside its plausible range */
#define ANHYST_FAULT_POSITION_STEP 19U /* position changed faster than is possible */
#define ANHYST_FAULT_POSITION_STUCK 20U /* position showed no noise although the current moved */
#define ANHYST_FAULT_NO_LIFT 21U /* the largest force did not lift the armature */
#define ANHYST_FAULT_STOPPED 22U /* command stop during levitation */
#define ANHYST_FAULT_AMPLIFIER 23U /* an amplifier reports a fault or does not respond */
#define ANHYST_FAULT_EMERGENCY_STOP 24U /* the emergency stop is open */
#define ANHYST_FAULT_OVER_CURRENT 25U /* the over-current protection of the hardware tripped */
#define ANHYST_FAULT_SUPPLY 26U /* the supply voltage is too low */
#define ANHYST_FAULT_TOO_WARM 27U /* the I^2 t of winding or power stage exceeds its limit */
/* the measured current does not follow the commanded current */
#define ANHYST_FAULT_CURRENT_MISMATCH 28U
#define ANHYST_FAULT_COUNT 29U

/* Commands. */
#define ANHYST_COMMAND_NONE 0U /* no command */
/* idle or ready, at zero current: runs the conditioning sequence, then ready */
#define ANHYST_COMMAND_CONDITION 1U
/* idle or ready, at zero current: sets the state of demagnetised iron, then ready */
#define ANHYST_COMMAND_DEMAGNETISED 2U
/* position: ready to run, if the current is zero and the position is plausible */
#define ANHYST_COMMAND_LIFT 3U
#define ANHYST_COMMAND_LAND 4U /* position: lowers the armature under control, then run to ready */
/* ends conditioning. Force: run to ready. Position: run to fault, which lands the armature */
#define ANHYST_COMMAND_STOP 5U
#define ANHYST_COMMAND_CLEAR 6U /* fault to selftest, if the current is zero */
/* ready, conditioning, or the state run of a force controller: to idle */
#define ANHYST_COMMAND_IDLE 7U
#define ANHYST_COMMAND_ARM 8U /* idle to ready: keeps the hysteresis state */
#define ANHYST_COMMAND_RUN 9U /* force: ready to run with zero demand, if the current is zero */
#define ANHYST_COMMAND_COUNT 10U

#endif
