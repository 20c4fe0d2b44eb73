/* SPDX-License-Identifier: Apache-2.0 */
/* A slave of XCP (ASAM MCD-1 XCP) without its transport: a command in, an answer out, samples in
   between. Whoever owns a line puts its head around them.

     xcp_start(&slave, &firmware);             once
     xcp_tick(&slave)                          at every tick
     xcp_answer(&slave, ...), xcp_take(...)    between ticks, as app_poll
     xcp_hang_up(&slave);                      when the line is gone

   An address is a number of the tables in contract/, no place in memory. What is written goes where
   the link's own requests go: limits, states and refusals are the same. Writing wants a key, once
   a connection. A master that has shown it keeps the heartbeat by every command; one that has
   not only looks on. */
#ifndef ANHYST_XCP_H
#define ANHYST_XCP_H

#include "app/board.h"
#include "xcp/daq.h"

typedef struct {
  app *firmware;
  uint32_t address; /* where the next transfer begins */
  uint32_t seed;
  uint8_t connected;
  uint8_t unlocked;
  uint8_t asked;     /* whether a seed was given and no key shown yet */
  uint8_t page;      /* that the master sees: 0 the block in force, 1 the next one */
  uint8_t swapped;   /* 1: what page 1 holds is in force */
  uint16_t reported; /* lost samples that the master knows of */
  xcp_daq daq;
} xcp_slave;

void xcp_start(xcp_slave *x, app *firmware);

/* At the end of a tick, which it must not interrupt. */
void xcp_tick(xcp_slave *x);

/* Does a command of `length` bytes and writes its answer, XCP_PACKET bytes at the most: its length,
   0 where none is due. */
uint16_t xcp_answer(xcp_slave *x, const uint8_t *command, uint16_t length, uint8_t *answer);

/* The next sample or event to be sent: its length, XCP_PACKET bytes at the most; 0 where there is
   none, or one of more than `most` bytes, which waits on. */
uint16_t xcp_take(xcp_slave *x, uint8_t *packet, uint16_t most);

/* The master is gone: nothing is sampled, and writing wants the key again. */
void xcp_hang_up(xcp_slave *x);

#endif
