/* SPDX-License-Identifier: Apache-2.0 */
/* Random parameter blocks of a map with a play, in fixed and in floating point. */
#ifndef TEST_PLAYS_H
#define TEST_PLAYS_H

#include <string.h>

#include "anhyst/compensator/play_map.h"
#include "anhyst/compensator/play_map_real.h"

#include "maps.h"

enum { FIRST = ANHYST_BLOCK_LEAST_WORDS, MOST_ENTRIES = MOST_COLUMNS * MOST_ROWS };

/* One block in three formats, with the same numbers. The full scale is 1 in floating point. */
typedef struct {
  uint16_t count; /* of words */
  anhyst_map_q31 map;
  anhyst_map_q31 half;
  double radius; /* radius for a full scale of 1.0 */
  int16_t fixed[FIRST + 2 * MOST_ENTRIES];
  float single[FIRST + 2 * MOST_ENTRIES];
  double real[FIRST + 2 * MOST_ENTRIES];
} any_play;

/* CRC-32 by polynomial division, byte by byte. */
static inline uint32_t compute_crc(uint32_t crc, uint64_t bits, int bytes)
{
  for (int i = 0; i < 8 * bytes; i++) {
    const uint32_t low = (uint32_t)(bits >> i) & 1U;
    crc = ((crc ^ low) & 1U) != 0U ? (crc >> 1) ^ 0xEDB88320U : crc >> 1;
  }
  return crc;
}

static inline int is_counted(int i) { return i != ANHYST_WORD_CRC && i != ANHYST_WORD_CRC + 1; }

/* Sets the checksums of the blocks of all formats. */
static inline void set_checksums(any_play *play)
{
  uint32_t fixed = 0xFFFFFFFFU;
  uint32_t single = 0xFFFFFFFFU;
  uint32_t real = 0xFFFFFFFFU;
  for (int i = 0; i < play->count; i++) {
    uint32_t bits;
    uint64_t wide;
    memcpy(&bits, &play->single[i], sizeof bits);
    memcpy(&wide, &play->real[i], sizeof wide);
    if (is_counted(i)) {
      fixed = compute_crc(fixed, (uint16_t)play->fixed[i], 2);
      single = compute_crc(single, bits, 4);
      real = compute_crc(real, wide, 8);
    }
  }
  for (int i = 0; i < 2; i++) {
    play->fixed[ANHYST_WORD_CRC + i] = (int16_t)(uint16_t)(~fixed >> (16 * i));
    play->single[ANHYST_WORD_CRC + i] = (float)(uint16_t)(~single >> (16 * i));
    play->real[ANHYST_WORD_CRC + i] = (double)(uint16_t)(~real >> (16 * i));
  }
}

/* Sets a word of all formats to an integer. */
static inline void set_word(any_play *play, int word, int32_t value)
{
  play->fixed[word] = (int16_t)(uint16_t)(uint32_t)value;
  play->real[word] = value;
  play->single[word] = (float)value;
}

/* Sets half-widths that a map allows: they change by at most its rise, and are in the range of the
   format. */
static inline void fill_half_widths(const any_play *play, int16_t *halves)
{
  const int16_t *entries = play->map.entries;
  const int columns = (1 << play->map.force_segments) + 1;
  for (int i = 0; i < columns * ((1 << play->map.gap_segments) + 1); i++) {
    const int32_t room = 32767 - (entries[i] < 0 ? -entries[i] : entries[i]);
    const int32_t rise = i % columns == 0 ? 0 : (int32_t)entries[i] - entries[i - 1];
    int32_t half = i % columns == 0 ? any_within(0, room) : halves[i - 1] + any_within(-rise, rise);
    half = half > room ? room : half;
    halves[i] = (int16_t)(half < 0 ? 0 : half);
  }
}

static inline void set_head(any_play *play, uint16_t n, uint16_t m, int entries)
{
  set_word(play, ANHYST_WORD_MAGIC, ANHYST_BLOCK_MAGIC_LOW);
  set_word(play, ANHYST_WORD_MAGIC + 1, ANHYST_BLOCK_MAGIC_HIGH);
  set_word(play, ANHYST_WORD_LAYOUT, ANHYST_BLOCK_LAYOUT);
  set_word(play, ANHYST_WORD_KIND, ANHYST_KIND_PLAY);
  set_word(play, ANHYST_WORD_LENGTH, play->count);
  set_word(play, ANHYST_WORD_PLAY_FORCE_SEGMENTS, n);
  set_word(play, ANHYST_WORD_PLAY_GAP_SEGMENTS, m);
  set_word(play, ANHYST_WORD_PLAY_CURRENT, FIRST);
  set_word(play, ANHYST_WORD_PLAY_HALF, FIRST + entries);
  play->real[ANHYST_WORD_SCALE_DEMAND] = 1.0;
  play->real[ANHYST_WORD_SCALE_CURRENT] = 1.0;
  play->real[ANHYST_WORD_SCALE_GAP_HIGH] = 1.0;
}

/* Makes a block with neighbours along the force that differ by up to a step, without effective
   current limits. */
static inline void make_play(any_play *play, uint16_t n, uint16_t m, int32_t step)
{
  const int entries = ((1 << n) + 1) * ((1 << m) + 1);
  memset(play, 0, sizeof *play);
  play->count = (uint16_t)(FIRST + 2 * entries);
  play->map = any_map(play->fixed + FIRST, n, m, step);
  play->half = play->map;
  play->half.entries += entries;
  fill_half_widths(play, play->fixed + FIRST + entries);
  set_head(play, n, m, entries);
  const int mantissa = any_within(16384, 32767);
  const int shift = any_within(0, 9);
  play->fixed[ANHYST_WORD_PLAY_STEEPNESS] = (int16_t)mantissa;
  play->fixed[ANHYST_WORD_PLAY_SHIFT] = (int16_t)shift;
  play->radius = ldexp(16384.0 / mantissa, -shift);
  play->real[ANHYST_WORD_PLAY_STEEPNESS] = 0.25 / play->radius;
  play->fixed[ANHYST_WORD_PLAY_CURRENT_LOW] = -32767 - 1;
  play->fixed[ANHYST_WORD_PLAY_CURRENT_HIGH] = 32767;
  play->real[ANHYST_WORD_PLAY_CURRENT_LOW] = -1.0;
  play->real[ANHYST_WORD_PLAY_CURRENT_HIGH] = 1.0;
  for (int i = FIRST; i < play->count; i++) {
    play->real[i] = play->fixed[i] / 32768.0;
  }
  for (int i = 0; i < play->count; i++) {
    play->single[i] = (float)play->real[i];
  }
  set_checksums(play);
}

#endif
