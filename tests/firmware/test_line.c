/* SPDX-License-Identifier: Apache-2.0 */
/* Claims about XCP on a stream of bytes: header and checksum of a packet, and line faults. */
#include "../core/check.h"
#include "bench.h"

#include <string.h>

#include "xcp/line.h"

#define SILENCE (BENCH_RATE * XCP_LINE_SILENCE_MS / 1000U)

static xcp_line line;
static uint8_t sent[XCP_LINE_MAX_BYTES];
static uint16_t sent_count;

static const uint8_t hello[] = {2, 0, 0, 0, 0xFF, 0};
static const uint8_t status[] = {1, 0, 1, 0, 0xFD};
/* With checksums: 2 + 0 + 0x00FF, and after an odd packet 1 + 1 + 0x00FD with a zero byte. */
static const uint8_t checked_hello[] = {2, 0, 0, 0, 0xFF, 0, 0x01, 0x01};
static const uint8_t checked_status[] = {1, 0, 1, 0, 0xFD, 0, 0xFF, 0};

static void start(int checked)
{
  bench_start();
  bench_ticks(1);
  xcp_line_start(&line, &bench.firmware, checked);
}

/* Sends all pending bytes, `most` bytes at a time, and keeps the last packet. */
static void fetch(uint16_t most)
{
  uint16_t count = 0;
  sent_count = 0;
  const uint8_t *bytes = xcp_line_offer(&line, &count);
  while (count > 0U) {
    const uint16_t part = count < most ? count : most;
    memcpy(sent + sent_count, bytes, part);
    sent_count = (uint16_t)(sent_count + part);
    xcp_line_sent(&line, part);
    if (line.out_count == 0U) {
      return; /* the end of a packet */
    }
    bytes = xcp_line_offer(&line, &count);
  }
}

#define RECEIVE_BYTES(bytes) xcp_line_take(&line, bytes, (uint16_t)sizeof(bytes))

static void packet_starts_with_length_and_counter(void)
{
  start(0);
  CHECK(RECEIVE_BYTES(hello) == sizeof hello);
  fetch(3);
  CHECK(sent_count == 12 && link_get_u16(sent) == 8 && link_get_u16(sent + 2) == 0);
  CHECK(sent[4] == 0xFF);
  CHECK(RECEIVE_BYTES(status) == sizeof status);
  fetch(1);
  CHECK(sent_count == 10 && link_get_u16(sent) == 6 && link_get_u16(sent + 2) == 1);
}

static void checksum_is_the_sum_of_all_words(void)
{
  start(1);
  CHECK(RECEIVE_BYTES(checked_hello) == sizeof checked_hello);
  fetch(5);
  CHECK(sent_count == 14);
  uint16_t sum = 0;
  for (uint16_t i = 0; i < 12U; i += 2U) {
    sum = (uint16_t)(sum + link_get_u16(sent + i));
  }
  CHECK(link_get_u16(sent + 12) == sum);
  CHECK(RECEIVE_BYTES(checked_status) == sizeof checked_status);
  fetch(20);
  CHECK(sent_count == 12 && sent[4] == 0xFF);
}

static void odd_answer_is_padded_with_a_zero(void)
{
  /* an upload of two bytes has an answer of three bytes */
  const uint8_t upload[] = {8, 0, 0, 0, 0xF4, 2, 0, 0, 0, 0, 1, 0, 0xFD, 2};
  start(1);
  CHECK(RECEIVE_BYTES(checked_hello) == sizeof checked_hello);
  fetch(20);
  CHECK(RECEIVE_BYTES(upload) == sizeof upload);
  fetch(20);
  CHECK(sent_count == 10 && link_get_u16(sent) == 3 && sent[4] == 0xFF && sent[7] == 0);
}

/* Flips any bit of a command: it is never performed, and the line works afterwards. */
static void damaged_command_is_not_performed(void)
{
  for (unsigned bit = 0; bit < 8U * sizeof checked_hello; bit++) {
    uint8_t damaged[sizeof checked_hello];
    memcpy(damaged, checked_hello, sizeof damaged);
    damaged[bit / 8U] ^= (uint8_t)(1U << (bit % 8U));
    start(1);
    (void)RECEIVE_BYTES(damaged);
    fetch(20);
    CHECK(sent_count == 0 && line.slave.is_connected == 0);
    bench_ticks(SILENCE + 1);
    CHECK(RECEIVE_BYTES(checked_hello) == sizeof checked_hello && line.slave.is_connected == 1);
  }
}

