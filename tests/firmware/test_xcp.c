/* SPDX-License-Identifier: Apache-2.0 */
/* Claims about the XCP slave, command by command. */
#include "../core/check.h"
#include "bench.h"

#include <string.h>

#include "link/crc.h"
#include "xcp/xcp.h"

#define SIGNALS ((uint32_t)XCP_AREA_SIGNAL << 16)
#define BLOCK ((uint32_t)XCP_AREA_BLOCK << 16)

static xcp_slave slave;
static uint8_t answer[XCP_PACKET];
static uint16_t answered;

/* Sends a command. Returns 0 if it was performed, otherwise the error. */
static uint8_t send(const uint8_t *command, uint16_t length)
{
  memset(answer, 0xEE, sizeof answer);
  answered = xcp_answer(&slave, command, length, answer);
  CHECK(answered <= XCP_PACKET && bench.locks == 0);
  return answered > 0U && answer[0] == 0xFFU ? 0U : answer[1];
}

#define SEND(...)                                                                                  \
  send((const uint8_t[]){__VA_ARGS__}, (uint16_t)sizeof((const uint8_t[]){__VA_ARGS__}))

static void connect_master(void)
{
  bench_start();
  xcp_start(&slave, &bench.firmware);
  CHECK(SEND(0xFF, 0) == 0 && answered == 8);
}

static uint8_t show_key(uint32_t secret)
{
  uint8_t command[6] = {0xF7, 4};
  CHECK(SEND(0xF8, 0, 1) == 0 && answered == 6 && answer[1] == 4);
  link_put_u32(command + 2, link_crc32(secret, answer + 2, 4));
  return send(command, sizeof command);
}

static void unlock(void)
{
  connect_master();
  CHECK(show_key(XCP_SECRET) == 0);
}

static uint8_t write_at(uint32_t address, const uint8_t *bytes, uint8_t count)
{
  uint8_t command[XCP_PACKET] = {0xF6, 0, 0, 0};
  link_put_u32(command + 4, address);
  CHECK(send(command, 8) == 0);
  command[0] = 0xF0;
  command[1] = count;
  memcpy(command + 2, bytes, count);
  return send(command, (uint16_t)(count + 2));
}

static uint8_t write_value(uint32_t area, uint16_t number, int32_t value)
{
  uint8_t bytes[4];
  link_put_u32(bytes, (uint32_t)value);
  return write_at((area << 16) + 4U * number, bytes, 4);
}

static uint8_t read_at(uint32_t address, uint8_t count)
{
  uint8_t command[8] = {0xF4, count, 0, 0};
  link_put_u32(command + 4, address);
  return send(command, sizeof command);
}

/* Allocates one list with one part of `entries` signals. */
static void sample(uint8_t entries)
{
  CHECK(SEND(0xD6) == 0 && SEND(0xD5, 0, 1, 0) == 0 && SEND(0xD4, 0, 0, 0, 1) == 0);
  CHECK(SEND(0xD3, 0, 0, 0, 0, entries) == 0 && SEND(0xE2, 0, 0, 0, 0, 0) == 0);
  for (uint8_t i = 0; i < entries; i++) {
    CHECK(SEND(0xE1, 0xFF, 4, 0, (uint8_t)(4 * (i % LINK_SIGNAL_COUNT)), 0, 1, 0) == 0);
  }
  CHECK(SEND(0xDE, 1, 0, 0) == 0);
}

static void tick(void)
{
  bench_ticks(1);
  xcp_tick(&slave);
}

static void nothing_is_answered_before_connect(void)
{
  bench_start();
  xcp_start(&slave, &bench.firmware);
  (void)SEND(0xFD);
  CHECK(answered == 0);
  (void)send(NULL, 0);
  CHECK(answered == 0);
}

static void too_short_command_is_refused(void)
{
  uint8_t command[XCP_PACKET + 1] = {0};
  connect_master();
  for (uint16_t code = 0; code < 0xFEU; code++) {
    command[0] = (uint8_t)code;
    (void)send(command, 1);
    CHECK(answered >= 1);
  }
  CHECK(SEND(0xF6, 0, 0, 0) == XCP_ERR_SYNTAX && SEND(0xC0) == XCP_ERR_UNKNOWN_COMMAND);
  command[0] = 0xFD;
  CHECK(send(command, sizeof command) == XCP_ERR_SYNTAX);
  CHECK(SEND(0xFC) == 0 && answered == 2 && answer[0] == 0xFEU); /* synch */
}

