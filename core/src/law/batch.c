/* SPDX-License-Identifier: Apache-2.0 */
/* The batch, compiled once for each instruction set with a different ANHYST_BATCH_NAME. The inner
   loops run over parameter sets, without branches or calls, so that a compiler vectorises them. */
#include "anhyst/law/batch.h"

#include <math.h>
#include <stdint.h>
#include <string.h>

#define PASTE_TOKENS(a, b) a##b
#define EXPAND_AND_PASTE(a, b) PASTE_TOKENS(a, b)
#define BATCH_NAME(name) EXPAND_AND_PASTE(EXPAND_AND_PASTE(anhyst_batch_, name), ANHYST_BATCH_NAME)

/* Number of parameter sets that are simulated together. All states fit into the L1 cache. */
#define BLOCK_SETS 64

anhyst_status BATCH_NAME(run)(const anhyst_batch_sets *sets, anhyst_batch_mode mode, size_t n,
                              const double *drive, double *x, double *y, double *m_out,
                              double *x_out);
void BATCH_NAME(functions)(size_t n, const double *t, double *exp_of_negative, double *langevin);

/* Returns exp(-t) for t >= 0, but at least about 1e-300. Adding the magic number rounds t/ln 2 to
   an integer in the low bits, which then become the exponent. */