static void incomplete_command_is_discarded_after_a_silence(void)
{
  start(0);
  CHECK(xcp_line_take(&line, hello, 5) == 5);
  bench_ticks(SILENCE);
  CHECK(xcp_line_take(&line, hello + 5, 1) == 1 && line.slave.is_connected == 1);
  start(0);
  CHECK(xcp_line_take(&line, hello, 5) == 5);
  bench_ticks(SILENCE + 1);
  CHECK(RECEIVE_BYTES(hello) == sizeof hello && line.slave.is_connected == 1);
}

static void invalid_length_stops_the_line_until_a_silence(void)
{
  static const uint8_t too_long[] = {XCP_PACKET + 1, 0, 0, 0};
  static const uint8_t nothing[] = {0, 0, 0, 0};
  const uint8_t *const wrong[] = {too_long, nothing};
  for (int i = 0; i < 2; i++) {
    start(0);
    CHECK(xcp_line_take(&line, wrong[i], 4) == 4 && line.ignores_bytes == 1);
    CHECK(RECEIVE_BYTES(hello) == sizeof hello && line.slave.is_connected == 0);
    bench_ticks(SILENCE + 1);
    CHECK(RECEIVE_BYTES(hello) == sizeof hello && line.slave.is_connected == 1 &&
          line.ignores_bytes == 0);
  }
}

static void nothing_is_read_while_an_answer_is_pending(void)
{
  uint8_t both[sizeof hello + sizeof status];
  uint16_t count = 0;
  memcpy(both, hello, sizeof hello);
  memcpy(both + sizeof hello, status, sizeof status);
  start(0);
  CHECK(RECEIVE_BYTES(both) == sizeof hello);
  CHECK(xcp_line_take(&line, status, 1) == 0);
  (void)xcp_line_offer(&line, &count);
  xcp_line_sent(&line, (uint16_t)(count - 1U));
  CHECK(xcp_line_take(&line, status, 1) == 0);
  fetch(20);
  CHECK(RECEIVE_BYTES(status) == sizeof status);
}

static void disconnected_master_gets_no_samples(void)
{
  start(0);
  CHECK(RECEIVE_BYTES(hello) == sizeof hello);
  xcp_line_disconnect(&line);
  fetch(20);
  CHECK(sent_count == 0 && line.slave.is_connected == 0);
}

/* The longest command and the longest sample, with checksums: sanitizers check the array bounds. */
static void the_longest_packets_fit(void)
{
  uint8_t longest[XCP_LINE_HEADER_BYTES + XCP_PACKET + XCP_LINE_CHECKSUM_BYTES] = {XCP_PACKET, 0, 1,
                                                                                   0, 0xF0};
  uint16_t sum = 0;
  for (uint16_t i = 0; i < XCP_LINE_HEADER_BYTES + XCP_PACKET; i += 2U) {
    sum = (uint16_t)(sum + link_get_u16(longest + i));
  }
  link_put_u16(longest + XCP_LINE_HEADER_BYTES + XCP_PACKET, sum);
  start(1);
  CHECK(RECEIVE_BYTES(checked_hello) == sizeof checked_hello);
  fetch(20);
  CHECK(RECEIVE_BYTES(longest) == sizeof longest);
  fetch(20);
  CHECK(sent_count == 8 && sent[4] == 0xFE); /* no key */
}

int main(void)
{
  packet_starts_with_length_and_counter();
  checksum_is_the_sum_of_all_words();
  odd_answer_is_padded_with_a_zero();
  damaged_command_is_not_performed();
  incomplete_command_is_discarded_after_a_silence();
  invalid_length_stops_the_line_until_a_silence();
  nothing_is_read_while_an_answer_is_pending();
  disconnected_master_gets_no_samples();
  the_longest_packets_fit();
  return verdict();
}