static void memory_ends_where_its_tables_end(void)
{
  unlock();
  CHECK(read_at(SIGNALS, 4 * LINK_SIGNAL_COUNT) == 0 &&
        read_at(SIGNALS + 1, 4 * LINK_SIGNAL_COUNT) == XCP_ERR_RANGE);
  CHECK(read_at(SIGNALS + 4 * LINK_SIGNAL_COUNT, 1) == XCP_ERR_RANGE);
  CHECK(read_at(BLOCK + 2 * BENCH_WORDS - 2, 2) == 0 &&
        read_at(BLOCK + 2 * BENCH_WORDS - 2, 3) == XCP_ERR_RANGE);
  CHECK(read_at((uint32_t)XCP_AREA_NAME << 16, 5) == 0 && memcmp(answer + 1, "bench", 5) == 0);
  CHECK(read_at((uint32_t)XCP_AREA_NAME << 16, 6) == XCP_ERR_RANGE);
  CHECK(read_at(0, 1) == XCP_ERR_DENIED && read_at(0xFFFFFFFFU, 1) == XCP_ERR_DENIED);
  CHECK(read_at(0x1FFFFU, 2) == XCP_ERR_RANGE && read_at(SIGNALS, 0) == XCP_ERR_RANGE);
  CHECK(read_at(SIGNALS, XCP_PACKET) == XCP_ERR_RANGE);
  CHECK(write_value(XCP_AREA_SIGNAL, 0, 1) == XCP_ERR_WRITE_PROTECTED);
  CHECK(write_value(XCP_AREA_SETTING, LINK_SETTING_COUNT, 1) == XCP_ERR_RANGE);
  CHECK(write_value(XCP_AREA_INPUT, XCP_INPUT_SET_TARGET, 1) == XCP_ERR_DENIED); /* signal: force */
  CHECK(write_at((uint32_t)XCP_AREA_SETTING << 16, (const uint8_t[]){1, 0}, 2) == XCP_ERR_RANGE);
}

static void value_can_be_read_from_any_byte(void)
{
  uint8_t whole[8];
  connect_master();
  tick();
  CHECK(read_at(SIGNALS + 4 * LINK_SIGNAL_GAP, 8) == 0);
  memcpy(whole, answer + 1, 8);
  CHECK(link_get_i32(whole) == bench.sample.gap);
  for (uint8_t first = 0; first < 8U; first++) {
    CHECK(read_at(SIGNALS + 4 * LINK_SIGNAL_GAP + first, (uint8_t)(8U - first)) == 0);
    CHECK(memcmp(answer + 1, whole + first, 8U - first) == 0);
  }
}

static void key_is_valid_once_and_for_its_connection(void)
{
  uint8_t command[6] = {0xF7, 4};
  connect_master();
  CHECK(SEND(0xF7, 4, 0, 0, 0, 0) == XCP_ERR_SEQUENCE);
  CHECK(show_key(XCP_SECRET + 1U) == XCP_ERR_LOCKED);
  (void)SEND(0xFD);
  CHECK(answered == 0); /* the wrong key ended the connection */
  unlock();
  memcpy(command + 2, answer + 2, 4);
  CHECK(write_value(XCP_AREA_SETTING, LINK_SETTING_DEMAND_SLEW, 5) == 0);
  xcp_disconnect(&slave);
  CHECK(SEND(0xFF, 0) == 0);
  CHECK(write_value(XCP_AREA_SETTING, LINK_SETTING_DEMAND_SLEW, 6) == XCP_ERR_LOCKED);
  CHECK(send(command, sizeof command) == XCP_ERR_SEQUENCE);
  CHECK(bench.firmware.settings[LINK_SETTING_DEMAND_SLEW] == 5);
}

static void refusal_has_a_reason(void)
{
  unlock();
  CHECK(write_value(XCP_AREA_INPUT, XCP_INPUT_COMMAND, ANHYST_COMMAND_RUN) == XCP_ERR_DENIED);
  CHECK(answered == 4 && link_get_u16(answer + 2) == LINK_REASON_STATE);
  CHECK(write_value(XCP_AREA_INPUT, XCP_INPUT_COMMAND, -1) == XCP_ERR_RANGE);
  CHECK(write_value(XCP_AREA_INPUT, XCP_INPUT_COMMAND, 0x10001) == XCP_ERR_RANGE);
}

