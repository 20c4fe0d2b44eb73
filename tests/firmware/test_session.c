/* SPDX-License-Identifier: Apache-2.0 */
/* Claims about the session: every request is answered and performed once, in order. */
#include "../core/check.h"
#include "bench.h"

#include <string.h>

static const app_session *session(void) { return &bench.firmware.session; }

static void repeat_request(uint8_t type, uint8_t sequence, const uint8_t *payload, uint8_t length)
{
  (void)bench_put_frame(type, sequence, payload, length);
  bench_poll();
}

static void put_demand(uint8_t sequence, int32_t force)
{
  uint8_t payload[LINK_SIZE_DEMAND];
  link_put_u32(payload, (uint32_t)force);
  (void)bench_put_frame(LINK_TYPE_DEMAND, sequence, payload, sizeof payload);
}

static void hello_identifies_the_controller(void)
{
  bench_power_on();
  CHECK(bench_hello(9, LINK_VERSION, 5) == LINK_TYPE_INFO && bench.answer.sequence == 9);
  CHECK(bench.answer.length == LINK_SIZE_INFO && bench.answer.version == LINK_VERSION);
  CHECK(link_get_u16(bench.payload) == LINK_VERSION);
  CHECK(link_get_u16(bench.payload + 2) == 0x0102);
  CHECK(link_get_u16(bench.payload + 4) == ANHYST_KIND_SIMPLIFIED);
  CHECK(link_get_u16(bench.payload + 8) == 1); /* generation */
  CHECK(link_get_u32(bench.payload + 14) == 0x56781234U);
  CHECK(link_get_u32(bench.payload + 18) == BENCH_RATE);
}

static void other_protocol_version_is_refused(void)
{
  uint8_t wire[LINK_MAX_ENCODED_FRAME];
  uint8_t payload[LINK_SIZE_HELLO];
  const link_frame frame = {LINK_VERSION + 1, LINK_TYPE_HEARTBEAT, 9, 0, 0, payload, 0};
  bench_start();
  bench.wire_count = link_encode(wire, &frame);
  memcpy(bench.wire, wire, bench.wire_count);
  bench_poll();
  CHECK(bench.answers == 1 && bench.answer.sequence == 9);
  CHECK(bench_reason() == LINK_REASON_VERSION && bench_detail() == LINK_VERSION);
  bench_power_on();
  CHECK(bench_hello(9, LINK_VERSION + 1, 5) == LINK_TYPE_NAK);
  CHECK(bench_reason() == LINK_REASON_VERSION && bench_detail() == LINK_VERSION);
  CHECK(session()->is_open == 0);
}

static void unknown_frame_is_refused(void)
{
  const uint8_t payload[8] = {0};
  bench_start();
  CHECK(bench_request(0x7F, payload, 0) == LINK_TYPE_NAK);
  CHECK(bench_reason() == LINK_REASON_TYPE);
  CHECK(bench_request(LINK_TYPE_STATUS, payload, 0) == LINK_TYPE_NAK);
  CHECK(bench_reason() == LINK_REASON_TYPE);
  for (int type = LINK_TYPE_HELLO; type <= LINK_TYPE_BLOCK_READ; type++) {
    CHECK(bench_request((uint8_t)type, payload, 1) == LINK_TYPE_NAK);
    CHECK(bench_reason() == LINK_REASON_LENGTH && bench_detail() == 1);
  }
}

static void repeated_request_is_answered_again_and_performed_once(void)
{
  uint8_t arm[2];
  uint8_t first[LINK_MAX_PAYLOAD];
  link_put_u16(arm, ANHYST_COMMAND_ARM);
  bench_start();
  bench_ticks(12);
  repeat_request(LINK_TYPE_COMMAND, 5, arm, 2);
  CHECK(bench.answers == 1 && bench.answer.type == LINK_TYPE_ACK);
  const uint32_t tick = bench.answer.tick;
  memcpy(first, bench.payload, sizeof first);
  bench_ticks(3);
  for (int again = 2; again < 5; again++) {
    repeat_request(LINK_TYPE_COMMAND, 5, arm, 2);
    /* A second execution would give a NAK, because ready cannot be armed. */
    CHECK(bench.answers == again && bench.answer.type == LINK_TYPE_ACK);
    CHECK(bench.answer.sequence == 5 && bench.answer.tick == tick);
    CHECK(memcmp(bench.payload, first, bench.answer.length) == 0);
  }
}

