/* SPDX-License-Identifier: Apache-2.0 */
#ifndef ANHYST_WEIGHTS_H
#define ANHYST_WEIGHTS_H

#include "anhyst/numeric/elementary.h"

/* Weights of the linear step, smooth at s = 0: E = 1 - exp(-s), G = 1 - E/s, and dG/ds. */
typedef struct {
  double e, g, g_slope;
} weights;

static inline weights weights_at(double s)
{
  weights w;
  const double decay = anhyst_exp_f64(-s);
  if (s < 0.3) {
    /* Uses a series, because the closed forms lose digits in proportion to s^-2. */
    w.g = s * (1.0 / 2.0 -
               s * (1.0 / 6.0 -
                    s * (1.0 / 24.0 -
                         s * (1.0 / 120.0 -
                              s * (1.0 / 720.0 -
                                   s * (1.0 / 5040.0 -
                                        s * (1.0 / 40320.0 -
                                             s * (1.0 / 362880.0 -
                                                  s * (1.0 / 3628800.0 - s / 39916800.0)))))))));
    w.e = s * (1.0 - w.g);
    w.g_slope =
        1.0 / 2.0 -
        s * (1.0 / 3.0 -
             s * (1.0 / 8.0 -
                  s * (1.0 / 30.0 -
                       s * (1.0 / 144.0 -
                            s * (1.0 / 840.0 - s * (1.0 / 5760.0 -
                                                    s * (1.0 / 45360.0 - s * (1.0 / 403200.0 -
                                                                              s / 3991680.0))))))));
    return w;
  }
  w.e = 1.0 - decay;
  w.g = 1.0 - w.e / s;
  w.g_slope = (w.e / s - decay) / s;
  return w;
}

#endif