static void allocation_keeps_its_order_and_limits(void)
{
  connect_master();
  CHECK(SEND(0xD4, 0, 0, 0, 1) == XCP_ERR_SEQUENCE &&
        SEND(0xD3, 0, 0, 0, 0, 1) == XCP_ERR_SEQUENCE);
  CHECK(SEND(0xD5, 0, XCP_LISTS + 1, 0) == XCP_ERR_NO_MEMORY &&
        SEND(0xD5, 0, 1, 1) == XCP_ERR_NO_MEMORY);
  CHECK(SEND(0xD5, 0, 2, 0) == 0 && SEND(0xD5, 0, 1, 0) == XCP_ERR_SEQUENCE);
  CHECK(SEND(0xD4, 0, 2, 0, 1) == XCP_ERR_RANGE &&
        SEND(0xD4, 0, 0, 0, XCP_ODTS + 1) == XCP_ERR_NO_MEMORY);
  CHECK(SEND(0xD4, 0, 0, 0, 2) == 0 && SEND(0xD4, 0, 0, 0, 1) == XCP_ERR_SEQUENCE);
  CHECK(SEND(0xD3, 0, 0, 0, 0, XCP_ENTRIES + 1) == XCP_ERR_NO_MEMORY);
  CHECK(SEND(0xD3, 0, 0, 0, 0, 1) == 0 && SEND(0xD3, 0, 0, 0, 2, 1) == XCP_ERR_RANGE);
  CHECK(SEND(0xD4, 0, 1, 0, 1) == XCP_ERR_SEQUENCE); /* parts are allocated before entries */
}

static void list_starts_only_with_complete_entries(void)
{
  connect_master();
  CHECK(SEND(0xD5, 0, 1, 0) == 0 && SEND(0xD4, 0, 0, 0, 1) == 0 && SEND(0xD3, 0, 0, 0, 0, 1) == 0);
  CHECK(SEND(0xE2, 0, 0, 0, 0, 1) == XCP_ERR_RANGE && SEND(0xE2, 0, 0, 0, 0, 0) == 0);
  CHECK(SEND(0xDE, 1, 0, 0) == XCP_ERR_DAQ_CONFIG); /* one entry was never written */
  CHECK(SEND(0xE1, 0xFF, 2, 0, 0, 0, 1, 0) == XCP_ERR_RANGE);
  CHECK(SEND(0xE1, 0xFF, 4, 0, 0, 0, 2, 0) == XCP_ERR_RANGE); /* a setting is not a signal */
  CHECK(SEND(0xE1, 0xFF, 4, 0, 0, 0, 1, 0) == 0);
  CHECK(SEND(0xE1, 0xFF, 4, 0, 0, 0, 1, 0) == XCP_ERR_DAQ_CONFIG); /* no entry is free */
  CHECK(SEND(0xE0, 0x10, 0, 0, 0, 0, 0, 0) == XCP_ERR_RANGE &&
        SEND(0xE0, 0x02, 0, 0, 0, 0, 1, 0) == XCP_ERR_MODE);
  CHECK(SEND(0xDE, 1, 0, 0) == 0 && SEND(0xE2, 0, 0, 0, 0, 0) == XCP_ERR_DAQ_ACTIVE);
  CHECK(SEND(0xD6) == 0 && SEND(0xFD) == 0 && (answer[1] & 0x40U) == 0U);
}

static void sample_belongs_to_one_tick(void)
{
  uint8_t packet[XCP_PACKET];
  connect_master();
  sample(LINK_SIGNAL_COUNT);
  tick();
  CHECK(xcp_take(&slave, packet, XCP_PACKET) == 6 + 4 * LINK_SIGNAL_COUNT && packet[0] == 0 &&
        packet[1] == 0);
  CHECK(link_get_u32(packet + 2) == bench.sample.tick);
  const uint8_t *value = packet + 6;
  for (int i = 0; i < (int)LINK_SIGNAL_COUNT; i++, value += 4) {
    CHECK(link_get_i32(value) == bench.firmware.signals[i]);
  }
  CHECK(bench.firmware.signals[LINK_SIGNAL_GAP] == bench.sample.gap);
  CHECK(xcp_take(&slave, packet, XCP_PACKET) == 0);
}

