/* SPDX-License-Identifier: Apache-2.0 */
#include "link/frame.h"

#include "link/crc.h"

void link_receiver_start(link_receiver *receiver)
{
  receiver->count = 0;
  receiver->discarded_frames = 0;
}

/* Decodes COBS in place and returns the number of decoded bytes, 0 if the code is invalid. The
   write position never overtakes the read position. Requires nonzero bytes. */
static uint16_t cobs_decode(uint8_t *bytes, uint16_t count)
{
  uint16_t in = 0;
  uint16_t out = 0;
  while (in < count) {
    const uint16_t end = (uint16_t)(in + bytes[in]);
    if (end > count) {
      return 0;
    }
    for (in++; in < end; in++) {
      bytes[out++] = bytes[in];
    }
    if (in < count) {
      bytes[out++] = 0;
    }
  }
  return out;
}

/* Parses decoded bytes as a frame. Returns 1 if length and checksum are right. */
static int parse_frame(const uint8_t *bytes, uint16_t count, link_frame *frame)
{
  const uint16_t overhead = LINK_HEADER_BYTES + LINK_CRC_BYTES;
  if (count < overhead || count - overhead != bytes[3]) {
    return 0;
  }
  const uint16_t crc_bytes = (uint16_t)(count - LINK_CRC_BYTES);
  const uint32_t check = link_get_u32(bytes + crc_bytes);
  if (link_crc32(0, bytes, crc_bytes) != check) {
    return 0;
  }
  frame->version = bytes[0];
  frame->type = bytes[1];
  frame->sequence = bytes[2];
  frame->length = bytes[3];
  frame->tick = link_get_u32(bytes + 4);
  frame->payload = bytes + LINK_HEADER_BYTES;
  frame->crc = check;
  return 1;
}

int link_receive(link_receiver *receiver, uint8_t byte, link_frame *frame)
{
  const uint16_t capacity = (uint16_t)sizeof receiver->bytes;
  if (byte != 0) {
    if (receiver->count < capacity) {
      receiver->bytes[receiver->count] = byte;
    }
    if (receiver->count <= capacity) {
      receiver->count++;
    }
    return 0;
  }
  const uint16_t count = receiver->count;
  receiver->count = 0;
  if (count == 0) {
    return 0; /* zeros between frames are allowed, because a sender may clear the line with them */
  }
  if (count <= capacity &&
      parse_frame(receiver->bytes, cobs_decode(receiver->bytes, count), frame)) {
    return 1;
  }
  receiver->discarded_frames++;
  return 0;
}

uint16_t link_encode(uint8_t *wire, const link_frame *frame)
{
  /* The frame starts at the second byte. The first byte becomes the first COBS code. */
  uint8_t *plain = wire + 1;
  const uint16_t crc_bytes = (uint16_t)(LINK_HEADER_BYTES + frame->length);
  const uint16_t count = (uint16_t)(crc_bytes + LINK_CRC_BYTES);
  plain[0] = frame->version;
  plain[1] = frame->type;
  plain[2] = frame->sequence;
  plain[3] = frame->length;
  link_put_u32(plain + 4, frame->tick);
  for (uint16_t i = 0; i < frame->length; i++) {
    plain[LINK_HEADER_BYTES + i] = frame->payload[i];
  }
  link_put_u32(plain + crc_bytes, link_crc32(0, plain, crc_bytes));
  /* Replaces each zero by the distance to the next zero, from the end backwards. */
  uint16_t next = (uint16_t)(count + 1);
  for (uint16_t i = count; i > 0; i--) {
    if (wire[i] == 0) {
      wire[i] = (uint8_t)(next - i);
      next = i;
    }
  }
  wire[0] = (uint8_t)next;
  wire[count + 1] = 0;
  return (uint16_t)(count + 2);
}
