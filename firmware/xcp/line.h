/* SPDX-License-Identifier: Apache-2.0 */
/* XCP on a row of bytes. In front of a packet stand its length and a counter of the sender's
   packets, 16 bits each, low byte first: the form of TCP, and on a serial port the one that SxI
   calls HEADER_LEN_CTR_WORD. There a checksum may follow, CHECKSUM_WORD: behind a packet of odd
   length a zero, then the sum of all words.

     static xcp_line line;
     xcp_line_start(&line, &firmware, ...);    once
     app_tick(&firmware); xcp_line_tick(&line) at every tick
     xcp_line_take(&line, ...)                 what has arrived
     xcp_line_offer(&line, ...), xcp_line_sent(...)

   A length that cannot be breaks the line: nothing of what follows is looked at. Who can hang up
   does so and starts anew; on a line that cannot be hung up all is well again after a silence. */
#ifndef ANHYST_XCP_LINE_H
#define ANHYST_XCP_LINE_H

#include "xcp/xcp.h"

#define XCP_LINE_HEAD 4U
#define XCP_LINE_CHECK 2U
#define XCP_LINE_MOST (XCP_LINE_HEAD + XCP_PACKET + 1U + XCP_LINE_CHECK)

/* For which a line is silent before what had begun is forgotten. */
#define XCP_LINE_SILENCE_MS 100U

typedef struct {
  xcp_slave slave;
  uint8_t checked;   /* whether there are checksums */
  uint8_t broken;    /* nothing is looked at until the silence */
  uint16_t in_count; /* bytes of the command under way */
  uint16_t out_count;
  uint16_t out_at;   /* of these, sent */
  uint16_t counter;  /* of packets sent */
  uint32_t heard_at; /* tick of the last byte */
  uint8_t in[XCP_LINE_MOST];
  uint8_t out[XCP_LINE_MOST];
} xcp_line;

/* checked: whether both ends put a checksum behind every packet. */
void xcp_line_start(xcp_line *line, app *firmware, int checked);

/* Behind app_tick, which it must not interrupt. */
void xcp_line_tick(xcp_line *line);

/* Takes bytes in their order and does the commands in them; how many it took. Once an answer waits
   it takes none until all of it was sent. */
uint16_t xcp_line_take(xcp_line *line, const uint8_t *bytes, uint16_t count);

/* What is to be sent next: an answer, or else an event or a sample. *count: bytes, 0 where there is
   nothing. Good until the next call for this line. */
const uint8_t *xcp_line_offer(xcp_line *line, uint16_t *count);

/* So many of the bytes offered are on their way. */
void xcp_line_sent(xcp_line *line, uint16_t count);

/* The master is gone, and what was on its way with it. */
void xcp_line_hang_up(xcp_line *line);

#endif
