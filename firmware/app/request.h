/* SPDX-License-Identifier: Apache-2.0 */
/* Requests of a PC, used by the link and by XCP. Each function locks out the tick while necessary,
   and refuses with a LINK_REASON_... if limits or states forbid the request. Not for an ISR. */
#ifndef ANHYST_FIRMWARE_REQUEST_H
#define ANHYST_FIRMWARE_REQUEST_H

#include "app/app.h"

/* Restarts the heartbeat time: a PC that may send commands is connected. */
void app_restart_heartbeat(app *a);

/* Returns the number of the last tick; the lock makes the read atomic. */
uint32_t app_last_tick(const app *a);

/* Returns a word of the active block; 0 if there is no active block. */
uint16_t app_active_word(const app *a, uint16_t number);

/* Sets a demanded force or a target position; see app_body_set_reference. */
uint16_t app_set_reference(app *a, uint16_t quantity, int32_t value);

/* Performs a command. *state: state after the command, or the state that refused it. */
uint16_t app_command(app *a, uint16_t command, uint16_t *state);

/* Writes a setting. *state: state in which it was written or refused. */
uint16_t app_setting_write(app *a, uint16_t number, int32_t value, uint16_t *state);

/* Checks the received block and activates it between two ticks. *detail: generation of the active
   block, or the detail of the refusal. */
uint16_t app_block_swap(app *a, uint16_t generation, uint16_t *detail);

/* Changes `count` words of two bytes each from word `at` on, in a copy of the active block. */
uint16_t app_block_edit(app *a, uint16_t at, const uint8_t *bytes, uint16_t count);

/* Returns the edited block of ANHYST_BLOCK_MOST_WORDS words, or NULL if no block is edited. */
const int16_t *app_edited_block(const app *a);

/* Discards the changes: the next change copies the active block again. */
void app_block_discard_edits(app *a);

/* Checks the edited block and activates it. Does nothing without an edited block. After a refusal
   the block can be edited further. *detail has the same meaning as in app_block_swap. */
uint16_t app_block_swap_edited(app *a, uint16_t *detail);

#endif
