/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/law/branch.h"

#include <math.h>

#include "anhyst/numeric/elementary.h"
#include "anhyst/law/langevin.h"

/* Gauss-Laguerre, 8 points for the weight exp(-s). */
static const double laguerre_at[8] = {0.17027963230510093, 0.90370177679938,   2.251086629866131,
                                      4.266700170287659,   7.0459054023934655, 10.758516010180996,
                                      15.740678641278004,  22.863131736889265};
static const double laguerre_weight[8] = {
    0.36918858934163495,   0.4187867808143447,    0.17579498663717255,  0.033343492261215794,
    0.0027945362352256834, 9.076508773358139e-05, 8.48574671627257e-07, 1.0480011748715153e-09};

/* exp(-40) is below the last place of any result here. */
static const double memory = 40.0;
static const double panel = 4.0;
#define MOST_PANELS 11

/* The branch and its derivative in kappa at one place, carried from left to right. */
typedef struct {
  double kappa;
  double x;
  double value;  /* A(x) */
  double steep;  /* dA/dx */
  double tilted; /* dA/dkappa */
  double span;   /* length for which places and weights below were made */
  int points;
  double place[8 * MOST_PANELS];  /* s, distance travelled in units of kappa */
  double weight[8 * MOST_PANELS]; /* times exp(-s) */
} walker;

/* Value and two derivatives in x: what one end of a quintic piece needs. */
typedef struct {
  double f, f1, f2;
} jet;

/* Gauss-Legendre, 8 points on 0..1. */
static const double gauss_at[8] = {0.019855071751231884, 0.10166676129318664, 0.23723379504183550,
                                   0.40828267875217511,  0.59171732124782489, 0.76276620495816450,
                                   0.89833323870681336,  0.98014492824876812};
static const double gauss_weight[8] = {
    0.050614268145188130, 0.11119051722668724, 0.15685332293894364, 0.18134189168918099,
    0.18134189168918099,  0.15685332293894364, 0.11119051722668724, 0.050614268145188130};

static walker walker_start(double kappa)
{
  /* Far left L(x) = -1 - 1/x, and A + 1 is an exponential integral: its asymptotic series. */
  const double far = ANHYST_X_MAX * 1.01;
  const double q = kappa / far;
  walker w;
  w.kappa = kappa;
  w.x = -far;
  w.span = -1.0;
  w.points = 0;
  w.value = -1.0 + (1.0 - q * (1.0 - 2.0 * q * (1.0 - 3.0 * q))) / far;
  w.steep = (1.0 - 2.0 * q * (1.0 - 3.0 * q)) / (far * far);
  w.tilted = -(1.0 - 4.0 * q * (1.0 - 4.5 * q)) / (far * far);
  return w;
}

/* Points over 0 < s < span; most steps share their span, so they are kept. Beyond the memory of the
   law only the end of the step counts, where L is all but straight: one rule for all of it. */
static void walker_lay_points(walker *w, double span)
{
  if (span >= memory) {
    w->span = span;
    w->points = 8;
    for (int i = 0; i < 8; i++) {
      w->place[i] = laguerre_at[i];
      w->weight[i] = laguerre_weight[i];
    }
    return;
  }
  const int panels = (int)(span / panel) + 1;
  const double width = span / panels;
  w->span = span;
  w->points = 8 * panels;
  for (int i = 0; i < w->points; i++) {
    const int earlier = i / 8; /* panels before this point's */
    w->place[i] = (earlier + gauss_at[i % 8]) * width;
    w->weight[i] = gauss_weight[i % 8] * width * anhyst_exp_f64(-w->place[i]);
  }
}

static void walker_advance(walker *w, double x)
{
  const double length = (x - w->x) / w->kappa;
  const double span = length < memory ? length : memory;
  double gained = 0.0;
  double risen = 0.0;
  double tilt = 0.0;
  double slope;
  if (fabs(span - w->span) > 0.0) {
    walker_lay_points(w, span);
  }
  for (int i = 0; i < w->points; i++) {
    gained += w->weight[i] * anhyst_langevin_f64(x - w->kappa * w->place[i], &slope);
    risen += w->weight[i] * slope;
    tilt += w->weight[i] * w->place[i] * slope;
  }
  const double kept = anhyst_exp_f64(-length);
  w->tilted = kept * (w->tilted - length * w->steep) - tilt;
  w->steep = kept * w->steep + risen;
  w->value = kept * w->value + gained;
  w->x = x;
}

static jet walker_value(const walker *w)
{
  jet at;
  double slope;
  at.f = w->value;
  at.f1 = w->steep; /* and not (L - A)/kappa, whose digits cancel where kappa is small */
  (void)anhyst_langevin_f64(w->x, &slope);
  at.f2 = (slope - at.f1) / w->kappa;
  return at;
}

static jet walker_tilted(const walker *w)
{
  const jet value = walker_value(w);
  jet at;
  at.f = w->tilted;
  at.f1 = (-value.f1 - at.f) / w->kappa;
  at.f2 = (-value.f2 - at.f1) / w->kappa;
  return at;
}

