/* SPDX-License-Identifier: Apache-2.0 */
/* Claims about parameter blocks and recordings, which are transferred completely or not at all. */
#include "../core/check.h"
#include "bench.h"
#include "link/crc.h"

#include <string.h>

#define RECORD_MASK (1U << LINK_SIGNAL_DRIVE | 1U << LINK_SIGNAL_STATE)

#define BLOCK_BYTES (2 * BENCH_WORDS)

static uint8_t bytes[BLOCK_BYTES + 2]; /* one word more than the block has */
static uint32_t checksum;

/* A block with this generation, as the PC sends it. */
static void make_block(uint16_t generation)
{
  int16_t words[BENCH_WORDS];
  fake_block(words, BENCH_WORDS, generation);
  for (size_t i = 0; i < BENCH_WORDS; i++) {
    link_put_u16(bytes + 2 * i, (uint16_t)words[i]);
  }
  checksum = link_crc32(0, bytes, BLOCK_BYTES);
}

static uint8_t begin_block(uint16_t words, uint16_t generation, uint32_t check)
{
  uint8_t payload[LINK_SIZE_BLOCK_BEGIN];
  link_put_u16(payload, words);
  link_put_u16(payload + 2, generation);
  link_put_u32(payload + 4, check);
  return bench_request(LINK_TYPE_BLOCK_BEGIN, payload, sizeof payload);
}

static uint8_t data(uint16_t offset, size_t count)
{
  uint8_t payload[LINK_MAX_PAYLOAD];
  link_put_u16(payload, offset);
  memcpy(payload + 2, bytes + 2 * (size_t)offset, 2 * count);
  return bench_request(LINK_TYPE_BLOCK_DATA, payload, (uint8_t)(2 + 2 * count));
}

static uint8_t request_swap(uint16_t generation)
{
  uint8_t payload[LINK_SIZE_BLOCK_SWAP];
  link_put_u16(payload, generation);
  return bench_request(LINK_TYPE_BLOCK_SWAP, payload, sizeof payload);
}

static uint16_t active_generation(void)
{
  (void)bench_request(LINK_TYPE_HEARTBEAT, NULL, 0);
  return link_get_u16(bench.payload + 24);
}

/* Changes a word of the next block. */
static void change_word(uint16_t word, int16_t value)
{
  link_put_u16(bytes + 2 * (size_t)word, (uint16_t)value);
  checksum = link_crc32(0, bytes, BLOCK_BYTES);
}

static uint8_t send_changed_block(uint16_t generation)
{
  (void)begin_block(BENCH_WORDS, generation, checksum);
  (void)data(0, 40);
  (void)data(40, BENCH_WORDS - 40);
  return request_swap(generation);
}

static uint8_t send_complete_block(uint16_t generation)
{
  make_block(generation);
  return send_changed_block(generation);
}

static void valid_block_is_active_from_the_next_tick_with_the_memory(void)
{
  bench_start();
  bench_run();
  (void)bench_demand(4000);
  bench_ticks(1);
  const int32_t memory = bench.firmware.control.body->compensator.memory.number[0];
  CHECK(active_generation() == 1);
  CHECK(send_complete_block(2) == LINK_TYPE_ACK && bench_detail() == 2);
  CHECK(active_generation() == 2);
  CHECK(bench.firmware.control.body->compensator.memory.number[0] == memory && memory != 0);
  CHECK(app_body_states(bench.firmware.control.body)->state == ANHYST_STATE_RUN);
}

static void download_never_overwrites_the_active_block(void)
{
  bench_start();
  for (uint16_t generation = 2; generation < 9; generation++) {
    const int16_t *before = bench.firmware.control.body->compensator.words;
    int16_t copy[BENCH_WORDS];
    memcpy(copy, before, sizeof copy);
    make_block(generation);
    (void)begin_block(BENCH_WORDS, generation, checksum);
    (void)data(0, BENCH_WORDS);
    CHECK(memcmp(copy, before, sizeof copy) == 0);
    CHECK(request_swap(generation) == LINK_TYPE_ACK);
    CHECK(bench.firmware.control.body->compensator.words != before);
    CHECK(active_generation() == generation);
  }
}

