/* SPDX-License-Identifier: Apache-2.0 */
/* Compiled once for each instruction set under another ANHYST_BATCH_NAME; the inner loops run over
   sets, hold no branch and no call, and are vectorised by the compiler. */
#include "anhyst/law/batch.h"

#include <math.h>
#include <stdint.h>
#include <string.h>

#define PASTE_(a, b) a##b
#define PASTE(a, b) PASTE_(a, b)
#define BATCH(name) PASTE(PASTE(anhyst_batch_, name), ANHYST_BATCH_NAME)

/* Sets that are carried through the whole record together: their states stay in the first cache. */
#define BLOCK 64

anhyst_status BATCH(run)(const anhyst_batch_sets *sets, anhyst_batch_mode mode, size_t n,
                         const double *drive, double *x, double *y, double *m_out, double *x_out);
void BATCH(functions)(size_t n, const double *t, double *exp_minus, double *langevin);

/* exp(-t) for 0 <= t; below 1e-300 it stays there. Adding the magic number rounds t/ln 2 to an
   integer in the low bits, which then become the exponent. */
static inline double exp_minus(double t)
{
  const double magic = 6755399441055744.0; /* 1.5 * 2^52 */
  const double bounded = t < 690.0 ? t : 690.0;
  const double shifted = bounded * 1.4426950408889634 + magic;
  uint64_t bits;
  memcpy(&bits, &shifted, sizeof bits);
  const double halvings = shifted - magic;
  const double r = (bounded - halvings * 0.6931471803691238) - halvings * 1.9082149292705877e-10;
  const double r2 = r * r;
  const double r4 = r2 * r2;
  const double p =
      (1.0 - r) + r2 * (1.0 / 2.0 - r * (1.0 / 6.0)) +
      r4 * ((1.0 / 24.0 - r * (1.0 / 120.0)) + r2 * (1.0 / 720.0 - r * (1.0 / 5040.0)) +
            r4 * (1.0 / 40320.0 - r * (1.0 / 362880.0)));
  const uint64_t exponent = (UINT64_C(1023) - bits) << 52;
  double power;
  memcpy(&power, &exponent, sizeof power);
  return p * power;
}

/* L(z); *slope gets L'(z) = 1 - L^2 - 2*L/z. L(z)/|z| is one quotient of polynomials in |z| over
   the whole axis, fitted for the least largest error of L: 4.4e-9; no exponential, no case. */
static inline double langevin(double z, double *slope)
{
  const double t = fabs(z);
  const double t2 = t * t;
  const double t4 = t2 * t2;
  const double top = (20367.97445645057 + t * 9261.98845699617) +
                     t2 * (3697.004885881637 + t * 1023.6783293680494) +
                     t4 * ((218.8596521803859 + t * 42.08139472129721) +
                           t2 * (3.801765718559719 + t * 0.9999999959680494));
  const double bottom = (61103.96305416301 + t * 27785.34522066529) +
                        t2 * (15167.916764410194 + t * 4914.758177325737) +
                        t4 * ((1292.6958485786317 + t * 265.6590618438167) +
                              t2 * (46.884225436409004 + t * 4.80176056356537) + t4);
  const double per_z = top / bottom;
  const double value = z * per_z;
  *slope = 1.0 - value * value - 2.0 * per_z;
  return value;
}

/* States and parameters of one block. */
typedef struct {
  double kappa_inverse[BLOCK], c[BLOCK], omega[BLOCK];
  double scale[BLOCK], shift[BLOCK]; /* r = scale*drive - shift */
  double reversible[BLOCK];          /* omega*c */
  double pinned[BLOCK];              /* omega*(1 - c)/kappa */
  double x[BLOCK], y[BLOCK];
  double pull[BLOCK];        /* L(x) */
  double m[BLOCK];           /* dimensionless magnetisation */
  double way_inverse[BLOCK]; /* 1/(1 + omega*dm/dx) at the last place */
  double distance[BLOCK];    /* to go at this sample, as far as known */
} block;

/* What one visit to the law is for. */
enum { PREDICT, CORRECT, COMMIT };

/* Everything below is seen in the direction of travel: signs are taken out once, the law is odd. */

static inline double positive(double value) { return value > 0.0 ? value : 0.0; }

/* Where the irreversible part lands, and how steep the equation is there. */
typedef struct {
  double y, way_inverse;
} landing;

/* Lag over a step of s = distance/kappa with exp(-s) = 1/(1 + s + s^2/2), and a step that begins
   held taken as if it crossed the anhysteretic at its start: one division for lag and slope. lead
   and ahead say how far L is ahead of y at both ends. */
static inline landing land_roughly(double y0, double lead, double ahead, double s, double stiffness,
                                   double pinned)
{
  const double half = 0.5 * s;
  const double curved = half + half * s;
  const double below = 1.0 + half + curved;
  const double moved = ahead * curved + lead * half;
  const double stiff = below * stiffness + pinned * (ahead * below - moved);
  const double inverse = 1.0 / (below * stiff);
  const landing at = {y0 + moved * (stiff * inverse), below * below * inverse};
  return at;
}

