/* SPDX-License-Identifier: Apache-2.0 */
#include "app/download.h"

#include "link/crc.h"

void app_download_start(app_download *download)
{
  const link_block_begin none = {0, 0, 0};
  download->announced = none;
  download->checksum = 0;
  download->received = 0;
  download->place = 0;
  download->under_way = 0;
}

uint16_t app_download_begin(app_download *download, const link_block_begin *begin,
                            const int16_t *in_force)
{
  if (begin->words < ANHYST_BLOCK_LEAST_WORDS || begin->words > ANHYST_BLOCK_MOST_WORDS) {
    return LINK_REASON_VALUE;
  }
  download->announced = *begin;
  download->checksum = 0;
  download->received = 0;
  download->place = in_force == download->words[0] ? 1U : 0U;
  download->under_way = 1;
  return LINK_REASON_NONE;
}

uint16_t app_download_words(app_download *download, uint16_t offset, const uint8_t *bytes,
                            uint16_t count)
{
  if (download->under_way == 0U || offset != download->received ||
      count > download->announced.words - download->received) {
    return LINK_REASON_ORDER;
  }
  int16_t *to = download->words[download->place] + offset;
  const uint8_t *from = bytes;
  for (uint16_t i = 0; i < count; i++, from += 2) {
    to[i] = link_get_i16(from);
  }
  download->checksum = link_crc32(download->checksum, bytes, (uint16_t)(2U * count));
  download->received = (uint16_t)(download->received + count);
  return LINK_REASON_NONE;
}

uint16_t app_download_check(const app_download *download, const app_board *board,
                            uint16_t generation, const int16_t **words, uint16_t *detail)
{
  const int16_t *block = download->words[download->place];
  if (download->under_way == 0U || download->received != download->announced.words) {
    return LINK_REASON_ORDER;
  }
  if (download->checksum != download->announced.checksum) {
    return LINK_REASON_CHECKSUM;
  }
  if (anhyst_block_check(board->kernel, block, download->announced.words) != ANHYST_OK) {
    return LINK_REASON_BLOCK;
  }
  const uint16_t own = (uint16_t)block[ANHYST_WORD_GENERATION];
  if (own != generation || own != download->announced.generation) {
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
