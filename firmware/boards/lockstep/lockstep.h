/* SPDX-License-Identifier: Apache-2.0 */
/* The firmware on a board without hardware: a virtual plant gives the ticks.

   A tick begins when the plant's sample has arrived and is over when the drive has been sent back;
   the plant waits for it, so that virtual time stands still while either side computes. port_sense,
   port_drive, port_lock, port_unlock and
   port_xcp are implemented here; records as in link/frames.h. */
#ifndef LOCKSTEP_H
#define LOCKSTEP_H

#include <stdint.h>

#include "app/app.h"

/* Constants of the board: board_force.c or board_position.c. */
extern const app_board lockstep_board;

/* Board: sends bytes to the plant, all of them, waiting as long as it takes. */
void board_plant_write(const uint8_t *bytes, uint16_t count);

/* Board: a tick is over, what it drives was sent. */
void board_ticked(void);

/* Starts the firmware and returns it. Once, first. */
app *lockstep_start(void);

/* Answers what came over the link; as often as possible between bytes of the plant. */
void lockstep_poll(void);

/* Takes a byte from the plant. When it completes a valid record, runs the tick and sends the drive.
   After a slip of the stream it finds the next valid record by itself. */
void lockstep_receive(uint8_t byte);

#endif
