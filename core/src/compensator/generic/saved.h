/* SPDX-License-Identifier: Apache-2.0 */
/* Saves and restores the hysteresis state over a power cycle, for every number format. */
#include "../checksum.h"

static uint32_t saved_checksum(const saved_memory *saved)
{
  const size_t first = sizeof(saved->content.checksum) / sizeof(saved->word[0]);
  uint32_t sum = ANHYST_CHECKSUM_START;
  for (size_t i = first; i < sizeof(saved->word) / sizeof(saved->word[0]); i++) {
    sum = anhyst_checksum_add(sum, saved->word[i]);
  }
  return ~sum & 0xFFFFFFFFUL;
}

static uint32_t block_checksum(const compensator *c)
{
  const uint32_t low = (uint32_t)(uint16_t)(int32_t)c->words[ANHYST_WORD_CRC];
  return low | (uint32_t)(uint16_t)(int32_t)c->words[ANHYST_WORD_CRC + 1] << 16;
}

static void save_state(const compensator *c, saved_memory *to)
{
  for (size_t i = 0; i < sizeof(to->word) / sizeof(to->word[0]); i++) {
    to->word[i] = 0; /* including unused words */
  }
  to->content.version = ANHYST_SAVED_VERSION;
  to->content.kind = c->kernel->kind;
  to->content.size = (uint32_t)(sizeof(to->word) / sizeof(to->word[0]));
  to->content.block = block_checksum(c);
  to->content.flux_applied = c->flux_applied;
  to->content.ring_lead = c->ring_lead;
  to->content.applied = c->applied;
  to->content.gap = c->gap;
  for (uint16_t j = 0; j < ANHYST_MEMORIES; j++) {
    saved_layer *layer = &to->content.layer[j];
    const number *plays = c->plays;
    layer->memory = c->memory;
#if ANHYST_MEMORIES > 1
    if (j > 0U) {
      plays = c->deeper[j - 1U].plays;
      layer->memory = c->deeper[j - 1U].memory;
      layer->flux_deficit = c->deeper[j - 1U].flux_deficit;
    }
#endif
    for (uint16_t i = 0; i < ANHYST_CELLS; i++) {
      layer->plays[i] = plays[i];
    }
  }
  to->content.checksum = saved_checksum(to);
}

static anhyst_status restore_state(compensator *c, const saved_memory *from)
{
  if (from->content.version != ANHYST_SAVED_VERSION || from->content.kind != c->kernel->kind ||
      from->content.size != sizeof(from->word) / sizeof(from->word[0]) ||
      from->content.block != block_checksum(c) || from->content.checksum != saved_checksum(from)) {
    return ANHYST_BAD_PARAMETER;
  }
  for (uint16_t j = 0; j < ANHYST_MEMORIES; j++) {
    const saved_layer *layer = &from->content.layer[j];
    number *plays = c->plays;
#if ANHYST_MEMORIES > 1
    if (j > 0U) {
      plays = c->deeper[j - 1U].plays;
      c->deeper[j - 1U].memory = layer->memory;
      c->deeper[j - 1U].flux_deficit = layer->flux_deficit;
    } else
#endif
    {
      c->memory = layer->memory;
    }
    for (uint16_t i = 0; i < ANHYST_CELLS; i++) {
      plays[i] = layer->plays[i];
    }
  }
  c->flux_applied = from->content.flux_applied;
  c->ring_lead = from->content.ring_lead;
  c->applied = from->content.applied;
  c->gap = from->content.gap;
  c->flags = 0;
  c->stage = ANHYST_STAGE_UNKNOWN;
  return ANHYST_OK;
}
