/* SPDX-License-Identifier: Apache-2.0 */
/* XCP on a byte stream. Each packet starts with its length and a counter of the sender's packets,
   16 bits each, low byte first. This is the format of XCP on TCP and, on a serial port, of SxI
   HEADER_LEN_CTR_WORD. The serial port may add CHECKSUM_WORD: a zero after a packet of odd length,
   then the sum of all words.

       static xcp_line line;
       xcp_line_start(&line, &firmware, ...);    once
       app_tick(&firmware); xcp_line_tick(&line) in every tick
       xcp_line_take(&line, ...)                 received bytes
       xcp_line_offer(&line, ...), xcp_line_sent(...)

   After an invalid length all bytes are ignored. A transport with connections closes the
   connection; a serial line recovers after a silence. */
#ifndef ANHYST_XCP_LINE_H
#define ANHYST_XCP_LINE_H

#include "xcp/xcp.h"

#define XCP_LINE_HEADER_BYTES 4U
#define XCP_LINE_CHECKSUM_BYTES 2U
#define XCP_LINE_MAX_BYTES (XCP_LINE_HEADER_BYTES + XCP_PACKET + 1U + XCP_LINE_CHECKSUM_BYTES)

/* Silence of the line after which an incomplete command is discarded, ms. */
#define XCP_LINE_SILENCE_MS 100U

typedef struct {
  xcp_slave slave;
  uint8_t has_checksum;  /* whether packets have checksums */
  uint8_t ignores_bytes; /* whether bytes are ignored until a silence of the line */
  uint16_t in_count;     /* received bytes of the command */
  uint16_t out_count;
  uint16_t sent_count;         /* number of sent bytes of the member `out` */
  uint16_t counter;            /* number of sent packets */
  uint32_t last_received_tick; /* tick at which the last bytes were received */
  uint8_t in[XCP_LINE_MAX_BYTES];
  uint8_t out[XCP_LINE_MAX_BYTES];
} xcp_line;

/* has_checksum: whether both ends add a checksum to each packet. */
void xcp_line_start(xcp_line *line, app *firmware, int has_checksum);

/* Call it after app_tick; it must not interrupt app_tick. */
void xcp_line_tick(xcp_line *line);

/* Processes bytes and performs the commands in them. Returns the number of processed bytes: 0 while
   a packet is not completely sent. */
uint16_t xcp_line_take(xcp_line *line, const uint8_t *bytes, uint16_t count);

/* Returns the next bytes to be sent: an answer, or otherwise an event or a sample. *count is their
   number, or 0. The bytes stay valid until the next call for this line. */
const uint8_t *xcp_line_offer(xcp_line *line, uint16_t *count);

/* Removes `count` bytes, which have been sent, from the offered bytes. */
void xcp_line_sent(xcp_line *line, uint16_t count);

/* Ends the session: the master is disconnected, and unfinished packets are discarded. */
void xcp_line_disconnect(xcp_line *line);

#endif