static inline double exp_of_negative(double t)
{
  const double magic = 6755399441055744.0; /* 1.5 * 2^52 */
  const double bounded = t < 690.0 ? t : 690.0;
  const double shifted = bounded * 1.4426950408889634 + magic;
  uint64_t bits;
  memcpy(&bits, &shifted, sizeof bits);
  const double exponent_steps = shifted - magic;
  const double r =
      (bounded - exponent_steps * 0.6931471803691238) - exponent_steps * 1.9082149292705877e-10;
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

/* Returns L(z), and sets *slope to L'(z) = 1 - L^2 - 2*L/z. For all arguments, L(z)/|z| is one
   quotient of polynomials in |z|, fitted for the smallest maximum error of L, 4.4e-9. The quotient
   needs no exponential and no branch. */
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

/* States and parameters of one block of parameter sets. */
typedef struct {
  double kappa_inverse[BLOCK_SETS], c[BLOCK_SETS], omega[BLOCK_SETS];
  double scale[BLOCK_SETS], shift[BLOCK_SETS]; /* r = scale*drive - shift */
  double reversible[BLOCK_SETS];               /* omega*c */
  double pinned[BLOCK_SETS];                   /* omega*(1 - c)/kappa */
  double x[BLOCK_SETS], y[BLOCK_SETS];
  double anhysteretic[BLOCK_SETS]; /* L(x) */
  double m[BLOCK_SETS];            /* dimensionless magnetisation */
  double newton_gain[BLOCK_SETS];  /* 1/(1 + omega*dm/dx) at the last point */
  double distance[BLOCK_SETS];     /* estimated distance to the solution of this sample */
} block;

/* Purposes of an evaluation of the law. */
enum { PREDICT, CORRECT, COMMIT };

/* All code below works in the direction of travel. The law is odd: signs are removed once. */

static inline double limit_to_positive(double value) { return value > 0.0 ? value : 0.0; }

/* Irreversible magnetisation at the end of a step, and inverse slope of the equation there. */
typedef struct {
  double y, newton_gain;
} step_end;

/* Estimates the end of a step. The lag decays with exp(-s) = 1/(1 + s + s^2/2) for s =
   distance/kappa. A step that starts with constant y is treated as if it crossed the anhysteretic
   curve at its start. One division is sufficient for y and the inverse slope. Arguments: lead is L
   minus y at the start, ahead is L minus y at the end. */
static inline step_end estimate_end(double y0, double lead, double ahead, double s,
                                    double stiffness, double pinned)
{
  const double half = 0.5 * s;
  const double second_order = half + half * s;
  const double denominator = 1.0 + half + second_order;
  const double y_change = ahead * second_order + lead * half;
  const double stiff = denominator * stiffness + pinned * (ahead * denominator - y_change);
  const double inverse = 1.0 / (denominator * stiff);
  const step_end end = {y0 + y_change * (stiff * inverse), denominator * denominator * inverse};
  return end;
}

/* Returns y1 of the linear step in operator.h: y1 = y0 + lead*E(S) + rise*G(S). A step that starts
   with constant y effectively starts at the crossing of the anhysteretic curve, so that S =
   s*ahead/(m1 - m0). S is numerator/denominator. */
static inline double linear_step(double y0, double m0, double m1, double ahead, double s)
{
  const int is_constant_first = m0 < y0;
  const double lead = is_constant_first ? 0.0 : m0 - y0;
  const double rise = is_constant_first ? ahead : m1 - m0;
  const double numerator = is_constant_first ? s * ahead : s;
  const double denominator = is_constant_first ? m1 - m0 : 1.0;
  const double inverse = 1.0 / (numerator * denominator + 1e-280);
  const double e = 1.0 - exp_of_negative(numerator * numerator * inverse);
  return y0 + lead * e + rise * (1.0 - e * (denominator * denominator * inverse));
}

/* Evaluates the law once for every parameter set. PREDICT makes a linearly implicit step and
   estimates its end. CORRECT and COMMIT use the present distance and the linear step. If commit is
   0, a Newton step improves the distance. If commit is 1, the result is the new state. */
static inline void evaluate_step(block *restrict b, double drive, int purpose, int commit)
{
  for (int i = 0; i < BLOCK_SETS; i++) {
    const double c = b->c[i], omega = b->omega[i], pinned = b->pinned[i];
    const double r = b->scale[i] * drive - b->shift[i];
    const double residual = r - b->x[i] - omega * b->m[i];
    const double sign = residual >= 0.0 ? 1.0 : -1.0;
    const double distance =
        purpose == PREDICT ? fabs(residual) * b->newton_gain[i] : b->distance[i];
    const double x1 = sign * b->x[i] + distance;
    const double y0 = sign * b->y[i], m0 = sign * b->anhysteretic[i];
    double slope;
    const double m1 = langevin(x1, &slope);
    const double ahead = limit_to_positive(m1 - y0);
    const double s = distance * b->kappa_inverse[i];
    const double stiffness = 1.0 + b->reversible[i] * slope;
    step_end end;
    if (purpose == PREDICT) {
      end = estimate_end(y0, limit_to_positive(m0 - y0), ahead, s, stiffness, pinned);
    } else {
      end.y = linear_step(y0, m0, m1, ahead, s);
      end.newton_gain = b->newton_gain[i];
      if (purpose == CORRECT) {
        end.newton_gain = 1.0 / (stiffness + pinned * limit_to_positive(m1 - end.y));
      }
    }
    const double m = end.y + c * (m1 - end.y);
    b->newton_gain[i] = end.newton_gain;
    if (commit) {
      b->x[i] = sign * x1;
      b->y[i] = sign * end.y;
      b->anhysteretic[i] = sign * m1;
      b->m[i] = sign * m;
    } else {
      b->distance[i] = limit_to_positive(distance - (x1 + omega * m - sign * r) * end.newton_gain);
    }
  }
}

static void load_block(block *b, const anhyst_batch_sets *sets, size_t first, const double *x,
                       const double *y)
{
  for (size_t i = 0; i < BLOCK_SETS; i++) {
    /* The last block is filled with copies of the last parameter set. */
    const size_t set = first + i < sets->sets ? first + i : sets->sets - 1;
    b->kappa_inverse[i] = 1.0 / sets->kappa[set];
    b->c[i] = sets->c[set];
    b->omega[i] = sets->omega[set];
    b->scale[i] = sets->scale[set];
    b->shift[i] = sets->scale[set] * sets->offset[set];
    b->reversible[i] = b->omega[i] * b->c[i];
    b->pinned[i] = b->omega[i] * (1.0 - b->c[i]) * b->kappa_inverse[i];
    b->x[i] = x[set];
    b->y[i] = y[set];
    double slope;
    b->anhysteretic[i] = langevin(x[set], &slope);
    b->m[i] = (1.0 - b->c[i]) * b->y[i] + b->c[i] * b->anhysteretic[i];
    b->newton_gain[i] = 1.0 / (1.0 + b->omega[i] * b->c[i] * slope);
  }
}

anhyst_status BATCH_NAME(run)(const anhyst_batch_sets *sets, anhyst_batch_mode mode, size_t n,
                              const double *drive, double *x, double *y, double *m_out,
                              double *x_out)
{
  for (size_t first = 0; first < sets->sets; first += BLOCK_SETS) {
    const size_t count = sets->sets - first < BLOCK_SETS ? sets->sets - first : BLOCK_SETS;
    block b;
    load_block(&b, sets, first, x, y);
    for (size_t j = 0; j < n; j++) {
      if (mode == ANHYST_BATCH_EXPLICIT) {
        evaluate_step(&b, drive[j], PREDICT, 1);
      } else {
        evaluate_step(&b, drive[j], PREDICT, 0);
        evaluate_step(&b, drive[j], CORRECT, 0);
        evaluate_step(&b, drive[j], COMMIT, 1);
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

void BATCH_NAME(functions)(size_t n, const double *t, double *exp_out, double *langevin_out)
{
  for (size_t i = 0; i < n; i++) {
    double slope;
    exp_out[i] = exp_of_negative(fabs(t[i]));
    langevin_out[i] = langevin(t[i], &slope);
  }
}
