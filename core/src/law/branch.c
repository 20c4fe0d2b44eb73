/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/law/branch.h"

#include <math.h>

#include "anhyst/numeric/elementary.h"
#include "anhyst/law/langevin.h"

/* Points and weights of Gauss-Laguerre quadrature, 8 points for the weight function exp(-s). */
static const double laguerre_points[8] = {
    0.17027963230510093, 0.90370177679938,   2.251086629866131,  4.266700170287659,
    7.0459054023934655,  10.758516010180996, 15.740678641278004, 22.863131736889265};
static const double laguerre_weight[8] = {
    0.36918858934163495,   0.4187867808143447,    0.17579498663717255,  0.033343492261215794,
    0.0027945362352256834, 9.076508773358139e-05, 8.48574671627257e-07, 1.0480011748715153e-09};

/* Distance in units of kappa after which exp(-s) is below the last digit of every result. */
static const double decay_length = 40.0;
static const double panel_length = 4.0;
#define MAX_PANELS 11

/* The branch and its derivative with respect to kappa at one x, integrated in ascending x. */
typedef struct {
  double kappa;
  double x;
  double value;            /* A(x) */
  double slope;            /* dA/dx */
  double kappa_derivative; /* dA/dkappa */
  double span;             /* length for which the points and weights below are valid */
  int points;
  double distance[8 * MAX_PANELS]; /* s: distance in units of kappa */
  double weight[8 * MAX_PANELS];   /* quadrature weight times exp(-s) */
} integrator;

/* Value and two derivatives with respect to x at one end of a quintic polynomial. */
typedef struct {
  double f, f1, f2;
} jet;

/* Points and weights of Gauss-Legendre quadrature, 8 points on 0..1. */
static const double gauss_points[8] = {
    0.019855071751231884, 0.10166676129318664, 0.23723379504183550, 0.40828267875217511,
    0.59171732124782489,  0.76276620495816450, 0.89833323870681336, 0.98014492824876812};
static const double gauss_weight[8] = {
    0.050614268145188130, 0.11119051722668724, 0.15685332293894364, 0.18134189168918099,
    0.18134189168918099,  0.15685332293894364, 0.11119051722668724, 0.050614268145188130};

static integrator start_integrator(double kappa)
{
  /* For very negative x, L(x) = -1 - 1/x: asymptotic series of the exponential integral A + 1. */
  const double start_distance = ANHYST_X_MAX * 1.01;
  const double q = kappa / start_distance;
  integrator w;
  w.kappa = kappa;
  w.x = -start_distance;
  w.span = -1.0;
  w.points = 0;
  w.value = -1.0 + (1.0 - q * (1.0 - 2.0 * q * (1.0 - 3.0 * q))) / start_distance;
  w.slope = (1.0 - 2.0 * q * (1.0 - 3.0 * q)) / (start_distance * start_distance);
  w.kappa_derivative = -(1.0 - 4.0 * q * (1.0 - 4.5 * q)) / (start_distance * start_distance);
  return w;
}

/* Sets the quadrature points for 0 < s < span. The points are stored because most steps have the
   same span. At a span above the decay length, only the end of the step has an effect. L is almost
   linear there, so that one quadrature rule is sufficient for the whole step. */
static void set_quadrature_points(integrator *w, double span)
{
  if (span >= decay_length) {
    w->span = span;
    w->points = 8;
    for (int i = 0; i < 8; i++) {
      w->distance[i] = laguerre_points[i];
      w->weight[i] = laguerre_weight[i];
    }
    return;
  }
  const int panels = (int)(span / panel_length) + 1;
  const double width = span / panels;
  w->span = span;
  w->points = 8 * panels;
  for (int i = 0; i < w->points; i++) {
    const int earlier = i / 8; /* number of complete panels before this point */
    w->distance[i] = (earlier + gauss_points[i % 8]) * width;
    w->weight[i] = gauss_weight[i % 8] * width * anhyst_exp_f64(-w->distance[i]);
  }
}

static void advance_integrator(integrator *w, double x)
{
  const double length = (x - w->x) / w->kappa;
  const double span = length < decay_length ? length : decay_length;
  double value_gain = 0.0;
  double slope_gain = 0.0;
  double kappa_gain = 0.0;
  double slope;
  if (fabs(span - w->span) > 0.0) {
    set_quadrature_points(w, span);
  }
  for (int i = 0; i < w->points; i++) {
    value_gain += w->weight[i] * anhyst_langevin_f64(x - w->kappa * w->distance[i], &slope);
    slope_gain += w->weight[i] * slope;
    kappa_gain += w->weight[i] * w->distance[i] * slope;
  }
  const double decay = anhyst_exp_f64(-length);
  w->kappa_derivative = decay * (w->kappa_derivative - length * w->slope) - kappa_gain;
  w->slope = decay * w->slope + slope_gain;
  w->value = decay * w->value + value_gain;
  w->x = x;
}

static jet read_branch_value(const integrator *w)
{
  jet point;
  double slope;
  point.f = w->value;
  point.f1 = w->slope; /* not (L - A)/kappa, which loses digits if kappa is small */
  (void)anhyst_langevin_f64(w->x, &slope);
  point.f2 = (slope - point.f1) / w->kappa;
  return point;
}

static jet read_kappa_derivative(const integrator *w)
{
  const jet value = read_branch_value(w);
  jet point;
  point.f = w->kappa_derivative;
  point.f1 = (-value.f1 - point.f) / w->kappa;
  point.f2 = (-value.f2 - point.f1) / w->kappa;
  return point;
}

