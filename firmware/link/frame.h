/* SPDX-License-Identifier: Apache-2.0 */
/* Frames from bytes and bytes from frames.

   On the wire a frame is COBS-encoded, so that no byte of it is zero, and ends with a zero.
   Whatever garbage came before, the next zero starts a new frame: a receiver is in step again after
   at most one lost frame. Every frame carries its length and a CRC-32; one that does not agree is
   thrown away and counted. */
#ifndef ANHYST_LINK_FRAME_H
#define ANHYST_LINK_FRAME_H

#include "link/frames.h"

#define LINK_HEAD 8
#define LINK_CHECK 4
#define LINK_FRAME_MOST (LINK_HEAD + LINK_PAYLOAD_MOST + LINK_CHECK)
/* COBS adds one byte to a frame of up to 253 bytes, then comes the zero. */
#define LINK_WIRE_MOST (LINK_FRAME_MOST + 2)

typedef char link_frame_needs_one_cobs_byte[LINK_FRAME_MOST <= 253 ? 1 : -1];

typedef struct {
  uint8_t version;
  uint8_t type;
  uint8_t sequence;
  uint8_t length; /* of the payload */
  uint32_t tick;
  const uint8_t *payload;
  uint32_t check; /* the CRC-32 that it carried */
} link_frame;

/* What has arrived of the frame that is under way. */
typedef struct {
  uint8_t bytes[LINK_FRAME_MOST + 1]; /* still encoded */
  uint16_t count;                     /* bytes so far; more than fit: to be thrown away */
  uint16_t bad;                       /* frames thrown away, modulo 65536 */
} link_receiver;

/* Starts with nothing received and nothing counted. */
void link_receiver_start(link_receiver *receiver);

/* Takes one byte. 1: it completed a valid frame, which is now in *frame; its payload points into
   the receiver and is good until the next call. 0: no frame yet, and *frame is untouched. Any
   byte at any time is fine. A frame of another protocol version is valid. */
int link_receive(link_receiver *receiver, uint8_t byte, link_frame *frame);

/* Writes a frame with its checksum to wire (LINK_WIRE_MOST bytes) as it is to be sent and returns
   the number of bytes, zero at the end included. frame->check is not used.
   Precondition: frame->length <= LINK_PAYLOAD_MOST. */
uint16_t link_encode(uint8_t *wire, const link_frame *frame);

#endif
