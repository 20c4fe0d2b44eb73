/* SPDX-License-Identifier: Apache-2.0 */
/* Encodes and decodes frames.

   On the wire, a frame is COBS-encoded without zero bytes and ends with a zero. After any invalid
   bytes the next zero starts a new frame, so a receiver loses at most one frame. Every frame has
   its length and a CRC-32. A frame with a wrong length or CRC-32 is discarded and counted. */
#ifndef ANHYST_LINK_FRAME_H
#define ANHYST_LINK_FRAME_H

#include "link/frames.h"

#define LINK_HEADER_BYTES 8
#define LINK_CRC_BYTES 4
#define LINK_MAX_FRAME (LINK_HEADER_BYTES + LINK_MAX_PAYLOAD + LINK_CRC_BYTES)
/* COBS adds one byte to at most 253 bytes; a zero ends the frame. */
#define LINK_MAX_ENCODED_FRAME (LINK_MAX_FRAME + 2)

typedef char link_frame_needs_one_cobs_byte[LINK_MAX_FRAME <= 253 ? 1 : -1];

typedef struct {
  uint8_t version;
  uint8_t type;
  uint8_t sequence;
  uint8_t length; /* number of payload bytes */
  uint32_t tick;
  const uint8_t *payload;
  uint32_t crc; /* received CRC-32 */
} link_frame;

/* The received part of a frame. */
typedef struct {
  uint8_t bytes[LINK_MAX_FRAME + 1]; /* COBS-encoded */
  uint16_t count;                    /* received bytes; more than LINK_MAX_FRAME + 1: too long */
  uint16_t discarded_frames;         /* discarded frames, modulo 65536 */
} link_receiver;

void link_receiver_start(link_receiver *receiver);

/* Processes one byte; every byte is allowed. Returns 1 if it completed a valid frame, now in
   `frame`. The payload points into the receiver and is valid until the next call. Otherwise returns
   0 and leaves `frame` unchanged. A frame of another protocol version is valid. */
int link_receive(link_receiver *receiver, uint8_t byte, link_frame *frame);

/* Writes an encoded frame with checksum to wire (LINK_MAX_ENCODED_FRAME bytes) and returns its
   number of bytes, with the final zero. Ignores frame->crc. Requires frame->length <=
   LINK_MAX_PAYLOAD. */
uint16_t link_encode(uint8_t *wire, const link_frame *frame);

#endif
