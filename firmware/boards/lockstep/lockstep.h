/* SPDX-License-Identifier: Apache-2.0 */
/* The firmware on a board without hardware: a virtual plant gives the ticks.

   A tick begins when the plant's sample has arrived and is over when the drive has been sent back;
   the plant waits for it, so that virtual time stands still while either side computes. All of the
   port but the two ends of the link is here; records as in link/frames.h. */
#ifndef LOCKSTEP_H
#define LOCKSTEP_H

#include <stdint.h>

#include "app/app.h"
#include BOARD_BODY /* force/force.h or position/position.h: what the firmware is built with */

/* A controller and its end of the plant's bus. A board that wants more begins its own struct with
   it: its address is the context of the port. */
typedef struct {
  app firmware;
  app_body body;
  struct port port;
  link_plant_sample sample;                 /* of the tick that began last */
  link_plant_drive drive;                   /* what follows from it */
  uint8_t arriving[LINK_SIZE_PLANT_SAMPLE]; /* a record, as far as it has come */
  uint16_t arrived;
} lockstep;

/* Constants of the board: board_force.c or board_position.c. */
extern const app_board lockstep_board;

/* Starts a controller whose link these are, members of its port. */
void lockstep_start(lockstep *l,
                    uint16_t (*link_read)(void *context, uint8_t *bytes, uint16_t most),
                    uint16_t (*link_write)(void *context, const uint8_t *bytes, uint16_t count));

/* Runs the tick of the sample; the drive is what follows. */
void lockstep_tick(lockstep *l);

/* Takes a byte from the plant. When it completes a valid record, runs the tick, writes the record
   of LINK_SIZE_PLANT_DRIVE bytes that is to be sent back, and returns 1; else 0. After a slip of
   the stream it finds the next valid record by itself. */
int lockstep_receive(lockstep *l, uint8_t byte, uint8_t *answer);

#endif
