/* SPDX-License-Identifier: Apache-2.0 */
#include "app/download.h"

#include <stddef.h>

#include "link/crc.h"

void app_download_start(app_download *download)
{
  const link_block_begin none = {0, 0, 0};
  download->announced = none;
  download->checksum = 0;
  download->received_words = 0;
  download->pending_index = 0;
  download->state = APP_DOWNLOAD_NONE;
  download->has_checksum = 0;
}

/* Returns the buffer that does not contain the active block. */
static uint16_t find_pending_buffer(const app_download *download, const int16_t *in_force)
{
  return in_force == download->words[0] ? 1U : 0U;
}

uint16_t app_download_begin(app_download *download, const link_block_begin *begin,
                            const int16_t *in_force)
{
  if (begin->words < ANHYST_BLOCK_LEAST_WORDS || begin->words > ANHYST_BLOCK_MOST_WORDS) {
    return LINK_REASON_VALUE;
  }
  download->announced = *begin;
  download->checksum = 0;
  download->received_words = 0;
  download->pending_index = find_pending_buffer(download, in_force);
  download->state = APP_DOWNLOAD_RECEIVING;
  return LINK_REASON_NONE;
}

uint16_t app_download_words(app_download *download, uint16_t offset, const uint8_t *bytes,
                            uint16_t count)
{
  if (download->state != APP_DOWNLOAD_RECEIVING || offset != download->received_words ||
      count > download->announced.words - download->received_words) {
    return LINK_REASON_ORDER;
  }
  int16_t *to = download->words[download->pending_index] + offset;
  const uint8_t *from = bytes;
  for (uint16_t i = 0; i < count; i++, from += 2) {
    to[i] = link_get_i16(from);
  }
  download->checksum = link_crc32(download->checksum, bytes, (uint16_t)(2U * count));
  download->received_words = (uint16_t)(download->received_words + count);
  return LINK_REASON_NONE;
}

uint16_t app_download_edit(app_download *download, const int16_t *in_force, uint16_t at,
                           const uint8_t *bytes, uint16_t count)
{
  if (download->state == APP_DOWNLOAD_RECEIVING) {
    return LINK_REASON_ORDER;
  }
  if (download->state == APP_DOWNLOAD_NONE) {
    const uint16_t length = in_force != NULL ? (uint16_t)in_force[ANHYST_WORD_LENGTH] : 0U;
    download->pending_index = find_pending_buffer(download, in_force);
    for (uint16_t i = 0; i < (uint16_t)ANHYST_BLOCK_MOST_WORDS; i++) {
      download->words[download->pending_index][i] = i < length ? in_force[i] : 0;
    }
    download->has_checksum = 0;
    download->state = APP_DOWNLOAD_EDITED;
  }
  if (at > (uint16_t)ANHYST_BLOCK_MOST_WORDS ||
      count > (uint16_t)((uint16_t)ANHYST_BLOCK_MOST_WORDS - at)) {
    return LINK_REASON_VALUE;
  }
  int16_t *to = download->words[download->pending_index] + at;
  const uint8_t *from = bytes;
  for (uint16_t i = 0; i < count; i++, from += 2) {
    to[i] = link_get_i16(from);
  }
  if (at < (uint16_t)(ANHYST_WORD_CRC + 2) && at + count > (uint16_t)ANHYST_WORD_CRC) {
    download->has_checksum = 1;
  }
  return LINK_REASON_NONE;
}

/* Returns the CRC-32 of words, low byte first, continued from `crc`. */
static uint32_t add_words_to_crc(uint32_t crc, const int16_t *words, uint16_t count)
{
  uint8_t bytes[2];
  uint32_t sum = crc;
  for (uint16_t i = 0; i < count; i++) {
    link_put_u16(bytes, (uint16_t)words[i]);
    sum = link_crc32(sum, bytes, 2);
  }
  return sum;
}

void app_download_finish_edit(app_download *download)
{
  int16_t *words = download->words[download->pending_index];
  const uint16_t after_crc = (uint16_t)(ANHYST_WORD_CRC + 2);
  uint16_t length = (uint16_t)words[ANHYST_WORD_LENGTH];
  if (length < (uint16_t)ANHYST_BLOCK_LEAST_WORDS || length > (uint16_t)ANHYST_BLOCK_MOST_WORDS) {
    length = ANHYST_BLOCK_LEAST_WORDS; /* invalid length; the check will refuse the block */
  }
  if (download->has_checksum == 0U) {
    uint8_t bytes[4];
    const uint32_t head = add_words_to_crc(0, words, ANHYST_WORD_CRC);
    link_put_u32(bytes, add_words_to_crc(head, words + after_crc, (uint16_t)(length - after_crc)));
    words[ANHYST_WORD_CRC] = link_get_i16(bytes);
    words[ANHYST_WORD_CRC + 1] = link_get_i16(bytes + 2);
  }
  download->announced.words = length;
  download->announced.generation = (uint16_t)words[ANHYST_WORD_GENERATION];
  download->announced.checksum = add_words_to_crc(0, words, length);
  download->checksum = download->announced.checksum;
  download->received_words = length;
  download->state = APP_DOWNLOAD_RECEIVING;
}

uint16_t app_download_check(const app_download *download, const app_board *board,
                            uint16_t generation, const int16_t **words, uint16_t *detail)
{
  const int16_t *block = download->words[download->pending_index];
  if (download->state != APP_DOWNLOAD_RECEIVING ||
      download->received_words != download->announced.words) {
    return LINK_REASON_ORDER;
  }
  if (download->checksum != download->announced.checksum) {
    return LINK_REASON_CHECKSUM;
  }
  if (anhyst_block_check(board->kernel, block, download->announced.words) != ANHYST_OK) {
    return LINK_REASON_BLOCK;
  }
  const uint16_t block_generation = (uint16_t)block[ANHYST_WORD_GENERATION];
  if (block_generation != generation || block_generation != download->announced.generation) {
    return LINK_REASON_GENERATION;
  }
  const uint16_t misfit = anhyst_block_misfit(block, board->scales);
  if (misfit != 0U) {
    *detail = misfit;
    return LINK_REASON_SCALE;
  }
  *words = block;
  return LINK_REASON_NONE;
}