static void old_block_stays_active_after_any_error(void)
{
  bench_start();
  make_block(2);
  CHECK(request_swap(2) == LINK_TYPE_NAK && bench_reason() == LINK_REASON_ORDER);
  CHECK(data(0, 8) == LINK_TYPE_NAK && bench_reason() == LINK_REASON_ORDER);
  CHECK(begin_block(ANHYST_BLOCK_LEAST_WORDS - 1, 2, checksum) == LINK_TYPE_NAK);
  CHECK(bench_reason() == LINK_REASON_VALUE);
  CHECK(begin_block(ANHYST_BLOCK_MOST_WORDS + 1, 2, checksum) == LINK_TYPE_NAK);

  CHECK(begin_block(BENCH_WORDS, 2, checksum) == LINK_TYPE_ACK);
  CHECK(data(0, 40) == LINK_TYPE_ACK && bench_detail() == 40);
  CHECK(data(41, 10) == LINK_TYPE_NAK && bench_reason() == LINK_REASON_ORDER);
  CHECK(bench_detail() == 40);
  CHECK(request_swap(2) == LINK_TYPE_NAK && bench_reason() == LINK_REASON_ORDER);
  CHECK(data(40, BENCH_WORDS - 40) == LINK_TYPE_ACK);
  CHECK(data(BENCH_WORDS, 1) == LINK_TYPE_NAK);
  CHECK(request_swap(3) == LINK_TYPE_NAK && bench_reason() == LINK_REASON_GENERATION);

  (void)begin_block(BENCH_WORDS, 2, checksum ^ 1U);
  (void)data(0, BENCH_WORDS);
  CHECK(request_swap(2) == LINK_TYPE_NAK && bench_reason() == LINK_REASON_CHECKSUM);

  bytes[0] ^= 1U; /* no magic */
  (void)begin_block(BENCH_WORDS, 2, link_crc32(0, bytes, BLOCK_BYTES));
  (void)data(0, BENCH_WORDS);
  CHECK(request_swap(2) == LINK_TYPE_NAK && bench_reason() == LINK_REASON_BLOCK);
  CHECK(active_generation() == 1);
  CHECK(bench.firmware.control.body->compensator.words == bench_words);
}

static void block_for_other_scales_is_refused_with_the_word(void)
{
  bench_start();
  bench_run();
  for (uint16_t word = 0; word < ANHYST_SCALE_WORDS; word++) {
    make_block(2);
    change_word((uint16_t)(ANHYST_WORD_SCALE_DEMAND + word), 1);
    CHECK(send_changed_block(2) == LINK_TYPE_NAK && bench_reason() == LINK_REASON_SCALE);
    CHECK(bench_detail() == ANHYST_WORD_SCALE_DEMAND);
  }
  CHECK(active_generation() == 1);
}

static void built_in_block_for_other_scales_is_a_fault(void)
{
  bench_start();
  bench_words[ANHYST_WORD_SCALE_CURRENT] = 1;
  bench_restart();
  bench_ticks(12);
  CHECK(app_body_states(bench.firmware.control.body)->fault == ANHYST_FAULT_BLOCK &&
        bench.drive == 0);
}

/* The board's block gives half of full scale at this demand. Another block gives a quarter less, or
   more than the board allows. */
static void after_a_swap_the_current_moves_along_the_ramp(int16_t more)
{
  bench_start();
  bench_run();
  const int32_t step = bench.firmware.control.body->ramp_step;
  (void)bench_demand(INT32_MAX / 4 * 3);
  bench_ticks(1);
  int32_t before = bench.drive;
  CHECK(before == INT32_MAX / 4 * 3 / 2);
  make_block(2);
  change_word(FAKE_EXTRA_CURRENT, more);
  CHECK(send_changed_block(2) == LINK_TYPE_ACK);
  int32_t wanted = before + (int32_t)more * 65536;
  wanted = wanted > bench_limits.current_high ? bench_limits.current_high : wanted;
  for (int i = 0; i < 6; i++) {
    bench_ticks(1);
    const int32_t moved = bench.drive - before;
    CHECK(moved <= step && moved >= -step && fake.committed == bench.drive);
    CHECK(moved != 0 || bench.drive == wanted);
    before = bench.drive;
  }
  CHECK(bench.drive == wanted);
}

static void current_is_fast_again_after_the_ramp(void)
{
  after_a_swap_the_current_moves_along_the_ramp(-8192);
  (void)bench_demand(0);
  bench_ticks(1);
  CHECK(bench.drive == -8192 * 65536);
}

/* After a swap in the state RUN, the current moves to that of the new block along the ramp, and the
   hysteresis state is transferred. */
