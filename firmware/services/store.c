/* SPDX-License-Identifier: Apache-2.0 */
#include "services/store.h"

#include "link/crc.h"

#define MAGIC_OFFSET 0U
#define NUMBER_OFFSET 1U
#define COUNT_OFFSET 2U
#define SET_OFFSET 3U
#define NO_COPY 2U

static uint32_t add_word_to_crc(uint32_t crc, uint32_t word)
{
  const uint8_t bytes[4] = {(uint8_t)(word & 0xFFU), (uint8_t)((word >> 8) & 0xFFU),
                            (uint8_t)((word >> 16) & 0xFFU), (uint8_t)((word >> 24) & 0xFFU)};
  return link_crc32(crc, bytes, 4);
}

static int is_valid(const store_flash *flash, uint16_t copy)
{
  const volatile uint32_t *words = flash->copy[copy];
  const uint32_t count = words[COUNT_OFFSET];
  if (words[MAGIC_OFFSET] != STORE_MAGIC || count > flash->words - (uint32_t)STORE_OVERHEAD_WORDS) {
    return 0;
  }
  uint32_t crc = 0;
  for (uint32_t i = 0; i < SET_OFFSET + count; i++) {
    crc = add_word_to_crc(crc, words[i]);
  }
  return words[SET_OFFSET + count] == crc;
}

/* Returns the index of the newer valid copy, or NO_COPY. Set numbers wrap around: the newer number
   is ahead by less than 2^31. */
static uint16_t find_newest_copy(const store_flash *flash)
{
  const int first = is_valid(flash, 0);
  const int second = is_valid(flash, 1);
  if (first && second) {
    const uint32_t ahead = flash->copy[1][NUMBER_OFFSET] - flash->copy[0][NUMBER_OFFSET];
    return ahead < 0x80000000U ? 1U : 0U;
  }
  if (first) {
    return 0U;
  }
  return second ? 1U : (uint16_t)NO_COPY;
}

const volatile uint32_t *store_read(const store_flash *flash, uint32_t *count)
{
  const uint16_t copy = find_newest_copy(flash);
  if (copy == NO_COPY) {
    *count = 0;
    return 0;
  }
  *count = flash->copy[copy][COUNT_OFFSET];
  return &flash->copy[copy][SET_OFFSET];
}

int store_write(const store_flash *flash, const uint32_t *words, uint32_t count)
{
  if (count > flash->words - (uint32_t)STORE_OVERHEAD_WORDS) {
    return 0;
  }
  const uint16_t old_copy = find_newest_copy(flash);
  const uint16_t copy = old_copy == 0U ? 1U : 0U;
  const uint32_t number = old_copy == NO_COPY ? 0U : flash->copy[old_copy][NUMBER_OFFSET] + 1U;
  const uint32_t head[SET_OFFSET] = {STORE_MAGIC, number, count};
  uint32_t crc = 0;
  int is_stored = flash->erase(copy);
  for (uint32_t i = 0; i < SET_OFFSET + count; i++) {
    const uint32_t word = i < SET_OFFSET ? head[i] : words[i - SET_OFFSET];
    crc = add_word_to_crc(crc, word);
    is_stored = is_stored && flash->program(copy, i, word);
  }
  is_stored = is_stored && flash->program(copy, SET_OFFSET + count, crc);
  return is_stored && find_newest_copy(flash) == copy;
}
