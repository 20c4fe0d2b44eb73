/* SPDX-License-Identifier: Apache-2.0 */
/* Layer j of N has a share phi_j of the section, a field H_j and a flux density B_j(H_j) of its
   own; S_j = sum_{k>=j} phi_k*B_k flows in it and deeper, S_1 = B in all. Against every change of
   what flows deeper, the layers between raise a field; what is laminated, a share l of the path,
   has the field H_l(B) that the whole flux asks for:

     H_{j-1} = H_j + g*(S_j - S_j,before),   g = eddy/(N - 1),   j = 2..N
     drive = l*H_l(B) + (1 - l)*H_1 + rho*B/mu0

   Each left side rises with its S, so that these are the conditions of the minimum of a convex
   function of all S_j. Newton's way to it solves a tridiagonal system a step; a step is shortened
   where the slope along it has turned round. */
#include "layers.h"

#include <float.h>
#include <math.h>

enum { STEPS = 200, HALVINGS = 30 };

/* Stiffness of an iron that is about to jump, in that of air: no layer is taken to be softer. */
#define SOFTEST 1e-9
/* What may be left of the equations where it no longer falls. */
#define CLOSE 1e-10
/* Parts of the law's scale that a flux density counts as at least: a law rounds in parts of it, and
   of tiny drives nothing else would be left. */
#define GRAIN 1e-2

typedef struct {
  const anhyst_iron_f64 *iron;
  const anhyst_memory_f64 *state;
  const anhyst_circuit_f64 *circuit;
  double drive;
  int flux_given;                   /* whether that of the first section, all of it, is known */
  double share[ANHYST_LAYERS_MAX];  /* phi_j */
  double before[ANHYST_LAYERS_MAX]; /* S_j of the state */
  anhyst_reaction_f64 *reaction;
  double field[ANHYST_MEMORIES_MAX];     /* H_j, then H_l */
  double stiffness[ANHYST_MEMORIES_MAX]; /* dH/dB of these */
} problem;

/* The first section whose flux is unknown. */
static int first_of(const problem *of) { return of->flux_given ? 1 : 0; }

/* The field that a flux density asks for in one layer, or in what is laminated. */
static anhyst_status look(problem *of, int at, double flux)
{
  const anhyst_iron_f64 *iron = of->iron;
  anhyst_solution_f64 *found = &of->reaction->solution[at];
  const double coupled = (1.0 - iron->interaction) * iron->saturation;
  const anhyst_status status =
      iron->law->solve(iron->parameters, &of->state[at], coupled / iron->shape,
                       flux / (ANHYST_MU0 * iron->shape), found);
  if (status != ANHYST_OK) {
    return status;
  }
  const double own = iron->interaction * iron->saturation;
  const double stiffness =
      (iron->shape - own * found->slope) / (iron->shape + coupled * found->slope);
  of->field[at] = iron->shape * found->x - own * found->m;
  of->stiffness[at] = (stiffness > SOFTEST ? stiffness : SOFTEST) / ANHYST_MU0;
  return ANHYST_OK;
}

/* The fields for the fluxes of all sections, and what they leave of the equations. */
static anhyst_status residuals(problem *of, const double *section, double *left)
{
  const int layers = of->iron->layers;
  const double laminated = of->iron->laminated;
  const double held = of->circuit->eddy / (layers - 1);
  for (int j = 0; j < layers; j++) {
    const double deeper = j + 1 < layers ? section[j + 1] : 0.0;
    const anhyst_status status = look(of, j, (section[j] - deeper) / of->share[j]);
    if (status != ANHYST_OK) {
      return status;
    }
  }
  const anhyst_status status = look(of, layers, section[0]);
  if (status != ANHYST_OK) {
    return status;
  }
  left[0] = laminated * of->field[layers] + (1.0 - laminated) * of->field[0] +
            of->circuit->gap_ratio * section[0] / ANHYST_MU0 - of->drive;
  for (int j = 1; j < layers; j++) {
    left[j] =
        (1.0 - laminated) * (of->field[j] - of->field[j - 1] + held * (section[j] - of->before[j]));
  }
  return ANHYST_OK;
}