/* Derivatives by the place t in a piece, from derivatives by x and the map x(t). */
static jet by_place(jet at, double x1, double x2)
{
  jet placed;
  placed.f = at.f;
  placed.f1 = at.f1 * x1;
  placed.f2 = at.f2 * x1 * x1 + at.f1 * x2;
  return placed;
}

static void quintic(jet p, jet q, double out[6])
{
  const double d = q.f - p.f;
  out[0] = p.f;
  out[1] = p.f1;
  out[2] = 0.5 * p.f2;
  out[3] = 10.0 * d - 6.0 * p.f1 - 4.0 * q.f1 - 1.5 * p.f2 + 0.5 * q.f2;
  out[4] = -15.0 * d + 8.0 * p.f1 + 7.0 * q.f1 + 1.5 * p.f2 - q.f2;
  out[5] = 6.0 * d - 3.0 * p.f1 - 3.0 * q.f1 - 0.5 * p.f2 + 0.5 * q.f2;
}

static double outer_node(int i)
{
  return ANHYST_BRANCH_EDGE * anhyst_exp_f64((double)i / ANHYST_BRANCH_PER_LOG);
}

static jet outer_jet(jet at, double x)
{
  const double x1 = x / ANHYST_BRANCH_PER_LOG;
  return by_place(at, x1, x1 / ANHYST_BRANCH_PER_LOG);
}

static int kappa_allowed(double kappa)
{
  return kappa >= ANHYST_KAPPA_MIN && kappa <= ANHYST_KAPPA_MAX;
}

static void store(double piece[6], jet from, jet to)
{
  double exact[6];
  quintic(from, to, exact);
  for (int i = 0; i < 6; i++) {
    piece[i] = (double)exact[i];
  }
}

/* Tables are built in double precision for both formats: it is done once a parameter set. */
static void tabulate(anhyst_pieces_f64 *pieces, double kappa, jet (*read)(const walker *))
{
  const double inner_width = 1.0 / ANHYST_BRANCH_PER_UNIT;
  walker w = walker_start(kappa);
  double x = -outer_node(ANHYST_BRANCH_OUTER);
  walker_advance(&w, x);
  jet last = outer_jet(read(&w), x);
  for (int i = ANHYST_BRANCH_OUTER - 1; i >= 0; i--) {
    x = -outer_node(i);
    walker_advance(&w, x);
    const jet next = outer_jet(read(&w), x);
    store(pieces->left[i], next, last);
    last = next;
  }
  last = by_place(read(&w), inner_width, 0.0);
  for (int i = 0; i < ANHYST_BRANCH_INNER; i++) {
    walker_advance(&w, -ANHYST_BRANCH_EDGE + (i + 1) * inner_width);
    const jet next = by_place(read(&w), inner_width, 0.0);
    store(pieces->inner[i], last, next);
    last = next;
  }
  last = outer_jet(read(&w), outer_node(0));
  for (int i = 0; i < ANHYST_BRANCH_OUTER; i++) {
    x = outer_node(i + 1);
    walker_advance(&w, x);
    const jet next = outer_jet(read(&w), x);
    store(pieces->right[i], last, next);
    last = next;
  }
}

static double piece_at(const double c[6], double t)
{
  return c[0] + t * (c[1] + t * (c[2] + t * (c[3] + t * (c[4] + t * c[5]))));
}

static double pieces_at(const anhyst_pieces_f64 *pieces, double x)
{
  const double size = fabs(x);
  if (size < 30.0) {
    const double place = (x + 30.0) * (double)ANHYST_BRANCH_PER_UNIT;
    const int i = (int)place;
    if (i < ANHYST_BRANCH_INNER) {
      return piece_at(pieces->inner[i], place - (double)i);
    }
  }
  double place = anhyst_log_f64(size / 30.0) * (double)ANHYST_BRANCH_PER_LOG;
  if (!(place > 0.0)) {
    place = 0.0;
  }
  if (!(place < (double)ANHYST_BRANCH_OUTER)) {
    place = (double)ANHYST_BRANCH_OUTER;
  }
  int i = (int)place;
  if (i == ANHYST_BRANCH_OUTER) {
    i--;
  }
  return piece_at(x < 0.0 ? pieces->left[i] : pieces->right[i], place - (double)i);
}

anhyst_status anhyst_branch_build_f64(anhyst_branch_f64 *branch, double kappa)
{
  if (!kappa_allowed((double)kappa)) {
    return ANHYST_BAD_PARAMETER;
  }
  branch->kappa = kappa;
  tabulate(&branch->value, (double)kappa, walker_value);
  return ANHYST_OK;
}

anhyst_status anhyst_branch_slope_build_f64(anhyst_branch_slope_f64 *slope, double kappa)
{
  if (!kappa_allowed((double)kappa)) {
    return ANHYST_BAD_PARAMETER;
  }
  tabulate(&slope->value, (double)kappa, walker_tilted);
  return ANHYST_OK;
}

double anhyst_branch_at_f64(const anhyst_branch_f64 *branch, double x)
{
  return pieces_at(&branch->value, x);
}

double anhyst_branch_slope_at_f64(const anhyst_branch_slope_f64 *slope, double x)
{
  return pieces_at(&slope->value, x);
}
