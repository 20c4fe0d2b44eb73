/* SPDX-License-Identifier: Apache-2.0 */
/* What the control task asks of its body: of force (firmware/force) or of position
   (firmware/position). A firmware is built with one of the two; the board gives its memory.

   The task follows ticks, link and hardware; the body judges the sample and finds the currents. All
   of this but app_body_start runs in the tick or between port_lock and port_unlock. */
#ifndef ANHYST_FIRMWARE_BODY_H
#define ANHYST_FIRMWARE_BODY_H

#include "app/board.h"
#include "link/frames.h"
#include "port/port.h"

/* Starts in init, with the block built in. Not for an interrupt: the block is checked. */
void app_body_start(app_body *body, const app_board *board);

/* States and faults. */
anhyst_supervisor *app_body_states(app_body *body);

/* The compensator of a magnet, 0 or 1, or NULL where there is no such; its words are NULL as long
   as no block is valid. */
anhyst_compensator *app_body_compensator(app_body *body, uint16_t magnet);

/* Does a command, or says why it cannot: ANHYST_REFUSED_... */
uint16_t app_body_command(app_body *body, uint16_t command);

/* Goes to fault for a reason outside of the body, and comes to rest as is best for that reason. */
void app_body_fail(app_body *body, uint16_t reason);

/* A demanded force (LINK_BODY_FORCE), or a position to go to (LINK_BODY_POSITION):
   LINK_REASON_NONE, _TYPE where the body controls the other, or _VALUE beyond the limits. */
uint16_t app_body_aim(app_body *body, uint16_t quantity, int32_t value);

/* The last one of these. */
int32_t app_body_goal(const app_body *body);

/* Goes on with another valid block for this board: the memory of the iron is kept, and the swap
   moves no current faster than the ramp to zero. A force goes along that ramp to what the block
   asks for. An armature in the air is controlled on at once, with the new model: what the two
   models differ by fades along the ramp beside it. A conditioning sequence begins again. */
void app_body_swap(app_body *body, const int16_t *words);

/* Takes a value for a setting that is within its range, before it stands in the settings:
   LINK_REASON_NONE; _TYPE where the body cannot do this, or _VALUE where what follows from it is
   not valid, and nothing changes. */
uint16_t app_body_setting(app_body *body, const int32_t *settings, uint16_t number, int32_t value);

/* One tick, `ticks` after the one before: judges the sample, moves the state, finds the currents,
   q31, PORT_CURRENTS of them. Returns flags: ANHYST_... of flags.h. */
uint16_t app_body_tick(app_body *body, const int32_t *settings, const port_sample *sample,
                       uint32_t ticks, int32_t *currents);

/* Fills what it knows of the status, and of the signals after a tick; the rest stays 0. */
void app_body_status(const app_body *body, link_status *status);
void app_body_signals(const app_body *body, const port_sample *sample, int32_t *signals);

#endif
