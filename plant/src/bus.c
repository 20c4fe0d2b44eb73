/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst_plant/bus.h"

#include <math.h>
#include <stddef.h>

#define MAGNETS (ANHYST_BUS_DRIVE_STATE - ANHYST_BUS_DRIVE_DRIVE)
#define Q30 1073741824.0
#define Q31 2147483648.0

/* Returns the nearest code (halves upwards), saturated; for NaN, the error code of the sensor. */
static uint32_t to_code(double value, double one)
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

static int32_t to_int32(uint32_t word)
{
  return word < UINT32_C(0x80000000) ? (int32_t)word
                                     : (int32_t)((int64_t)word - INT64_C(0x100000000));
}

static double to_fraction(uint32_t word) { return (double)to_int32(word) / Q31; }

void anhyst_bus_controller_tick(void *self, const anhyst_loop_sample *sample,
                                anhyst_loop_answer *answer)
{
  anhyst_bus_controller *bus = self;
  const anhyst_position_scales *scales = &bus->scales;
  uint32_t words[ANHYST_BUS_SAMPLE_WORDS] = {0};
  int i;
  bus->tick++;
  answer->gone = bus->firmware_tick == NULL;
  if (answer->gone) {
    return;
  }
  words[ANHYST_BUS_SAMPLE_TICK] = bus->tick;
  words[ANHYST_BUS_SAMPLE_POSITION] =
      to_code((scales->gap_middle - sample->head[0]) / scales->position, Q31);
  for (i = 0; i < MAGNETS && i < sample->magnets; i++) {
    words[ANHYST_BUS_SAMPLE_CURRENT + i] = to_code(sample->current[i] / scales->current, Q30);
  }
  bus->firmware_tick(bus->firmware, words, bus->drive);
  answer->gone = bus->drive[ANHYST_BUS_DRIVE_TICK] != bus->tick;
  if (answer->gone) {
    return;
  }
  for (i = 0; i < MAGNETS && i < sample->magnets; i++) {
    answer->current[i] = to_fraction(bus->drive[ANHYST_BUS_DRIVE_DRIVE + i]) * scales->current;
  }
  answer->reference[0] =
      scales->gap_middle - to_fraction(bus->drive[ANHYST_BUS_DRIVE_REFERENCE]) * scales->position;
  answer->demand[0] = to_fraction(bus->drive[ANHYST_BUS_DRIVE_DEMAND]) * scales->demand;
  answer->state = (uint16_t)(16U * (bus->drive[ANHYST_BUS_DRIVE_STATE] & 0xFFU) +
                             (bus->drive[ANHYST_BUS_DRIVE_MODE] >> 16));
  answer->flags = (uint16_t)(bus->drive[ANHYST_BUS_DRIVE_MODE] & 0xFFFFU);
}
