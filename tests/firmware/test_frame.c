/* SPDX-License-Identifier: Apache-2.0 */
/* Claims about the framing: a sent frame arrives, and any damage to it is detected. */
#include "../core/check.h"
#include "link/frame.h"

#include <string.h>

static link_receiver receiver;
static link_frame got;

static int feed_bytes(const uint8_t *bytes, uint16_t count)
{
  int frames = 0;
  for (uint16_t i = 0; i < count; i++) {
    frames += link_receive(&receiver, bytes[i], &got);
  }
  return frames;
}

static uint16_t encode(uint8_t *wire, const uint8_t *payload, uint8_t length)
{
  const link_frame frame = {LINK_VERSION, 0x42, 17, length, 0xFEDC0100U, payload, 0};
  return link_encode(wire, &frame);
}

/* Difficult payloads for COBS: no zero, only zeros, a zero at each position, and counting bytes. */
static void fill(uint8_t *payload, uint8_t length, int pattern)
{
  for (int i = 0; i < length; i++) {
    switch (pattern) {
    case 0:
      payload[i] = 0xFF;
      break;
    case 1:
      payload[i] = 0;
      break;
    case 2:
      payload[i] = (uint8_t)(i == length / 2 ? 0 : 1);
      break;
    default:
      payload[i] = (uint8_t)i;
      break;
    }
  }
}

static void every_payload_length_arrives_unchanged(void)
{
  uint8_t payload[LINK_MAX_PAYLOAD];
  uint8_t wire[LINK_MAX_ENCODED_FRAME];
  link_receiver_start(&receiver);
  for (int length = 0; length <= LINK_MAX_PAYLOAD; length++) {
    for (int pattern = 0; pattern < 4; pattern++) {
      fill(payload, (uint8_t)length, pattern);
      const uint16_t count = encode(wire, payload, (uint8_t)length);
      CHECK(count == LINK_HEADER_BYTES + length + LINK_CRC_BYTES + 2);
      CHECK(memchr(wire, 0, count) == wire + count - 1);
      CHECK(feed_bytes(wire, count) == 1);
      CHECK(got.version == LINK_VERSION && got.type == 0x42 && got.sequence == 17);
      CHECK(got.tick == 0xFEDC0100U && got.length == length);
      CHECK(memcmp(got.payload, payload, (size_t)length) == 0);
    }
  }
  CHECK(receiver.discarded_frames == 0);
}

static void every_single_flipped_bit_is_detected(void)
{
  uint8_t payload[20];
  uint8_t wire[LINK_MAX_ENCODED_FRAME];
  fill(payload, sizeof payload, 3);
  const uint16_t count = encode(wire, payload, sizeof payload);
  for (int bit = 0; bit < 8 * count; bit++) {
    wire[bit / 8] ^= (uint8_t)(1U << (bit % 8));
    link_receiver_start(&receiver);
    CHECK(feed_bytes(wire, count) == 0);
    wire[bit / 8] ^= (uint8_t)(1U << (bit % 8));
  }
}

static void truncated_frame_is_discarded_and_counted(void)
{
  const uint8_t zero = 0;
  uint8_t payload[20];
  uint8_t wire[LINK_MAX_ENCODED_FRAME];
  fill(payload, sizeof payload, 3);
  const uint16_t count = encode(wire, payload, sizeof payload);
  link_receiver_start(&receiver);
  for (uint16_t part = 1; part + 1 < count; part++) {
    CHECK(feed_bytes(wire, part) == 0);
    CHECK(feed_bytes(&zero, 1) == 0);
    CHECK(receiver.discarded_frames == part);
  }
}

static void second_frame_after_any_garbage_arrives(void)
{
  uint8_t payload[5];
  uint8_t wire[LINK_MAX_ENCODED_FRAME];
  uint8_t garbage[1000] = {0};
  uint32_t random = 1;
  fill(payload, sizeof payload, 3);
  const uint16_t count = encode(wire, payload, sizeof payload);
  for (int round = 0; round < 300; round++) {
    for (int i = 0; i < round; i++) {
      random = random * 1664525U + 1013904223U;
      garbage[i] = (uint8_t)(random >> 24);
    }
    link_receiver_start(&receiver);
    CHECK(feed_bytes(garbage, (uint16_t)round) == 0);
    const int first = feed_bytes(wire, count);
    CHECK(first == 0 || first == 1);
    CHECK(feed_bytes(wire, count) == 1);
  }
}