static void full_queue_drops_complete_samples_and_reports_it(void)
{
  uint8_t packet[XCP_PACKET];
  const int fit = (XCP_QUEUE - 1) / (7 + 4 * 8);
  connect_master();
  sample(8);
  for (int round = 0; round < 3; round++) {
    for (int i = 0; i < fit + 5; i++) {
      tick();
    }
    CHECK(xcp_take(&slave, packet, XCP_PACKET) == 2 && packet[0] == 0xFDU && packet[1] == 6);
    const uint32_t first = bench.sample.tick - (uint32_t)fit - 4U;
    for (int i = 0; i < fit; i++) {
      CHECK(xcp_take(&slave, packet, XCP_PACKET) == 6 + 4 * 8);
      CHECK(link_get_u32(packet + 2) == first + (uint32_t)i);
    }
    CHECK(xcp_take(&slave, packet, XCP_PACKET) == 0);
  }
}

static void short_download_writes_a_value(void)
{
  const uint8_t setting = (uint8_t)XCP_AREA_SETTING;
  const uint8_t at = 4U * (uint8_t)LINK_SETTING_DEMAND_SLEW;
  connect_master();
  CHECK(SEND(0xED, 4, 0, 0, at, 0, setting, 0, 0x39, 0x30, 0, 0) == XCP_ERR_LOCKED);
  unlock();
  CHECK(SEND(0xED, 4, 0, 0, at, 0, setting, 0, 0x39, 0x30, 0, 0) == 0);
  CHECK(bench.firmware.settings[LINK_SETTING_DEMAND_SLEW] == 12345);
  CHECK(SEND(0xED, 4, 0, 0, at, 0, setting, 0, 0, 0, 0) == XCP_ERR_SYNTAX);
  CHECK(SEND(0xED, 4, 0, 1, at, 0, setting, 0, 1, 0, 0, 0) == XCP_ERR_RANGE);
  CHECK(bench.firmware.settings[LINK_SETTING_DEMAND_SLEW] == 12345);
}

static void measuring_master_is_no_heartbeat(void)
{
  connect_master();
  bench.firmware.control.silent_ticks = 7;
  CHECK(SEND(0xFD) == 0 && bench.firmware.control.silent_ticks == 7);
  CHECK(show_key(XCP_SECRET) == 0 && SEND(0xFD) == 0 && bench.firmware.control.silent_ticks == 0);
}

static void link_and_master_do_not_mix_their_blocks(void)
{
  uint8_t payload[LINK_SIZE_BLOCK_BEGIN] = {BENCH_WORDS, 0};
  const uint8_t word[2] = {7, 0};
  unlock();
  CHECK(SEND(0xEB, 2, 0, 1) == 0);
  CHECK(bench_request(LINK_TYPE_BLOCK_BEGIN, payload, sizeof payload) == LINK_TYPE_ACK);
  CHECK(write_at(BLOCK + 2 * ANHYST_WORD_GENERATION, word, 2) == XCP_ERR_DENIED);
  CHECK(SEND(0xEB, 1, 0, 1) == XCP_ERR_PAGE && link_get_u16(answer + 2) == LINK_REASON_ORDER);
}

static void edited_word_is_active_after_page_change(void)
{
  const uint8_t word[2] = {7, 0};
  const uint32_t place = BLOCK + 2 * ANHYST_WORD_GENERATION;
  unlock();
  CHECK(write_at(place, word, 2) == XCP_ERR_WRITE_PROTECTED); /* page 0 */
  CHECK(SEND(0xEB, 2, 0, 1) == 0 && write_at(place, word, 2) == 0);
  CHECK(read_at(place, 2) == 0 && answer[1] == 7);
  CHECK(bench.firmware.control.body->compensator.words[ANHYST_WORD_GENERATION] == 1);
  CHECK(write_at(BLOCK + 2 * ANHYST_BLOCK_MOST_WORDS, word, 2) == XCP_ERR_RANGE);
  CHECK(SEND(0xEA, 1, 0) == 0 && answer[3] == 0);
  CHECK(SEND(0xEB, 1, 0, 1) == 0);
  CHECK(bench.firmware.control.body->compensator.words[ANHYST_WORD_GENERATION] == 7);
  CHECK(SEND(0xEA, 1, 0) == 0 && answer[3] == 1);
}

int main(void)
{
  nothing_is_answered_before_connect();
  too_short_command_is_refused();
  memory_ends_where_its_tables_end();
  value_can_be_read_from_any_byte();
  key_is_valid_once_and_for_its_connection();
  refusal_has_a_reason();
  allocation_keeps_its_order_and_limits();
  list_starts_only_with_complete_entries();
  sample_belongs_to_one_tick();
  full_queue_drops_complete_samples_and_reports_it();
  short_download_writes_a_value();
  measuring_master_is_no_heartbeat();
  link_and_master_do_not_mix_their_blocks();
  edited_word_is_active_after_page_change();
  return verdict();
}
