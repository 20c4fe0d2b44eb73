/* SPDX-License-Identifier: Apache-2.0 */
/* The words of a block that the Jiles-Atherton law reads. */
#ifndef TEST_FULL_WORDS_H
#define TEST_FULL_WORDS_H

#include <math.h>

#include "anhyst/compensator/layout.h"

#include "truth.h"

enum { MOST_SEGMENTS = 512 };

/* The law with tables of 2^9 segments; x reaches 4 times the shape field. */
static const double REACH = 4.0;
static int16_t words[ANHYST_BLOCK_LEAST_WORDS + 3 * (2 * MOST_SEGMENTS + 1)];

static inline double langevin(double x) { return (double)true_langevin((long double)x); }

static inline double inverse_langevin(double y)
{
  return (double)true_inverse_langevin((long double)y);
}

static inline double branch_at(double kappa, double x)
{
  return (double)true_branch((long double)kappa, (long double)x);
}

static inline int16_t nearest(double x) { return (int16_t)lrint(fmin(x, 32767.0)); }

static inline void prepare_law(double kappa, double c, double play)
{
  const int first = ANHYST_BLOCK_LEAST_WORDS;
  const int last = first + MOST_SEGMENTS + 1;
  const double rate = REACH / (kappa * log(2.0)) / 16.0;
  const int shift = rate < 0.49 ? 0 : (int)ceil(log2(rate / 0.49));
  words[ANHYST_WORD_FULL_REVERSIBLE] = nearest(c * 32768.0);
  words[ANHYST_WORD_FULL_PLAY] = nearest(play / REACH * 32768.0);
  words[ANHYST_WORD_FULL_RATE] = nearest(rate / pow(2.0, shift) * 65536.0);
  words[ANHYST_WORD_FULL_RATE_SHIFT] = (int16_t)shift;
  words[ANHYST_WORD_FULL_STEEPNESS] = nearest(REACH / kappa * 256.0);
  words[ANHYST_WORD_FULL_CURVE_SEGMENTS] = 9;
  words[ANHYST_WORD_FULL_CURVE] = (int16_t)first;
  words[ANHYST_WORD_FULL_BRANCH] = (int16_t)last;
  words[ANHYST_WORD_FULL_INVERSE_SEGMENTS] = 9;
  words[ANHYST_WORD_FULL_INVERSE] = (int16_t)(last + 2 * MOST_SEGMENTS + 1);
  for (int i = 0; i <= MOST_SEGMENTS; i++) {
    const double share = (double)i / (double)MOST_SEGMENTS;
    words[first + i] = nearest(langevin(share * REACH) * 32768.0);
    const double field = inverse_langevin(fmin(share, 0.9));
    words[words[ANHYST_WORD_FULL_INVERSE] + i] = nearest(fmin(field / REACH, 1.0) * 32767.0);
  }
  for (int i = 0; i <= 2 * MOST_SEGMENTS; i++) {
    const double x = REACH * ((double)i / (double)MOST_SEGMENTS - 1.0);
    words[last + i] = nearest(branch_at(kappa, x) * 32768.0);
  }
}

#endif