/* Newton's step: the tridiagonal system, eliminated from the middle outwards. */
static void newton(const problem *of, const double *left, double *step)
{
  const int layers = of->iron->layers;
  const double solid = 1.0 - of->iron->laminated;
  const double held = of->circuit->eddy / (layers - 1);
  double pivot[ANHYST_LAYERS_MAX];
  double right[ANHYST_LAYERS_MAX];
  double inner[ANHYST_LAYERS_MAX]; /* between a section and the next deeper one */
  for (int j = layers - 1; j >= first_of(of); j--) {
    inner[j] = solid * of->stiffness[j] / of->share[j];
    pivot[j] = inner[j] + (j > 0 ? solid * (held + of->stiffness[j - 1] / of->share[j - 1])
                                 : of->iron->laminated * of->stiffness[layers] +
                                       of->circuit->gap_ratio / ANHYST_MU0);
    right[j] = -left[j];
    if (j + 1 < layers) {
      pivot[j] -= inner[j] * inner[j] / pivot[j + 1];
      right[j] += inner[j] * right[j + 1] / pivot[j + 1];
    }
  }
  for (int j = first_of(of); j < layers; j++) {
    step[j] = right[j] / pivot[j];
    if (j > first_of(of)) {
      step[j] += inner[j - 1] * step[j - 1] / pivot[j];
    }
  }
}

static double along(const problem *of, const double *left, const double *step)
{
  double sum = 0.0;
  for (int j = first_of(of); j < of->iron->layers; j++) {
    sum += left[j] * step[j];
  }
  return sum;
}

static double larger(double one, double other) { return one > other ? one : other; }

/* The largest of what is left, in parts of the fields and of the fluxes' share in them. */
static double size_of(const problem *of, const double *left, const double *section)
{
  const double grain = GRAIN * ANHYST_MU0 * of->iron->saturation * of->iron->grain;
  double most = fabs(of->drive) + of->circuit->gap_ratio * fabs(section[0]) / ANHYST_MU0;
  double largest = 0.0;
  for (int j = 0; j < of->iron->layers; j++) {
    most = larger(most, fabs(of->field[j]) + fabs(section[j]) * of->stiffness[j] / of->share[j]);
    most = larger(most, of->circuit->eddy * fabs(section[j]));
    most = larger(most, grain * of->stiffness[j] / of->share[j]);
  }
  for (int j = first_of(of); j < of->iron->layers; j++) {
    largest = larger(largest, fabs(left[j]));
  }
  return largest > 0.0 ? largest / most : 0.0;
}

static void go(const problem *of, const double *start, const double *step, double part,
               double *section)
{
  for (int j = first_of(of); j < of->iron->layers; j++) {
    section[j] = start[j] + part * step[j];
  }
}

/* Goes along a step to where the slope has fallen to half or turned round by less, or to its end.
 */
static anhyst_status advance(problem *of, double *section, double *left, const double *step)
{
  const double begin = along(of, left, step);
  double start[ANHYST_LAYERS_MAX] = {0};
  double low = 0.0;
  double high = 1.0;
  double part = 1.0;
  for (int j = 0; j < of->iron->layers; j++) {
    start[j] = section[j];
  }
  for (int i = 0; i < HALVINGS; i++) {
    go(of, start, step, part, section);
    const anhyst_status status = residuals(of, section, left);
    const double slope = status == ANHYST_OK ? along(of, left, step) : -begin;
    /* Where the law's range ends on the way, what lies before is progress enough. */
    if (status != ANHYST_OK && (low > 0.0 || i + 1 == HALVINGS)) {
      go(of, start, step, low, section);
      return low > 0.0 ? residuals(of, section, left) : status;
    }
    if (status == ANHYST_OK && slope <= -0.5 * begin && (slope >= 0.5 * begin || part >= 1.0)) {
      return ANHYST_OK;
    }
    if (status == ANHYST_OK && size_of(of, left, section) <= CLOSE) {
      return ANHYST_OK; /* slopes are those of rounding */
    }
    if (slope < 0.0) {
      low = part;
    } else {
      high = part;
    }
    part = 0.5 * (low + high);
  }
  return ANHYST_OK;
}

