/* SPDX-License-Identifier: Apache-2.0 */
/* Interface between the control task and its body. The body controls either a force
   (firmware/force) or a position (firmware/position). A firmware is built with one of the two; the
   board provides its memory. The task handles ticks, link and hardware. The body checks the sample
   and calculates the currents. All functions except app_body_start run in the tick or between
   port_lock and port_unlock. */
#ifndef ANHYST_FIRMWARE_BODY_H
#define ANHYST_FIRMWARE_BODY_H

#include "app/board.h"
#include "link/frames.h"
#include "port/port.h"

/* Starts in the state INIT with the built-in block. It must not be called from an ISR. */
void app_body_start(app_body *body, const app_board *board);

/* Returns the supervisor, which contains states and faults. */
anhyst_supervisor *app_body_states(app_body *body);

/* Returns the compensator of a magnet (0 or 1), or NULL if there is no such magnet. Its words are
   NULL until a block is valid. */
anhyst_compensator *app_body_compensator(app_body *body, uint16_t magnet);

/* Performs a command. Returns ANHYST_REFUSED_NOT, or the reason ANHYST_REFUSED_... of a refusal. */
uint16_t app_body_command(app_body *body, uint16_t command);

/* Enters the state FAULT for a reason outside the body. The reason decides how to come to rest. */
void app_body_fail(app_body *body, uint16_t reason);

/* Sets the demanded force (LINK_BODY_FORCE) or the target position (LINK_BODY_POSITION). Returns
   LINK_REASON_NONE; _TYPE if the body controls the other quantity; _VALUE beyond the limits. */
uint16_t app_body_set_reference(app_body *body, uint16_t quantity, int32_t value);

/* Returns the last demanded force or target position. */
int32_t app_body_goal(const app_body *body);

/* Replaces the block by another valid block for this board. The hysteresis state is transferred,
   and no current changes faster than the ramp to zero. A demanded force moves along this ramp to
   the output of the new block. A levitated armature is controlled with the new model immediately;
   the difference between the models fades along the ramp. A conditioning sequence starts again. */
void app_body_swap(app_body *body, const int16_t *words);

/* Accepts or refuses a value within the range of a setting, before the setting is changed. Returns
   LINK_REASON_NONE; _TYPE if the body does not have this function; _BLOCK without a valid block;
   _VALUE if a derived value is invalid. After a refusal nothing has changed. */
uint16_t app_body_setting(app_body *body, const int32_t *settings, uint16_t number, int32_t value);

/* Runs one tick, `ticks` ticks after the last one: checks the sample, updates the state and
   calculates the PORT_CURRENTS currents, q31. Returns the flags ANHYST_... of flags.h. */
uint16_t app_body_tick(app_body *body, const int32_t *settings, const port_sample *sample,
                       uint32_t ticks, int32_t *currents);

/* Fill the body's part of the status, and of the signals after a tick; other members stay 0. */
void app_body_status(const app_body *body, link_status *status);
void app_body_signals(const app_body *body, const port_sample *sample, int32_t *signals);

#endif
