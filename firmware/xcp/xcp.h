/* SPDX-License-Identifier: Apache-2.0 */
/* XCP slave (ASAM MCD-1 XCP) without transport: performs commands and provides samples. The owner
   of a line adds the transport header.

       xcp_start(&slave, &firmware);                    once
       xcp_tick(&slave)                                 in every tick
       xcp_answer(&slave, ...), xcp_take(...)           between ticks, like app_poll
       xcp_disconnect(&slave);                          after a disconnection

   An address is a number from the tables in contract/, not a memory address. Writes use the same
   functions as requests of the link, with the same limits and refusals. Writing requires a key once
   per connection. Commands count as a heartbeat only after the key. */
#ifndef ANHYST_XCP_H
#define ANHYST_XCP_H

#include "app/board.h"
#include "xcp/daq.h"

typedef struct {
  app *firmware;
  uint32_t address; /* address of the next transfer */
  uint32_t seed;
  uint8_t is_connected;
  uint8_t is_unlocked;
  uint8_t has_seed;         /* whether a seed was sent, and no key received since */
  uint8_t page;             /* page that the master accesses: 0 active block, 1 next block */
  uint8_t is_swapped;       /* 1: the content of page 1 is active */
  uint16_t reported_losses; /* number of lost samples that were reported to the master */
  xcp_daq daq;
} xcp_slave;

void xcp_start(xcp_slave *x, app *firmware);

/* Call it at the end of a tick; it must not interrupt the tick. */
void xcp_tick(xcp_slave *x);

/* Performs a command of `length` bytes and writes its answer of up to XCP_PACKET bytes. Returns the
   length of the answer, 0 if the command has none. */
uint16_t xcp_answer(xcp_slave *x, const uint8_t *command, uint16_t length, uint8_t *answer);

/* Writes the next sample or event and returns its length. Returns 0 if there is none, or if it has
   more than `size` bytes; it then stays in the queue. */
uint16_t xcp_take(xcp_slave *x, uint8_t *packet, uint16_t size);

/* Ends the session: sampling stops, and writing requires the key again. */
void xcp_disconnect(xcp_slave *x);

#endif