static void compensation_is_switched_along_the_ramp(void)
{
  bench_start();
  CHECK(bench_set(LINK_SETTING_RATIO, PORT_ONE / 4 * 3) == LINK_TYPE_SETTING);
  bench_run();
  (void)bench_demand(PORT_ONE);
  bench_ticks(1);
  const int32_t before = bench.drive;
  const int32_t ramp = bench.firmware.control.body->ramp_step;
  int32_t last = before;
  CHECK(bench_set(LINK_SETTING_COMPENSATION, 0) == LINK_TYPE_SETTING);
  bench_ticks(1);
  CHECK(bench.drive == before + ramp && fake.committed == bench.drive);
  while (bench.drive != last) {
    last = bench.drive;
    bench_tick();
    CHECK(bench.drive - last <= ramp && fake.committed == bench.drive);
  }
  CHECK(last > before + 2 * ramp && last <= PORT_ONE / 4 * 3);
  CHECK(bench_set(LINK_SETTING_COMPENSATION, 1) == LINK_TYPE_SETTING);
  bench_ticks(1);
  CHECK(bench.drive == last - ramp);
  bench_ticks(BENCH_RATE / 20);
  CHECK(bench.drive == before);
}

static void swap_restarts_the_conditioning(void)
{
  bench_start();
  bench_ticks(12);
  (void)bench_command(ANHYST_COMMAND_CONDITION);
  bench_ticks(5);
  CHECK(send_complete_block(2) == LINK_TYPE_ACK);
  bench_ticks(FAKE_CYCLES * FAKE_CYCLE_TICKS);
  CHECK(bench_state() == ANHYST_STATE_IDLE);
  bench_ticks(1);
  CHECK(bench_state() == ANHYST_STATE_READY);
}

static void repeated_swap_is_performed_once(void)
{
  bench_start();
  CHECK(send_complete_block(2) == LINK_TYPE_ACK);
  CHECK(request_swap(2) == LINK_TYPE_NAK && bench_reason() == LINK_REASON_ORDER);
}

static void half_a_word_is_refused(void)
{
  uint8_t payload[5] = {0};
  bench_start();
  make_block(2);
  (void)begin_block(BENCH_WORDS, 2, checksum);
  CHECK(bench_request(LINK_TYPE_BLOCK_DATA, payload, 5) == LINK_TYPE_NAK);
  CHECK(bench_reason() == LINK_REASON_LENGTH);
  CHECK(bench_request(LINK_TYPE_BLOCK_DATA, payload, 2) == LINK_TYPE_NAK);
}

static void valid_block_replaces_an_invalid_built_in_block(void)
{
  bench_start();
  bench_words[ANHYST_WORD_MAGIC] = 0;
  bench_restart();
  (void)bench_hello(255, LINK_VERSION, BENCH_SESSION);
  bench_ticks(5);
  CHECK(app_body_states(bench.firmware.control.body)->fault == ANHYST_FAULT_BLOCK &&
        active_generation() == 0);
  CHECK(send_complete_block(3) == LINK_TYPE_ACK && active_generation() == 3);
  CHECK(bench_command(ANHYST_COMMAND_CLEAR) == LINK_TYPE_ACK);
  bench_ticks(12);
  CHECK(app_body_states(bench.firmware.control.body)->state == ANHYST_STATE_IDLE);
}

static uint8_t read_block(uint16_t offset, uint16_t count)
{
  uint8_t payload[LINK_SIZE_BLOCK_READ];
  link_put_u16(payload, offset);
  link_put_u16(payload + 2, count);
  return bench_request(LINK_TYPE_BLOCK_READ, payload, sizeof payload);
}

static void active_block_can_be_read_but_nothing_beyond_it(void)
{
  bench_start();
  make_block(1);
  CHECK(read_block(10, 54) == LINK_TYPE_BLOCK_WORDS && bench.answer.length == 2 + 2 * 54);
  CHECK(link_get_u16(bench.payload) == 10);
  CHECK(memcmp(bench.payload + 2, bytes + 20, 108) == 0);
  CHECK(read_block(10, 55) == LINK_TYPE_NAK && bench_reason() == LINK_REASON_VALUE);
  CHECK(read_block(BENCH_WORDS, 1) == LINK_TYPE_NAK);
  CHECK(read_block(0, 0) == LINK_TYPE_NAK);
  CHECK(read_block(0, 119) == LINK_TYPE_NAK);
  CHECK(read_block(UINT16_MAX, UINT16_MAX) == LINK_TYPE_NAK);
}

int main(void)
{
  valid_block_is_active_from_the_next_tick_with_the_memory();
  download_never_overwrites_the_active_block();
  old_block_stays_active_after_any_error();
  block_for_other_scales_is_refused_with_the_word();
  built_in_block_for_other_scales_is_a_fault();
  after_a_swap_the_current_moves_along_the_ramp(4096);
  after_a_swap_the_current_moves_along_the_ramp(20000);
  current_is_fast_again_after_the_ramp();
  compensation_is_switched_along_the_ramp();
  swap_restarts_the_conditioning();
  repeated_swap_is_performed_once();
  half_a_word_is_refused();
  valid_block_replaces_an_invalid_built_in_block();
  active_block_can_be_read_but_nothing_beyond_it();
  return verdict();
}
