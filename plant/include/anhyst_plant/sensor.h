/* SPDX-License-Identifier: Apache-2.0 */
/* Sensors, with these effects in order: bandwidth, delay, gain and offset, noise, converter. */
#ifndef ANHYST_PLANT_SENSOR_H
#define ANHYST_PLANT_SENSOR_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define ANHYST_PLANT_MAX_DELAY 256 /* maximum delay, sub-steps, a power of two */

/* Normally distributed random numbers: xoshiro256++ and the polar method. */
typedef struct {
  uint64_t word[4];
  double spare;
  int has_spare;
} anhyst_plant_noise;

void anhyst_plant_noise_start(anhyst_plant_noise *noise, uint64_t seed);

typedef struct {
  double low; /* ends of the range; values outside are limited to it */
  double high;
  double step;   /* step of the converter, whose grid starts at `low`; 0: no converter */
  double gain;   /* gain; 1 for an ideal sensor */
  double offset; /* offset, in the unit of the quantity */
  double noise;  /* standard deviation of the noise, in the unit of the quantity */
  double share;  /* fraction of a step that its low-pass passes in a sub-step, 0 < .. <= 1 */
  int delay;     /* delay in sub-steps, 0..ANHYST_PLANT_MAX_DELAY - 1 */
} anhyst_plant_sensor;

typedef struct {
  double value;                        /* output of the low-pass filter */
  double line[ANHYST_PLANT_MAX_DELAY]; /* last outputs of the filter, as a ring buffer */
  unsigned at;
} anhyst_plant_sensing;

/* Limits a value; NaN becomes `low`. C's fmin and fmax do not define the sign of zero. */
static inline double anhyst_plant_limit_to_range(double value, double low, double high)
{
  return value > low ? (value < high ? value : high) : low;
}

/* Returns the nearest value on a converter's grid; for step 0, the value limited to the range. */
double anhyst_plant_convert(double value, double low, double high, double step);

/* Initialises a sensor in the steady state of a constant quantity. */
void anhyst_plant_sensor_start(anhyst_plant_sensing *sensing, double value);

/* Follows a quantity over one sub-step, from its value at the start to its value at the end.
   Inline, because every sub-step calls it for every sensor. */
static inline void anhyst_plant_sensor_follow(const anhyst_plant_sensor *sensor,
                                              anhyst_plant_sensing *sensing, double from, double to)
{
  const double share = sensor->share;
  const double before = sensing->value;
  const double value = share >= 1.0 ? to : before + share * (0.5 * (from + to) - before);
  const unsigned at = (sensing->at + 1U) & (ANHYST_PLANT_MAX_DELAY - 1U);
  sensing->value = value;
  sensing->at = at;
  sensing->line[at] = value;
}

/* Returns the present reading. */
double anhyst_plant_sensor_read(const anhyst_plant_sensor *sensor,
                                const anhyst_plant_sensing *sensing, anhyst_plant_noise *noise);

/* Returns the reading of a quantity that was constant for a whole step, and forever before the
   first step. The caller gives the noise in the unit of the quantity. */
double anhyst_plant_sensor_take(const anhyst_plant_sensor *sensor, anhyst_plant_sensing *sensing,
                                int is_first, double value, double noise);

#ifdef __cplusplus
}
#endif
#endif
