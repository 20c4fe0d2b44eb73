/* SPDX-License-Identifier: Apache-2.0 */
/* Claims about XCP inside frames of the link. */
#include "../core/check.h"
#include "bench.h"

#include <string.h>

#include "link/crc.h"

#define SAMPLE 39U /* packet of eight signals, after its length */

/* Sends a command in a frame. Its answer is in bench.payload. */
static uint8_t send_in_frame(const uint8_t *command, uint8_t length)
{
  return bench_request(LINK_TYPE_XCP, command, length);
}

#define SEND_IN_FRAME(...)                                                                         \
  send_in_frame((const uint8_t[]){__VA_ARGS__}, (uint8_t)sizeof((const uint8_t[]){__VA_ARGS__}))

static void connect_master(void)
{
  bench_start();
  CHECK(SEND_IN_FRAME(0xFF, 0) == LINK_TYPE_XCP_PACKETS);
  CHECK(bench.answer.length == 9 && bench.payload[0] == 8 && bench.payload[1] == 0xFF);
}

static void show_key(void)
{
  uint8_t command[6] = {0xF7, 4};
  CHECK(SEND_IN_FRAME(0xF8, 0, 1) == LINK_TYPE_XCP_PACKETS && bench.payload[0] == 6);
  link_put_u32(command + 2, link_crc32(XCP_SECRET, bench.payload + 3, 4));
  CHECK(send_in_frame(command, sizeof command) == LINK_TYPE_XCP_PACKETS &&
        bench.payload[1] == 0xFF);
}

/* Starts a list of eight signals, and runs `count` ticks. */
static void sample(int ticks)
{
  CHECK(SEND_IN_FRAME(0xD6) && SEND_IN_FRAME(0xD5, 0, 1, 0) && SEND_IN_FRAME(0xD4, 0, 0, 0, 1));
  CHECK(SEND_IN_FRAME(0xD3, 0, 0, 0, 0, 8) && SEND_IN_FRAME(0xE2, 0, 0, 0, 0, 0));
  for (uint8_t i = 0; i < 8U; i++) {
    CHECK(SEND_IN_FRAME(0xE1, 0xFF, 4, 0, (uint8_t)(4U * i), 0, 1, 0));
  }
  CHECK(SEND_IN_FRAME(0xDE, 1, 0, 0) == LINK_TYPE_XCP_PACKETS && bench.payload[1] == 0xFF);
  bench_ticks(ticks);
}

static void command_without_an_answer_returns_nothing(void)
{
  bench_start();
  CHECK(SEND_IN_FRAME(0xFD) == LINK_TYPE_XCP_PACKETS &&
        bench.answer.length == 0); /* not connected */
}

static void samples_arrive_complete_and_none_is_lost(void)
{
  const int ticks = 40;
  connect_master();
  sample(ticks);
  const uint32_t first = bench.sample.tick - (uint32_t)ticks + 1U;
  uint32_t found = 0;
  CHECK(SEND_IN_FRAME(0xFD) == LINK_TYPE_XCP_PACKETS &&
        bench.payload[0] == 6); /* the answer comes first */
  uint16_t at = 7;
  for (int asked = 0; asked < ticks; asked++) {
    while (at < bench.answer.length) {
      CHECK(bench.payload[at] == 38 && bench.payload[at + 1] == 0);
      CHECK(link_get_u32(bench.payload + at + 3) == first + found);
      at = (uint16_t)(at + SAMPLE);
      found++;
    }
    CHECK(at == bench.answer.length);
    CHECK(send_in_frame(NULL, 0) == LINK_TYPE_XCP_PACKETS);
    CHECK(bench.answer.length <= 6U * SAMPLE);
    at = 0;
  }
  CHECK(found == (uint32_t)ticks && bench.answer.length == 0);
}

/* The answer was lost on the line. A repetition gives the same bytes, and no sample is lost. */
static void repeated_request_is_answered_with_the_same_bytes(void)
{
  uint8_t before[LINK_MAX_PAYLOAD];
  connect_master();
  sample(3);
  CHECK(send_in_frame(NULL, 0) == LINK_TYPE_XCP_PACKETS && bench.answer.length == 3U * SAMPLE);
  memcpy(before, bench.payload, bench.answer.length);
  const uint8_t number = bench.answer.sequence;
  memset(bench.payload, 0, sizeof bench.payload);
  (void)bench_put_frame(LINK_TYPE_XCP, number, NULL, 0);
  bench_poll();
  CHECK(bench.answer.length == 3U * SAMPLE &&
        memcmp(before, bench.payload, bench.answer.length) == 0);
}

static void measuring_through_the_link_is_no_heartbeat(void)
{
  connect_master();
  bench.firmware.control.silent_ticks = 7;
  CHECK(SEND_IN_FRAME(0xFD) && send_in_frame(NULL, 0) && bench.firmware.control.silent_ticks == 7);
  show_key();
  CHECK(bench.firmware.control.silent_ticks == 7); /* the key itself is not a heartbeat */
  CHECK(send_in_frame(NULL, 0) && bench.firmware.control.silent_ticks == 7);
  CHECK(SEND_IN_FRAME(0xFD) && bench.firmware.control.silent_ticks == 0);
}

static void a_command_longer_than_a_packet_is_refused(void)
{
  uint8_t command[LINK_MAX_PAYLOAD] = {0xFD};
  connect_master();
  CHECK(send_in_frame(command, LINK_MAX_PAYLOAD) == LINK_TYPE_XCP_PACKETS);
  CHECK(bench.payload[0] == 2 && bench.payload[1] == 0xFE && bench.payload[2] == XCP_ERR_SYNTAX);
}

int main(void)
{
  command_without_an_answer_returns_nothing();
  samples_arrive_complete_and_none_is_lost();
  repeated_request_is_answered_with_the_same_bytes();
  measuring_through_the_link_is_no_heartbeat();
  a_command_longer_than_a_packet_is_refused();
  return verdict();
}