static void overtaken_request_is_not_performed(void)
{
  bench_start();
  bench_run();
  repeat_request(LINK_TYPE_HEARTBEAT, 100, NULL, 0);
  put_demand(101, 1000);
  put_demand(102, 2000);
  put_demand(101, 1000); /* a delayed copy of the first hello */
  bench_poll();
  CHECK(bench_reason() == LINK_REASON_OLD && bench_detail() == 1);
  CHECK(bench.firmware.control.body->target == 2000);
  put_demand(106, 3000); /* requests 103 to 105 are lost */
  put_demand(104, 4000); /* request 104 arrives late */
  bench_poll();
  CHECK(bench_reason() == LINK_REASON_OLD && bench_detail() == 0);
  CHECK(bench.firmware.control.body->target == 3000);
  CHECK(session()->lost_requests >= 3);
}

static void same_number_with_other_contents_is_no_repetition(void)
{
  bench_start();
  bench_run();
  put_demand(50, 1000);
  put_demand(50, 2000);
  bench_poll();
  CHECK(bench_reason() == LINK_REASON_OLD);
  CHECK(bench.firmware.control.body->target == 1000);
}

static void sequence_numbers_wrap(void)
{
  bench_start();
  for (int i = 0; i < 1000; i++) {
    repeat_request(LINK_TYPE_HEARTBEAT, (uint8_t)i, NULL, 0);
    CHECK(bench.answers == i + 1 && bench.answer.type == LINK_TYPE_STATUS);
    CHECK(bench.answer.sequence == (uint8_t)i);
  }
  CHECK(session()->lost_requests == 0);
}

static void lost_numbers_are_counted_and_reported(void)
{
  bench_start();
  (void)bench_hello(249, LINK_VERSION, BENCH_SESSION + 1);
  repeat_request(LINK_TYPE_HEARTBEAT, 250, NULL, 0);
  repeat_request(LINK_TYPE_HEARTBEAT, 4, NULL, 0);
  CHECK(link_get_u16(bench.payload + 28) == 9);
}

static void bad_frames_are_counted_and_reported(void)
{
  const uint8_t garbage[4] = {3, 7, 7, 0};
  bench_start();
  memcpy(bench.wire, garbage, sizeof garbage);
  bench.wire_count = sizeof garbage;
  bench_poll();
  CHECK(bench.answers == 0);
  repeat_request(LINK_TYPE_HEARTBEAT, 1, NULL, 0);
  CHECK(link_get_u16(bench.payload + 26) == 1);
}

static void a_new_session_starts_the_sequence_again(void)
{
  bench_start();
  repeat_request(LINK_TYPE_HEARTBEAT, 0, NULL, 0);
  CHECK(bench_hello(150, LINK_VERSION, BENCH_SESSION + 1) == LINK_TYPE_INFO);
  repeat_request(LINK_TYPE_HEARTBEAT, 151, NULL, 0);
  CHECK(bench.answer.type == LINK_TYPE_STATUS && session()->lost_requests == 0);
}

/* If a copy of the hello reset the sequence, later requests would look overtaken. */
static void copy_of_the_hello_is_answered_and_changes_nothing(void)
{
  for (int late = 0; late < 300; late++) {
    bench_start();
    for (int i = 0; i < late; i++) {
      repeat_request(LINK_TYPE_HEARTBEAT, (uint8_t)i, NULL, 0);
    }
    CHECK(bench_hello(255, LINK_VERSION, BENCH_SESSION) == LINK_TYPE_INFO);
    CHECK(bench.answer.sequence == 255);
    repeat_request(LINK_TYPE_HEARTBEAT, (uint8_t)late, NULL, 0);
    CHECK(bench.answer.type == LINK_TYPE_STATUS && session()->lost_requests == 0);
  }
}

