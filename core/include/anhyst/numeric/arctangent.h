/* SPDX-License-Identifier: Apache-2.0 */
/* The arc tangent as an inline function, for loops in which a call would take too much time.
   elementary.h states its error. */
#ifndef ANHYST_ARCTANGENT_H
#define ANHYST_ARCTANGENT_H

#include <math.h>
#include <stdint.h>
#include <string.h>

#ifdef __cplusplus
extern "C" {
#endif

/* A constant as the sum of the nearest double and a residual. */
typedef struct {
  double value, residual;
} anhyst_pair;

/* atan(c) for c = 0, then for the centre c of each eighth of an octave from 1/32 to 64. */
extern const anhyst_pair anhyst_angles[89];

static inline double anhyst_arctangent(double x)
{
  const double t = fabs(x);
  double u;
  double value;
  double residual;
  if (!(t < 64.0)) { /* a NaN also takes this branch, and the result is NaN */
    value = 0x1.921fb54442d18p+0;
    residual = 0x1.1a62633145c07p-54;
    u = -1.0 / t;
  } else {
    /* atan(t) = atan(centre) + atan((t - centre)/(1 + t*centre)) */
    /* exponent and first three fraction bits of the double 1/32 */
    const uint64_t first_eighth = UINT64_C(0x3FA0000000000000) >> 49U;
    const anhyst_pair *angle = anhyst_angles;
    double centre = 0.0;
    uint64_t bits;
    uint64_t eighths;
    memcpy(&bits, &t, sizeof bits);
    eighths = bits >> 49U;
    /* A branch instead of an entry for 0: it is predicted well, so that for |x| < 1/32 the quotient
       does not wait for the table. */
    if (eighths >= first_eighth) {
      bits = (2U * eighths + 1U) << 48U;
      memcpy(&centre, &bits, sizeof centre);
      angle += eighths - first_eighth + 1U;
    }
    value = angle->value;
    residual = angle->residual;
    u = (t - centre) / (1.0 + t * centre);
  }
  const double u2 = u * u;
  const double u3 = u * u2;
  const double u4 = u2 * u2;
  const double low_terms = 1.0 / 3.0 - u2 * (1.0 / 5.0);
  const double high_terms = (1.0 / 7.0 - u2 * (1.0 / 9.0)) + u4 * (1.0 / 11.0);
  return copysign(value + (u + ((residual - u3 * low_terms) - (u3 * u4) * high_terms)), x);
}

#ifdef __cplusplus
}
#endif
#endif
