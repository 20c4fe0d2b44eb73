/* SPDX-License-Identifier: Apache-2.0 */
#include "truth.h"

#include <math.h>

#define POINTS 16

/* Up to this argument the power series are used: all their terms are positive. */
static const long double series_end = 6.0L;

long double true_langevin(long double z)
{
  const long double size = fabsl(z);
  if (size > series_end) {
    const long double value = 1.0L - 1.0L / size + 2.0L / expm1l(2.0L * size);
    return z < 0.0L ? -value : value;
  }
  /* (z*cosh z - sinh z)/(z*sinh z) = z * (sum of 2n*t^(n-1)/(2n+1)!)/(sum of t^n/(2n+1)!) */
  const long double t = z * z;
  long double power = 1.0L;
  long double factor = 1.0L;
  long double top = 0.0L;
  long double bottom = 1.0L;
  for (int n = 1; n < 60; n++) {
    factor /= (long double)(2 * n) * (long double)(2 * n + 1);
    top += (long double)(2 * n) * factor * power;
    power *= t;
    bottom += factor * power;
  }
  return z * (top / bottom);
}

long double true_langevin_slope(long double z)
{
  const long double size = fabsl(z);
  if (size > series_end) {
    const long double e = expl(-2.0L * size);
    return 1.0L / (size * size) - 4.0L * e / ((1.0L - e) * (1.0L - e));
  }
  /* (sinh^2 z - z^2)/(z^2*sinh^2 z), with sinh^2 z the sum of 2^(2n-1)*t^n/(2n)! */
  const long double t = z * z;
  long double power = 1.0L;
  long double factor = 1.0L;
  long double top = 0.0L;
  long double bottom = 1.0L;
  for (int n = 2; n < 80; n++) {
    factor *= 4.0L / ((long double)(2 * n) * (long double)(2 * n - 1));
    top += factor * power;
    power *= t;
    bottom += factor * power;
  }
  return top / bottom;
}

long double true_inverse_langevin(long double y)
{
  long double low = 0.0L;
  long double high = 4.0L / (1.0L - fabsl(y));
  for (int i = 0; i < 40; i++) {
    const long double middle = 0.5L * (low + high);
    if (true_langevin(middle) < fabsl(y)) {
      low = middle;
    } else {
      high = middle;
    }
  }
  long double z = 0.5L * (low + high);
  for (int i = 0; i < 3; i++) {
    z -= (true_langevin(z) - fabsl(y)) / true_langevin_slope(z);
  }
  return y < 0.0L ? -z : z;
}

/* Gauss-Legendre rule on -1..1: roots by Newton's method from Chebyshev's initial guess. */
static void gauss_rule(long double at[POINTS], long double weight[POINTS])
{
  const long double pi = 3.14159265358979323846L;
  for (int i = 0; i < POINTS; i++) {
    long double x = cosl(pi * ((long double)i + 0.75L) / ((long double)POINTS + 0.5L));
    long double slope = 1.0L;
    for (int pass = 0; pass < 12; pass++) {
      long double p = x;
      long double before = 1.0L;
      for (int n = 2; n <= POINTS; n++) {
        const long double next =
            ((long double)(2 * n - 1) * x * p - (long double)(n - 1) * before) / (long double)n;
        before = p;
        p = next;
      }
      slope = (long double)POINTS * (x * p - before) / (x * x - 1.0L);
      x -= p / slope;
    }
    at[i] = x;
    weight[i] = 2.0L / ((1.0L - x * x) * slope * slope);
  }
}

/* Returns the integral over from < u < to of f(u)*w(s)*exp(-s)/kappa, s = (to - u)/kappa, with f =
   L, w = 1 or f = L', w = -s. Panels are short compared with kappa and with the distance to the
   poles of f. */
static long double fading(long double kappa, long double from, long double to, int slope)
{
  long double at[POINTS];
  long double weight[POINTS];
  gauss_rule(at, weight);
  long double sum = 0.0L;
  long double upper = to;
  while (upper > from) {
    long double width = 0.4L * fabsl(upper);
    width = width > 1.0L ? width : 1.0L;
    width = width < kappa ? width : kappa;
    width = width < upper - from ? width : upper - from;
    for (int i = 0; i < POINTS; i++) {
      const long double u = upper - 0.5L * width * (1.0L - at[i]);
      const long double s = (to - u) / kappa;
      const long double f = slope ? -s * true_langevin_slope(u) : true_langevin(u);
      sum += 0.5L * width * weight[i] * f * expl(-s) / kappa;
    }
    upper -= width;
    if (upper - from < 1e-15L * fabsl(from)) {
      break;
    }
  }
  return sum;
}

long double true_branch(long double kappa, long double x)
{
  return fading(kappa, x - 50.0L * kappa, x, 0);
}

long double true_branch_slope(long double kappa, long double x)
{
  return fading(kappa, x - 55.0L * kappa, x, 1);
}

long double true_irreversible(long double kappa, long double x0, long double y0, long double x1)
{
  /* The path is mirrored so that it ascends, because the law is odd. */
  const long double sign = x1 < x0 ? -1.0L : 1.0L;
  const long double y = sign * y0;
  const long double end = sign * x1;
  long double start = sign * x0;
  if (true_langevin(start) < y) {
    start = true_inverse_langevin(y);
  }
  if (end <= start) {
    return y0;
  }
  const long double kept = expl(-(end - start) / kappa);
  const long double memory = end - 50.0L * kappa;
  return sign * (y * kept + fading(kappa, start > memory ? start : memory, end, 0));
}

static long double slope_1986(long double kappa, long double eps, long double x, long double y)
{
  const long double ahead = true_langevin(x) - y;
  const long double q = ahead > 0.0L ? ahead / kappa : 0.0L;
  return q * (1.0L - eps * true_langevin_slope(x)) / (1.0L - eps * q);
}

long double true_irreversible_1986(long double kappa, long double eps, long double x0,
                                   long double y0, long double x1)
{
  const long double sign = x1 < x0 ? -1.0L : 1.0L;
  long double y = sign * y0;
  long double x = sign * x0;
  const long double end = sign * x1;
  if (true_langevin(x) < y) {
    x = true_inverse_langevin(y);
  }
  if (end <= x) {
    return y0;
  }
  const long double finest = kappa < 1.0L ? kappa / 64.0L : 1.0L / 64.0L;
  const int steps = (int)((end - x) / finest) + 1;
  const long double h = (end - x) / (long double)steps;
  for (int i = 0; i < steps; i++) {
    const long double k1 = slope_1986(kappa, eps, x, y);
    const long double k2 = slope_1986(kappa, eps, x + 0.5L * h, y + 0.5L * h * k1);
    const long double k3 = slope_1986(kappa, eps, x + 0.5L * h, y + 0.5L * h * k2);
    const long double k4 = slope_1986(kappa, eps, x + h, y + h * k3);
    y += h / 6.0L * (k1 + 2.0L * (k2 + k3) + k4);
    x += h;
  }
  return sign * y;
}

uint64_t random_bits(uint64_t *seed)
{
  /* xorshift64* */
  *seed ^= *seed >> 12;
  *seed ^= *seed << 25;
  *seed ^= *seed >> 27;
  return *seed * UINT64_C(2685821657736338717);
}

double uniform(uint64_t *seed, double low, double high)
{
  return low + (high - low) * ((double)(random_bits(seed) >> 11) * 0x1p-53);
}

double log_uniform(uint64_t *seed, double low, double high)
{
  return exp(uniform(seed, log(low), log(high)));
}
