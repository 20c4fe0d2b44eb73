/* SPDX-License-Identifier: Apache-2.0 */
/* Noise of demand and gap at rest, after a rise and after a descent, with and without a converter
   of 12 bits. At the end, the same demand needs the same current as after the first ticks: the
   noise has no more effect, and nothing drifts. The claim is the same for every format. */
#ifndef TEST_REST_H
#define TEST_REST_H

#include "check.h"
#include "plays.h"

enum { RAMP = 64, SETTLED = 20000 };

#define REST(format, number, words)                                                                \
  static double change_at_rest_##format(const any_play *play, int is_descent, int is_rounded,      \
                                        long ticks)                                                \
  {                                                                                                \
    const number one = (number)play->words[ANHYST_WORD_SCALE_DEMAND] > 0 ? (number)1 : (number)0;  \
    const double unit = one > 0 ? 1.0 : 2147483648.0;                                              \
    const number rest = (number)(0.5 * unit);                                                      \
    const double grid = unit / 2048.0;                                                             \
    anhyst_play_map_##format c;                                                                    \
    CHECK(anhyst_play_map_init_##format(&c, play->words, play->count) == ANHYST_OK);               \
    for (int at = 0; at <= RAMP; at++) {                                                           \
      const double way = (double)(is_descent ? 2 * RAMP - at : at) / (2.0 * (double)RAMP) * 0.999; \
      const number current = anhyst_play_map_solve_##format(&c, (number)(way * unit), rest);       \
      anhyst_play_map_commit_##format(&c, current, rest);                                          \
    }                                                                                              \
    double first = 0.0;                                                                            \
    for (long tick = 0; tick < ticks; tick++) {                                                    \
      const double noise = uniform(&seed, -1.3e-4, 1.3e-4);                                        \
      const number gap = (number)((0.5 + uniform(&seed, -1.3e-4, 1.3e-4)) * unit);                 \
      const number current =                                                                       \
          anhyst_play_map_solve_##format(&c, (number)((0.5 + noise) * unit), gap);                 \
      const number on_grid =                                                                       \
          (number)(fmin(floor((double)current / grid + 0.5) * grid, unit - grid));                 \
      anhyst_play_map_commit_##format(&c, is_rounded ? on_grid : current, gap);                    \
      if (tick == SETTLED) {                                                                       \
        first = (double)anhyst_play_map_solve_##format(&c, rest, rest);                            \
      }                                                                                            \
    }                                                                                              \
    return fabs((double)anhyst_play_map_solve_##format(&c, rest, rest) - first) / unit;            \
  }

REST(q31, int32_t, fixed)
REST(f32, float, single)

static void current_does_not_drift_at_rest(long ticks)
{
  static any_play play;
  double fixed = 0.0;
  double single = 0.0;
  for (int i = 0; i < 4; i++) {
    make_play(&play, 6, 2, 900);
    play.fixed[ANHYST_WORD_PLAY_SHIFT] = 2; /* a radius well above the noise */
    play.single[ANHYST_WORD_PLAY_STEEPNESS] =
        (float)(play.fixed[ANHYST_WORD_PLAY_STEEPNESS] / 16384.0);
    set_checksums(&play);
    keep_largest(&fixed, change_at_rest_q31(&play, i % 2, i / 2, ticks));
    keep_largest(&single, change_at_rest_f32(&play, i % 2, i / 2, ticks));
  }
  CHECK_BELOW("change of the current at rest, fixed point", fixed, 2e-5);
  CHECK_BELOW("change of the current at rest, single precision", single, 2e-5);
}

#endif
