/* SPDX-License-Identifier: Apache-2.0 */
/* What a PC may ask of the firmware, whatever line it asks on: each of these keeps the tick out as
   long as it must, and refuses what limits and states forbid with a LINK_REASON_... Not for an
   interrupt. */
#ifndef ANHYST_FIRMWARE_REQUEST_H
#define ANHYST_FIRMWARE_REQUEST_H

#include "app/app.h"

/* Somebody who may command is there: the heartbeat. */
void app_alive(app *a);

/* The last tick, in one piece also where a processor reads it in two. */
uint32_t app_last_tick(const app *a);

/* A word of the block in force; 0 where there is none. */
uint16_t app_word_in_force(const app *a, uint16_t number);

/* A force or a position, as app_body_aim. */
uint16_t app_aim(app *a, uint16_t quantity, int32_t value);

/* *state: that the command led to, or in which it was refused. */
uint16_t app_command(app *a, uint16_t command, uint16_t *state);

/* *state: in which it was written or refused. */
uint16_t app_setting_write(app *a, uint16_t number, int32_t value, uint16_t *state);

/* Checks the block that has arrived and puts it in force between two ticks. *detail: its
   generation, or where it is refused what the reason says. */
uint16_t app_block_swap(app *a, uint16_t generation, uint16_t *detail);

/* The other way to a new block: the one in force is copied and changed word by word, `count` words
   of two bytes from `at` on; the first change makes the copy. */
uint16_t app_block_edit(app *a, uint16_t at, const uint8_t *bytes, uint16_t count);

/* The block under edit, ANHYST_BLOCK_MOST_WORDS of it, or NULL where there is none. */
const int16_t *app_block_edited(const app *a);

/* Forgets what was changed: the next change begins with the block in force. */
void app_block_forget(app *a);

/* Checks the block under edit and puts it in force; without one nothing is to be done. Where it is
   refused, it can be edited on. *detail as of app_block_swap. */
uint16_t app_block_swap_edited(app *a, uint16_t *detail);

#endif
