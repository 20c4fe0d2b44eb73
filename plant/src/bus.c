/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst_plant/bus.h"

#include <math.h>

/* Currents of a record stand one after the other. */
#define MAGNETS (ANHYST_BUS_DRIVE_STATE - ANHYST_BUS_DRIVE_DRIVE)
#define Q30 1073741824.0
#define Q31 2147483648.0

/* What the nearest code would be, halves up; beyond the codes the nearest end; the sensor's error
   code where there is no number. */
static uint32_t code(double value, double one)
{
  const double place = value * one + 0.5;
  if (isnan(place)) {
    return UINT32_C(0x80000000);
  }
  if (place >= Q31) {
    return UINT32_C(0x7FFFFFFF);
  }
  return (uint32_t)(place <= 1.0 - Q31 ? INT32_C(-2147483647) : (int32_t)floor(place));
}

static int32_t number(uint32_t word)
{
  return word < UINT32_C(0x80000000) ? (int32_t)word
                                     : (int32_t)((int64_t)word - INT64_C(0x100000000));
}

static double fraction(uint32_t word) { return (double)number(word) / Q31; }

static void put_words(const uint32_t *words, int count, uint8_t *bytes)
{
  for (int i = 0; i < count; i++, bytes += 4) {
    for (int j = 0; j < 4; j++) {
      bytes[j] = (uint8_t)(words[i] >> (8 * j));
    }
  }
}

static void get_words(const uint8_t *bytes, int count, uint32_t *words)
{
  for (int i = 0; i < count; i++, bytes += 4) {
    words[i] = (uint32_t)bytes[0] | (uint32_t)bytes[1] << 8 | (uint32_t)bytes[2] << 16 |
               (uint32_t)bytes[3] << 24;
  }
}

/* The check of a record: what makes the exclusive or of all its words the magic number. */
static uint32_t check(const uint32_t *words, int count)
{
  uint32_t found = ANHYST_BUS_MAGIC;
  for (int i = 0; i < count - 1; i++) {
    found ^= words[i];
  }
  return found;
}

static int exchange(anhyst_bus_controller *bus, uint32_t *sample)
{
  uint8_t out[ANHYST_BUS_SAMPLE_BYTES];
  uint8_t in[ANHYST_BUS_DRIVE_BYTES];
  sample[ANHYST_BUS_SAMPLE_CHECK] = check(sample, ANHYST_BUS_SAMPLE_WORDS);
  put_words(sample, ANHYST_BUS_SAMPLE_WORDS, out);
  if (!bus->exchange(bus->line, out, in)) {
    return 0;
  }
  get_words(in, ANHYST_BUS_DRIVE_WORDS, bus->drive);
  return bus->drive[ANHYST_BUS_DRIVE_TICK] == bus->tick &&
         bus->drive[ANHYST_BUS_DRIVE_CHECK] == check(bus->drive, ANHYST_BUS_DRIVE_WORDS);
}

void anhyst_bus_controller_tick(void *self, const anhyst_loop_sample *sample,
                                anhyst_loop_answer *answer)
{
  anhyst_bus_controller *bus = self;
  const anhyst_position_scales *scales = &bus->scales;
  uint32_t words[ANHYST_BUS_SAMPLE_WORDS] = {0};
  int i;
  bus->tick++;
  words[ANHYST_BUS_SAMPLE_TICK] = bus->tick;
  words[ANHYST_BUS_SAMPLE_POSITION] =
      code((scales->gap_middle - sample->head[0]) / scales->position, Q31);
  for (i = 0; i < MAGNETS && i < sample->magnets; i++) {
    words[ANHYST_BUS_SAMPLE_CURRENT + i] = code(sample->current[i] / scales->current, Q30);
  }
  answer->gone = !exchange(bus, words);
  if (answer->gone) {
    return;
  }
  for (i = 0; i < MAGNETS && i < sample->magnets; i++) {
    answer->current[i] = fraction(bus->drive[ANHYST_BUS_DRIVE_DRIVE + i]) * scales->current;
  }
  answer->reference[0] =
      scales->gap_middle - fraction(bus->drive[ANHYST_BUS_DRIVE_REFERENCE]) * scales->position;
  answer->demand[0] = fraction(bus->drive[ANHYST_BUS_DRIVE_DEMAND]) * scales->demand;
  answer->state = (uint16_t)(16U * (bus->drive[ANHYST_BUS_DRIVE_STATE] & 0xFFU) +
                             (bus->drive[ANHYST_BUS_DRIVE_MODE] >> 16));
  answer->flags = (uint16_t)(bus->drive[ANHYST_BUS_DRIVE_MODE] & 0xFFFFU);
}
