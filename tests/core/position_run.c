/* SPDX-License-Identifier: Apache-2.0 */
/* The fixed-point position controller as one function of flat arrays, for test_position_faults.py:
   a run of n ticks, from power on. */
#include "anhyst/control/position.h"

enum { NUMBERS_OF_A_SAMPLE = 9, NUMBERS_OF_AN_ANSWER = 6 };

int position_run(const int32_t *numbers, const int16_t *entries, int32_t magnets, int32_t n,
                 const int32_t *samples, int32_t *answers);

static anhyst_factor factor_at(const int32_t *words)
{
  const anhyst_factor factor = {(int16_t)words[0], (int16_t)words[1]};
  return factor;
}

static anhyst_position_limits_q31 read_limits(const int32_t *w)
{
  const anhyst_position_limits_q31 limits = {
      {w[0], w[1], w[2], (uint16_t)w[3], (uint16_t)w[4], (uint16_t)w[5]}, w[6], w[7], w[8], w[9]};
  return limits;
}

static anhyst_position_settings_q31 read_settings(const int32_t *w)
{
  const int32_t *g = w + 15;
  const anhyst_position_settings_q31 settings = {
      {w[0], w[1], w[2], w[3], w[4], w[5], w[6]},
      {factor_at(g), factor_at(g + 2), factor_at(g + 4), factor_at(g + 6), factor_at(g + 8),
       factor_at(g + 10), factor_at(g + 12), factor_at(g + 14), (int16_t)g[16], 0, g[17], g[18]},
      {{{w[9], factor_at(w + 10)}, {w[12], factor_at(w + 13)}}},
      w[7],
      (uint16_t)w[8]};
  return settings;
}

static anhyst_position_sample_q31 read_sample(const int32_t *w)
{
  const anhyst_position_sample_q31 sample = {
      w[1], w[2], w[3], {w[4], w[5]}, {w[6], w[7]}, (uint16_t)w[0], (uint16_t)w[8]};
  return sample;
}

int position_run(const int32_t *numbers, const int16_t *entries, int32_t magnets, int32_t n,
                 const int32_t *samples, int32_t *answers)
{
  const anhyst_position_limits_q31 limits = read_limits(numbers);
  const anhyst_position_settings_q31 settings = read_settings(numbers + 10);
  const anhyst_map_q31 map = {entries, 8, 5};
  anhyst_force_controller_q31 magnet[ANHYST_POSITION_MAGNETS];
  anhyst_position_q31 controller;
  (void)anhyst_force_controller_init_map_q31(&magnet[0], &map, 0, ANHYST_Q31_MAX);
  (void)anhyst_force_controller_init_map_q31(&magnet[1], &map, 0, ANHYST_Q31_MAX);
  if (anhyst_position_init_q31(&controller, &limits, &settings, &magnet[0],
                               magnets == 2 ? &magnet[1] : 0) != ANHYST_OK) {
    return 1;
  }
  for (int32_t i = 0; i < n; i++) {
    const anhyst_position_sample_q31 sample = read_sample(samples + i * NUMBERS_OF_A_SAMPLE);
    anhyst_position_answer_q31 answer;
    int32_t *row = answers + i * NUMBERS_OF_AN_ANSWER;
    anhyst_position_tick_q31(&controller, &sample, &answer);
    row[0] = answer.current[0];
    row[1] = answer.current[1];
    row[2] = answer.reference;
    row[3] = answer.demand;
    row[4] = answer.state;
    row[5] = answer.flags;
  }
  return 0;
}