/* The linear step of operator.h: y1 = y0 + lead*E(S) + rise*G(S). A step that begins held starts
   from the crossing of the anhysteretic, S = s*ahead/(m1 - m0): a quotient top/bottom. */
static inline double land_exactly(double y0, double m0, double m1, double ahead, double s)
{
  const int held = m0 < y0;
  const double lead = held ? 0.0 : m0 - y0;
  const double rise = held ? ahead : m1 - m0;
  const double top = held ? s * ahead : s;
  const double bottom = held ? m1 - m0 : 1.0;
  const double inverse = 1.0 / (top * bottom + 1e-280);
  const double e = 1.0 - exp_minus(top * top * inverse);
  return y0 + lead * e + rise * (1.0 - e * (bottom * bottom * inverse));
}

/* One visit to the law for every set. PREDICT goes a linearly implicit step and lands roughly;
   CORRECT and COMMIT go the distance found so far and take the linear step. PREDICT and CORRECT
   improve the distance by a Newton step; with commit the visit becomes the new state. */
static inline void visit(block *restrict b, double drive, int what, int commit)
{
  for (int i = 0; i < BLOCK; i++) {
    const double c = b->c[i], omega = b->omega[i], pinned = b->pinned[i];
    const double r = b->scale[i] * drive - b->shift[i];
    const double left = r - b->x[i] - omega * b->m[i];
    const double sign = left >= 0.0 ? 1.0 : -1.0;
    const double distance = what == PREDICT ? fabs(left) * b->way_inverse[i] : b->distance[i];
    const double x1 = sign * b->x[i] + distance;
    const double y0 = sign * b->y[i], m0 = sign * b->pull[i];
    double slope;
    const double m1 = langevin(x1, &slope);
    const double ahead = positive(m1 - y0);
    const double s = distance * b->kappa_inverse[i];
    const double stiffness = 1.0 + b->reversible[i] * slope;
    landing at;
    if (what == PREDICT) {
      at = land_roughly(y0, positive(m0 - y0), ahead, s, stiffness, pinned);
    } else {
      at.y = land_exactly(y0, m0, m1, ahead, s);
      at.way_inverse = b->way_inverse[i];
      if (what == CORRECT) {
        at.way_inverse = 1.0 / (stiffness + pinned * positive(m1 - at.y));
      }
    }
    const double m = at.y + c * (m1 - at.y);
    b->way_inverse[i] = at.way_inverse;
    if (commit) {
      b->x[i] = sign * x1;
      b->y[i] = sign * at.y;
      b->pull[i] = sign * m1;
      b->m[i] = sign * m;
    } else {
      b->distance[i] = positive(distance - (x1 + omega * m - sign * r) * at.way_inverse);
    }
  }
}

static void load_block(block *b, const anhyst_batch_sets *sets, size_t first, const double *x,
                       const double *y)
{
  for (size_t i = 0; i < BLOCK; i++) {
    /* The last block is filled up with copies of the last set. */
    const size_t at = first + i < sets->sets ? first + i : sets->sets - 1;
    b->kappa_inverse[i] = 1.0 / sets->kappa[at];
    b->c[i] = sets->c[at];
    b->omega[i] = sets->omega[at];
    b->scale[i] = sets->scale[at];
    b->shift[i] = sets->scale[at] * sets->offset[at];
    b->reversible[i] = b->omega[i] * b->c[i];
    b->pinned[i] = b->omega[i] * (1.0 - b->c[i]) * b->kappa_inverse[i];
    b->x[i] = x[at];
    b->y[i] = y[at];
    double slope;
    b->pull[i] = langevin(x[at], &slope);
    b->m[i] = (1.0 - b->c[i]) * b->y[i] + b->c[i] * b->pull[i];
    b->way_inverse[i] = 1.0 / (1.0 + b->omega[i] * b->c[i] * slope);
  }
}

anhyst_status BATCH(run)(const anhyst_batch_sets *sets, anhyst_batch_mode mode, size_t n,
                         const double *drive, double *x, double *y, double *m_out, double *x_out)
{
  for (size_t first = 0; first < sets->sets; first += BLOCK) {
    const size_t count = sets->sets - first < BLOCK ? sets->sets - first : BLOCK;
    block b;
    load_block(&b, sets, first, x, y);
    for (size_t j = 0; j < n; j++) {
      if (mode == ANHYST_BATCH_EXPLICIT) {
        visit(&b, drive[j], PREDICT, 1);
      } else {
        visit(&b, drive[j], PREDICT, 0);
        visit(&b, drive[j], CORRECT, 0);
        visit(&b, drive[j], COMMIT, 1);
      }
      if (m_out != 0) {
        memcpy(m_out + j * sets->sets + first, b.m, count * sizeof(double));
        memcpy(x_out + j * sets->sets + first, b.x, count * sizeof(double));
      }
    }
    memcpy(x + first, b.x, count * sizeof(double));
    memcpy(y + first, b.y, count * sizeof(double));
  }
  return ANHYST_OK;
}

void BATCH(functions)(size_t n, const double *t, double *exp_out, double *langevin_out)
{
  for (size_t i = 0; i < n; i++) {
    double slope;
    exp_out[i] = exp_minus(fabs(t[i]));
    langevin_out[i] = langevin(t[i], &slope);
  }
}
