/* SPDX-License-Identifier: Apache-2.0 */
#include "bench.h"

#include <string.h>

bench_board bench;
int16_t bench_words[BENCH_WORDS];
app_limits bench_limits;

static const app_limits start_limits = {
    .gap = {-PORT_ONE / 8, PORT_ONE / 8 * 9, PORT_ONE / 100, 20},
    .force = {-PORT_ONE / 4, PORT_ONE / 4 * 5, PORT_ONE / 10, 30},
    .current = {-PORT_ONE, PORT_ONE, PORT_ONE / 5, 40},
    .current_low = INT32_MIN / 2,
    .current_high = INT32_MAX / 2,
    .stuck_current = INT32_MAX / 20,
    .max_implausible_samples = 2,
    .missed_ticks = 3,
    .selftest_ticks = 10,
    .ramp_ms = 20,
    .heartbeat_ms = 500,
};

static int16_t scales[ANHYST_SCALE_WORDS];
static app_body body;

static app_board board = {
    .name = "bench",
    .kernel = &fake_kernel,
    .words = bench_words,
    .words_capacity = BENCH_WORDS,
    .scales = scales,
    .firmware = 0x0102,
    .rate = BENCH_RATE,
    .limits = &bench_limits,
};

static uint8_t sequence;

static void read_sample(void *context, port_sample *sample)
{
  *sample = ((const bench_board *)context)->sample;
}

static void drive(void *context, const int32_t *currents, uint32_t state)
{
  bench_board *b = context;
  b->drive = currents[0];
  b->drive_state = state;
}

static uint16_t link_read(void *context, uint8_t *bytes, uint16_t most)
{
  bench_board *b = context;
  uint16_t count = 0;
  while (count < most && b->wire_index < b->wire_count) {
    bytes[count++] = b->wire[b->wire_index++];
  }
  return count;
}

static uint16_t link_write(void *context, const uint8_t *bytes, uint16_t count)
{
  bench_board *b = context;
  const uint16_t taken = count < b->max_accepted_bytes ? count : b->max_accepted_bytes;
  for (uint16_t i = 0; i < taken; i++) {
    if (link_receive(&b->receiver, bytes[i], &b->answer)) {
      memcpy(b->payload, b->answer.payload, b->answer.length);
      b->answers++;
    }
  }
  return taken;
}

static void lock(void *context)
{
  bench_board *b = context;
  b->locks++;
  b->locked_calls++;
}

static void unlock(void *context) { ((bench_board *)context)->locks--; }

static int keep(void *context, const int16_t *block, uint16_t words)
{
  bench_board *b = context;
  b->kept = block;
  b->kept_words = words;
  return !b->refuses_to_keep;
}

static const struct port port = {.context = &bench,
                                 .sense = read_sample,
                                 .drive = drive,
                                 .link_read = link_read,
                                 .link_write = link_write,
                                 .lock = lock,
                                 .unlock = unlock,
                                 .keep = keep};

void bench_restart(void) { app_start(&bench.firmware, &body, &board, &port); }

void bench_power_on(void)
{
  memset(&bench, 0, sizeof bench);
  memset(&fake, 0, sizeof fake);
  bench_limits = start_limits;
  fake_block(bench_words, BENCH_WORDS, 1);
  memcpy(scales, bench_words + ANHYST_WORD_SCALE_DEMAND, sizeof scales);
  bench.max_accepted_bytes = UINT16_MAX;
  bench.sample.gap = PORT_ONE / 2;
  sequence = 0;
  link_receiver_start(&bench.receiver);
  bench_restart();
}

uint8_t bench_hello(uint8_t number, uint16_t version, uint32_t session)
{
  uint8_t payload[LINK_SIZE_HELLO];
  link_put_u16(payload, version);
  link_put_u32(payload + 2, session);
  (void)bench_put_frame(LINK_TYPE_HELLO, number, payload, sizeof payload);
  bench_poll();
  return bench.answer.type;
}

void bench_start(void)
{
  bench_power_on();
  (void)bench_hello(255, LINK_VERSION, BENCH_SESSION);
  bench.answers = 0;
}

void bench_tick(void)
{
  bench.sample.tick++;
  app_tick(&bench.firmware);
}

void bench_ticks(int count)
{
  for (int i = 0; i < count; i++) {
    bench.sample.gap ^= 64;
    bench.sample.force ^= 64;
    bench.sample.current[0] ^= 64;
    bench_tick();
  }
}

uint16_t bench_put_frame(uint8_t type, uint8_t number, const uint8_t *payload, uint8_t length)
{
  uint8_t wire[LINK_MAX_ENCODED_FRAME];
  const link_frame frame = {LINK_VERSION, type, number, length, 0, payload, 0};
  const uint16_t count = link_encode(wire, &frame);
  memcpy(bench.wire + bench.wire_count, wire, count);
  bench.wire_count = (uint16_t)(bench.wire_count + count);
  return count;
}

void bench_poll(void)
{
  do {
    app_poll(&bench.firmware);
  } while (bench.wire_index < bench.wire_count || bench.firmware.session.unsent_count > 0U ||
           bench.firmware.session.chunk_index < bench.firmware.session.chunk_count);
  bench.wire_index = 0;
  bench.wire_count = 0;
}

uint8_t bench_request(uint8_t type, const uint8_t *payload, uint8_t length)
{
  const int before = bench.answers;
  (void)bench_put_frame(type, ++sequence, payload, length);
  bench_poll();
  return bench.answers == before + 1 ? bench.answer.type : 0;
}

uint8_t bench_command(uint16_t command)
{
  uint8_t payload[LINK_SIZE_COMMAND];
  link_put_u16(payload, command);
  return bench_request(LINK_TYPE_COMMAND, payload, sizeof payload);
}

uint8_t bench_demand(int32_t force)
{
  uint8_t payload[LINK_SIZE_DEMAND];
  link_put_u32(payload, (uint32_t)force);
  return bench_request(LINK_TYPE_DEMAND, payload, sizeof payload);
}

uint8_t bench_set(uint16_t setting, int32_t value)
{
  uint8_t payload[LINK_SIZE_SETTING_WRITE];
  link_put_u16(payload, setting);
  link_put_u32(payload + 2, (uint32_t)value);
  return bench_request(LINK_TYPE_SETTING_WRITE, payload, sizeof payload);
}

uint16_t bench_reason(void)
{
  return bench.answer.type == LINK_TYPE_NAK ? link_get_u16(bench.payload + 2) : LINK_REASON_NONE;
}

uint16_t bench_detail(void)
{
  return link_get_u16(bench.payload + (bench.answer.type == LINK_TYPE_NAK ? 4 : 2));
}

uint16_t bench_state(void)
{
  (void)bench_request(LINK_TYPE_HEARTBEAT, NULL, 0);
  return bench.payload[0];
}

void bench_run(void)
{
  bench_ticks(12);
  (void)bench_command(ANHYST_COMMAND_ARM);
  (void)bench_command(ANHYST_COMMAND_RUN);
}