static void too_long_frame_costs_one_frame_and_no_memory(void)
{
  uint8_t payload[5];
  uint8_t wire[LINK_MAX_ENCODED_FRAME];
  const uint8_t one = 1;
  const uint8_t zero = 0;
  fill(payload, sizeof payload, 3);
  const uint16_t count = encode(wire, payload, sizeof payload);
  link_receiver_start(&receiver);
  for (long i = 0; i < 0x10000; i++) { /* a counter of 16 bits would be zero again */
    CHECK(feed_bytes(&one, 1) == 0);
  }
  CHECK(feed_bytes(wire, count) == 0);
  CHECK(feed_bytes(&zero, 1) == 0);
  CHECK(receiver.discarded_frames == 1);
  CHECK(feed_bytes(wire, count) == 1);
}

static void zeros_between_frames_are_no_frames(void)
{
  const uint8_t zeros[3] = {0, 0, 0};
  link_receiver_start(&receiver);
  CHECK(feed_bytes(zeros, 3) == 0);
  CHECK(receiver.discarded_frames == 0);
}

static void wrong_length_in_the_header_is_refused(void)
{
  uint8_t plain[LINK_MAX_ENCODED_FRAME];
  uint8_t payload[4] = {1, 2, 3, 4};
  link_receiver_start(&receiver);
  /* The end of the payload could be the checksum of a shorter frame. That frame would need another
     length byte, which the checksum covers. */
  const uint16_t count = encode(plain, payload, 4);
  for (int length = 0; length < 256; length++) {
    if (length != 4) {
      uint8_t wire[LINK_MAX_ENCODED_FRAME];
      memcpy(wire, plain, count);
      wire[4] = (uint8_t)(length == 0 ? 1 : length);
      CHECK(feed_bytes(wire, count) == 0);
    }
  }
}

static void numbers_keep_sign_and_order(void)
{
  uint8_t p[4];
  link_put_u32(p, 0x80000001U);
  CHECK(p[0] == 1 && p[1] == 0 && p[2] == 0 && p[3] == 0x80);
  CHECK(link_get_i32(p) == -INT32_MAX);
  link_put_u32(p, 0x80000000U);
  CHECK(link_get_i32(p) == INT32_MIN);
  link_put_u32(p, 0xFFFFFFFFU);
  CHECK(link_get_i32(p) == -1 && link_get_i16(p) == -1);
  link_put_u16(p, 0x8000U);
  CHECK(link_get_i16(p) == INT16_MIN);
  link_put_u16(p, 0x7FFFU);
  CHECK(link_get_i16(p) == INT16_MAX);
}

static void misaligned_plant_record_is_detected(void)
{
  uint8_t p[LINK_SIZE_PLANT_SAMPLE];
  uint32_t check = LINK_PLANT_MAGIC;
  link_plant_sample sample;
  for (uint8_t *at = p; at < p + LINK_SIZE_PLANT_SAMPLE - 4; at += 4) {
    const uint32_t word = 0x01020304U * (uint32_t)(at + 4 - p) / 4U;
    link_put_u32(at, word);
    check ^= word;
  }
  link_put_u32(p + LINK_SIZE_PLANT_SAMPLE - 4, check);
  CHECK(link_get_plant_sample(&sample, p) == 1);
  CHECK(sample.tick == 0x01020304U && sample.status == 7U * 0x01020304U);
  memmove(p, p + 1, sizeof p - 1);
  CHECK(link_get_plant_sample(&sample, p) == 0);
}

int main(void)
{
  every_payload_length_arrives_unchanged();
  every_single_flipped_bit_is_detected();
  truncated_frame_is_discarded_and_counted();
  second_frame_after_any_garbage_arrives();
  too_long_frame_costs_one_frame_and_no_memory();
  zeros_between_frames_are_no_frames();
  wrong_length_in_the_header_is_refused();
  numbers_keep_sign_and_order();
  misaligned_plant_record_is_detected();
  return verdict();
}