/* Converts derivatives over x to derivatives over the position t on a segment with the map x(t). */
static jet to_segment_derivatives(jet point, double x1, double x2)
{
  jet scaled;
  scaled.f = point.f;
  scaled.f1 = point.f1 * x1;
  scaled.f2 = point.f2 * x1 * x1 + point.f1 * x2;
  return scaled;
}

static void fit_quintic(jet p, jet q, double out[6])
{
  const double d = q.f - p.f;
  out[0] = p.f;
  out[1] = p.f1;
  out[2] = 0.5 * p.f2;
  out[3] = 10.0 * d - 6.0 * p.f1 - 4.0 * q.f1 - 1.5 * p.f2 + 0.5 * q.f2;
  out[4] = -15.0 * d + 8.0 * p.f1 + 7.0 * q.f1 + 1.5 * p.f2 - q.f2;
  out[5] = 6.0 * d - 3.0 * p.f1 - 3.0 * q.f1 - 0.5 * p.f2 + 0.5 * q.f2;
}

static double logarithmic_knot(int i)
{
  return ANHYST_BRANCH_EDGE * anhyst_exp_f64((double)i / ANHYST_BRANCH_INTERVALS_PER_LOG);
}

static jet to_logarithmic_segment(jet point, double x)
{
  const double x1 = x / ANHYST_BRANCH_INTERVALS_PER_LOG;
  return to_segment_derivatives(point, x1, x1 / ANHYST_BRANCH_INTERVALS_PER_LOG);
}

static int is_kappa_allowed(double kappa)
{
  return kappa >= ANHYST_KAPPA_MIN && kappa <= ANHYST_KAPPA_MAX;
}

static void store_polynomial(double piece[6], jet from, jet to)
{
  double exact[6];
  fit_quintic(from, to, exact);
  for (int i = 0; i < 6; i++) {
    piece[i] = (double)exact[i];
  }
}

/* Tabulates one function in double precision, for both number formats, once per parameter set. */
static void tabulate_branch(anhyst_pieces_f64 *pieces, double kappa,
                            jet (*read)(const integrator *))
{
  const double inner_width = 1.0 / ANHYST_BRANCH_INTERVALS_PER_UNIT;
  integrator w = start_integrator(kappa);
  double x = -logarithmic_knot(ANHYST_BRANCH_OUTER);
  advance_integrator(&w, x);
  jet previous = to_logarithmic_segment(read(&w), x);
  for (int i = ANHYST_BRANCH_OUTER - 1; i >= 0; i--) {
    x = -logarithmic_knot(i);
    advance_integrator(&w, x);
    const jet next = to_logarithmic_segment(read(&w), x);
    store_polynomial(pieces->left[i], next, previous);
    previous = next;
  }
  previous = to_segment_derivatives(read(&w), inner_width, 0.0);
  for (int i = 0; i < ANHYST_BRANCH_INNER; i++) {
    advance_integrator(&w, -ANHYST_BRANCH_EDGE + (i + 1) * inner_width);
    const jet next = to_segment_derivatives(read(&w), inner_width, 0.0);
    store_polynomial(pieces->inner[i], previous, next);
    previous = next;
  }
  previous = to_logarithmic_segment(read(&w), logarithmic_knot(0));
  for (int i = 0; i < ANHYST_BRANCH_OUTER; i++) {
    x = logarithmic_knot(i + 1);
    advance_integrator(&w, x);
    const jet next = to_logarithmic_segment(read(&w), x);
    store_polynomial(pieces->right[i], previous, next);
    previous = next;
  }
}

static double evaluate_polynomial(const double c[6], double t)
{
  return c[0] + t * (c[1] + t * (c[2] + t * (c[3] + t * (c[4] + t * c[5]))));
}

static double evaluate_table(const anhyst_pieces_f64 *pieces, double x)
{
  const double size = fabs(x);
  if (size < 30.0) {
    const double position = (x + 30.0) * (double)ANHYST_BRANCH_INTERVALS_PER_UNIT;
    const int i = (int)position;
    if (i < ANHYST_BRANCH_INNER) {
      return evaluate_polynomial(pieces->inner[i], position - (double)i);
    }
  }
  double position = anhyst_log_f64(size / 30.0) * (double)ANHYST_BRANCH_INTERVALS_PER_LOG;
  if (!(position > 0.0)) {
    position = 0.0;
  }
  if (!(position < (double)ANHYST_BRANCH_OUTER)) {
    position = (double)ANHYST_BRANCH_OUTER;
  }
  int i = (int)position;
  if (i == ANHYST_BRANCH_OUTER) {
    i--;
  }
  return evaluate_polynomial(x < 0.0 ? pieces->left[i] : pieces->right[i], position - (double)i);
}

anhyst_status anhyst_branch_build_f64(anhyst_branch_f64 *branch, double kappa)
{
  if (!is_kappa_allowed((double)kappa)) {
    return ANHYST_BAD_PARAMETER;
  }
  branch->kappa = kappa;
  tabulate_branch(&branch->value, (double)kappa, read_branch_value);
  return ANHYST_OK;
}

anhyst_status anhyst_branch_slope_build_f64(anhyst_branch_slope_f64 *slope, double kappa)
{
  if (!is_kappa_allowed((double)kappa)) {
    return ANHYST_BAD_PARAMETER;
  }
  tabulate_branch(&slope->value, (double)kappa, read_kappa_derivative);
  return ANHYST_OK;
}

double anhyst_branch_at_f64(const anhyst_branch_f64 *branch, double x)
{
  return evaluate_table(&branch->value, x);
}

double anhyst_branch_slope_at_f64(const anhyst_branch_slope_f64 *slope, double x)
{
  return evaluate_table(&slope->value, x);
}