/* Written so that NaN fails too: the equations' sizes do not show it. */
static int is_finite(const anhyst_circuit_f64 *circuit, double given)
{
  return circuit->gap_ratio <= 1e30 && circuit->eddy <= 1e30 && fabs(given) <= 1e30;
}

static anhyst_status solve(problem *of, double *section)
{
  double left[ANHYST_LAYERS_MAX] = {0};
  double step[ANHYST_LAYERS_MAX] = {0};
  anhyst_status status = residuals(of, section, left);
  double last = HUGE_VAL;
  for (int i = 0; i < STEPS && status == ANHYST_OK; i++) {
    const double size = size_of(of, left, section);
    if (size <= 64.0 * DBL_EPSILON || (size <= CLOSE && size >= 0.75 * last)) {
      return ANHYST_OK;
    }
    last = size;
    newton(of, left, step);
    status = advance(of, section, left, step);
  }
  if (status != ANHYST_OK) {
    return status;
  }
  return size_of(of, left, section) <= CLOSE ? ANHYST_OK : ANHYST_NOT_CONVERGED;
}

/* Shares of the section and the fluxes of the state, from which the search sets out. */
static void begin(problem *of, double *section)
{
  const anhyst_iron_f64 *iron = of->iron;
  double flux = 0.0;
  for (int j = iron->layers - 1; j >= 0; j--) {
    double x;
    double m;
    of->share[j] = j == 0 ? iron->surface : (1.0 - iron->surface) / (iron->layers - 1);
    iron->law->read(iron->parameters, &of->state[j], &x, &m);
    flux += of->share[j] * anhyst_flux_from_f64(iron, x, m);
    of->before[j] = flux;
    section[j] = flux;
  }
}

anhyst_status anhyst_layers_forward_f64(const anhyst_iron_f64 *iron, const anhyst_memory_f64 *state,
                                        const anhyst_circuit_f64 *circuit, double drive,
                                        anhyst_reaction_f64 *reaction)
{
  problem of = {iron, state, circuit, drive, 0, {0}, {0}, reaction, {0}, {0}};
  double section[ANHYST_LAYERS_MAX];
  if (!is_finite(circuit, drive)) {
    return ANHYST_OUT_OF_RANGE;
  }
  begin(&of, section);
  const anhyst_status status = solve(&of, section);
  reaction->drive = drive;
  reaction->flux = section[0];
  reaction->field =
      iron->laminated * of.field[iron->layers] + (1.0 - iron->laminated) * of.field[0];
  return status;
}

anhyst_status anhyst_layers_inverse_f64(const anhyst_iron_f64 *iron, const anhyst_memory_f64 *state,
                                        const anhyst_circuit_f64 *circuit, double flux,
                                        anhyst_reaction_f64 *reaction)
{
  problem of = {iron, state, circuit, 0.0, 1, {0}, {0}, reaction, {0}, {0}};
  double section[ANHYST_LAYERS_MAX];
  if (!is_finite(circuit, flux)) {
    return ANHYST_OUT_OF_RANGE;
  }
  begin(&of, section);
  section[0] = flux;
  const anhyst_status status = solve(&of, section);
  reaction->flux = flux;
  reaction->field =
      iron->laminated * of.field[iron->layers] + (1.0 - iron->laminated) * of.field[0];
  reaction->drive = reaction->field + circuit->gap_ratio * flux / ANHYST_MU0;
  if (status != ANHYST_OK) {
    return status;
  }
  return fabs(reaction->drive) <= 1e30 ? ANHYST_OK : ANHYST_OUT_OF_RANGE;
}
