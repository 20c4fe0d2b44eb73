/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst_plant/sensor.h"

#include <math.h>

#include "anhyst/numeric/elementary.h"

#define DELAY_INDEX_MASK (ANHYST_PLANT_MAX_DELAY - 1U)

static uint64_t rotate(uint64_t x, unsigned by) { return (x << by) | (x >> (64U - by)); }

/* Fills the state of the generator by splitmix64, which accepts any seed, including 0. */
void anhyst_plant_noise_start(anhyst_plant_noise *noise, uint64_t seed)
{
  int i;
  for (i = 0; i < 4; i++) {
    uint64_t z;
    seed += UINT64_C(0x9E3779B97F4A7C15);
    z = seed;
    z = (z ^ (z >> 30U)) * UINT64_C(0xBF58476D1CE4E5B9);
    z = (z ^ (z >> 27U)) * UINT64_C(0x94D049BB133111EB);
    noise->word[i] = z ^ (z >> 31U);
  }
  noise->has_spare = 0;
  noise->spare = 0.0;
}

static uint64_t next_random_word(anhyst_plant_noise *noise)
{
  uint64_t *w = noise->word;
  const uint64_t found = rotate(w[0] + w[3], 23U) + w[0];
  const uint64_t t = w[1] << 17U;
  w[2] ^= w[0];
  w[3] ^= w[1];
  w[1] ^= w[2];
  w[0] ^= w[3];
  w[2] ^= t;
  w[3] = rotate(w[3], 45U);
  return found;
}

static double draw_uniform(anhyst_plant_noise *noise) /* uniformly distributed in -1..1 */
{
  return (double)(int64_t)next_random_word(noise) * 0x1p-63;
}

static double draw_normal(anhyst_plant_noise *noise)
{
  double x;
  double y;
  double square;
  if (noise->has_spare) {
    noise->has_spare = 0;
    return noise->spare;
  }
  do {
    x = draw_uniform(noise);
    y = draw_uniform(noise);
    square = x * x + y * y;
  } while (square >= 1.0 || square <= 0.0);
  square = sqrt(-2.0 * anhyst_log_f64(square) / square);
  noise->spare = y * square;
  noise->has_spare = 1;
  return x * square;
}

double anhyst_plant_convert(double value, double low, double high, double step)
{
  const double limited = anhyst_plant_limit_to_range(value, low, high);
  return step > 0.0 ? low + floor((limited - low) / step + 0.5) * step : limited;
}

void anhyst_plant_sensor_start(anhyst_plant_sensing *sensing, double value)
{
  unsigned i;
  sensing->value = value;
  sensing->at = 0;
  for (i = 0; i < ANHYST_PLANT_MAX_DELAY; i++) {
    sensing->line[i] = value;
  }
}

static double output(const anhyst_plant_sensor *sensor, const anhyst_plant_sensing *sensing,
                     double noise)
{
  const double value = sensing->line[(sensing->at - (unsigned)sensor->delay) & DELAY_INDEX_MASK];
  return anhyst_plant_convert(sensor->gain * value + sensor->offset + noise, sensor->low,
                              sensor->high, sensor->step);
}

double anhyst_plant_sensor_take(const anhyst_plant_sensor *sensor, anhyst_plant_sensing *sensing,
                                int is_first, double value, double noise)
{
  if (is_first) {
    anhyst_plant_sensor_start(sensing, value);
  } else {
    anhyst_plant_sensor_follow(sensor, sensing, value, value);
  }
  return output(sensor, sensing, noise);
}

double anhyst_plant_sensor_read(const anhyst_plant_sensor *sensor,
                                const anhyst_plant_sensing *sensing, anhyst_plant_noise *noise)
{
  return output(sensor, sensing, sensor->noise > 0.0 ? sensor->noise * draw_normal(noise) : 0.0);
}