static void answer_before_a_copied_hello_can_be_repeated(void)
{
  bench_start();
  bench_run();
  put_demand(50, 1000);
  (void)bench_hello(255, LINK_VERSION, BENCH_SESSION);
  put_demand(50, 1000);
  bench_poll();
  CHECK(bench.answer.type == LINK_TYPE_STATUS && bench.answer.sequence == 50);
}

static void nothing_is_performed_without_a_session(void)
{
  uint8_t arm[2];
  link_put_u16(arm, ANHYST_COMMAND_ARM);
  bench_power_on();
  bench_ticks(12);
  repeat_request(LINK_TYPE_COMMAND, 1, arm, 2);
  CHECK(bench.answer.type == LINK_TYPE_NAK && bench_reason() == LINK_REASON_SESSION);
  CHECK(app_body_states(bench.firmware.control.body)->state == ANHYST_STATE_IDLE);
  repeat_request(LINK_TYPE_HELLO, 2, arm, 2);
  CHECK(bench_reason() == LINK_REASON_LENGTH && session()->is_open == 0);
  CHECK(bench_hello(3, LINK_VERSION, 1) == LINK_TYPE_INFO);
  repeat_request(LINK_TYPE_COMMAND, 4, arm, 2);
  CHECK(bench.answer.type == LINK_TYPE_ACK);
}

static void a_slow_line_loses_nothing(void)
{
  bench_start();
  bench.max_accepted_bytes = 1;
  for (uint8_t i = 1; i <= 20; i++) {
    (void)bench_put_frame(LINK_TYPE_HEARTBEAT, i, NULL, 0);
  }
  bench_poll();
  CHECK(bench.answers == 20 && bench.answer.sequence == 20);
}

static void status_contains_tick_and_measured_values(void)
{
  bench_start();
  bench_run();
  (void)bench_demand(-2000);
  bench_ticks(1);
  (void)bench_request(LINK_TYPE_HEARTBEAT, NULL, 0);
  const uint8_t *p = bench.payload;
  CHECK(bench.answer.tick == bench.sample.tick && bench.answer.length == LINK_SIZE_STATUS);
  CHECK(p[0] == ANHYST_STATE_RUN && p[1] == ANHYST_FAULT_NONE);
  CHECK(link_get_u16(p + 2) == (ANHYST_KNOWN | ANHYST_DEMAND_LIMITED));
  CHECK(link_get_i32(p + 4) == -2000);
  CHECK(link_get_i32(p + 8) == bench.sample.force && link_get_i32(p + 12) == bench.sample.gap);
  CHECK(link_get_i32(p + 16) == bench.sample.current[0] && link_get_i32(p + 20) == -1000);
}

static void the_control_task_is_locked_out_in_pairs(void)
{
  bench_start();
  bench_run();
  CHECK(bench.locks == 0 && bench.locked_calls > 0);
}

static void settings_keep_their_ranges(void)
{
  uint8_t payload[2];
  bench_start();
  link_put_u16(payload, LINK_SETTING_HEARTBEAT_TICKS);
  CHECK(bench_request(LINK_TYPE_SETTING_READ, payload, 2) == LINK_TYPE_SETTING);
  CHECK(link_get_i32(bench.payload + 2) == BENCH_RATE / 10);
  CHECK(bench_set(LINK_SETTING_HEARTBEAT_TICKS, 1) == LINK_TYPE_NAK);
  CHECK(bench_reason() == LINK_REASON_VALUE);
  CHECK(bench_set(LINK_SETTING_HEARTBEAT_TICKS, BENCH_RATE / 2) == LINK_TYPE_SETTING);
  CHECK(bench_set(LINK_SETTING_HEARTBEAT_TICKS, BENCH_RATE / 2 + 1) == LINK_TYPE_NAK);
  CHECK(bench_reason() == LINK_REASON_VALUE); /* the board allows half a second */
  CHECK(bench_set(LINK_SETTING_HEARTBEAT_TICKS, 2) == LINK_TYPE_SETTING);
  CHECK(bench.firmware.settings[LINK_SETTING_HEARTBEAT_TICKS] == 2);
  CHECK(bench_set(LINK_SETTING_COUNT, 1) == LINK_TYPE_NAK);
  link_put_u16(payload, LINK_SETTING_COUNT);
  CHECK(bench_request(LINK_TYPE_SETTING_READ, payload, 2) == LINK_TYPE_NAK);
  bench_run();
  CHECK(bench_set(LINK_SETTING_FOLLOW, 1) == LINK_TYPE_NAK);
  CHECK(bench_reason() == LINK_REASON_STATE && bench_detail() == ANHYST_STATE_RUN);
  CHECK(bench_set(LINK_SETTING_DEMAND_SLEW, 5) == LINK_TYPE_SETTING);
}

/* Time may stand still while a board stores a block. Therefore, the current must be zero. */
static void block_is_stored_only_at_rest(void)
{
  bench_start();
  CHECK(bench_request(LINK_TYPE_KEEP, NULL, 0) == LINK_TYPE_NAK);
  CHECK(bench_reason() == LINK_REASON_STATE && bench.kept == NULL);
  bench_ticks(100);
  CHECK(bench_request(LINK_TYPE_KEEP, NULL, 0) == LINK_TYPE_ACK);
  CHECK(bench.kept == bench_words && bench.kept_words == bench_words[ANHYST_WORD_LENGTH]);
  bench.refuses_to_keep = 1;
  CHECK(bench_request(LINK_TYPE_KEEP, NULL, 0) == LINK_TYPE_NAK);
  CHECK(bench_reason() == LINK_REASON_NOT_KEPT);
  bench.kept = NULL;
  CHECK(bench_command(ANHYST_COMMAND_CONDITION) == LINK_TYPE_ACK);
  CHECK(bench_request(LINK_TYPE_KEEP, NULL, 0) == LINK_TYPE_NAK);
  CHECK(bench_reason() == LINK_REASON_STATE);
  CHECK(bench_command(ANHYST_COMMAND_IDLE) == LINK_TYPE_ACK);
  CHECK(bench_command(ANHYST_COMMAND_ARM) == LINK_TYPE_ACK);
  CHECK(bench_command(ANHYST_COMMAND_RUN) == LINK_TYPE_ACK);
  CHECK(bench_request(LINK_TYPE_KEEP, NULL, 0) == LINK_TYPE_NAK);
  CHECK(bench_reason() == LINK_REASON_STATE && bench.kept == NULL);
}

static void status_contains_the_cycles(void)
{
  bench_start();
  bench.firmware.max_tick_cycles = 4711;
  CHECK(bench_request(LINK_TYPE_HEARTBEAT, NULL, 0) == LINK_TYPE_STATUS);
  CHECK(link_get_u32(bench.payload + LINK_SIZE_STATUS - 4) == 4711);
}

int main(void)
{
  block_is_stored_only_at_rest();
  status_contains_the_cycles();
  hello_identifies_the_controller();
  other_protocol_version_is_refused();
  unknown_frame_is_refused();
  repeated_request_is_answered_again_and_performed_once();
  overtaken_request_is_not_performed();
  same_number_with_other_contents_is_no_repetition();
  sequence_numbers_wrap();
  lost_numbers_are_counted_and_reported();
  bad_frames_are_counted_and_reported();
  a_new_session_starts_the_sequence_again();
  copy_of_the_hello_is_answered_and_changes_nothing();
  answer_before_a_copied_hello_can_be_repeated();
  nothing_is_performed_without_a_session();
  a_slow_line_loses_nothing();
  status_contains_tick_and_measured_values();
  the_control_task_is_locked_out_in_pairs();
  settings_keep_their_ranges();
  return verdict();
}
