/* SPDX-License-Identifier: Apache-2.0 */
/* Solid core. Layer j of N has the fraction phi_j of the cross-section, a field H_j and the flux
   density B_j(H_j). S_j = sum_{k>=j} phi_k*B_k is the flux in layer j and all deeper layers. S_1 =
   B is the total flux. Eddy currents between the layers cause a field that opposes every change of
   the flux of the deeper layers; d_j is the fraction of gamma between the layers j - 1 and j
   (circuit.h). The laminated part, a fraction l of the path, has the field H_l(B):

     H_{j-1} = H_j + d_j*eddy*(S_j - S_j,before),   j = 2..N
     drive = l*H_l(B) + (1 - l)*H_1 + rho*B/mu0

   The field in each equation rises with its S_j. Therefore, the equations are the conditions for
   the minimum of a convex function of all S_j. Each Newton step solves a tridiagonal system. A step
   is shortened if the slope along the step changes its sign. */
#include "layers.h"

#include <float.h>
#include <math.h>

enum { MAX_STEPS = 200, MAX_BISECTIONS = 30 };

/* Smallest slope dH/dB of a layer, times mu0. The slope is less if the iron is about to jump. */
#define MIN_FIELD_SLOPE 1e-9
/* Largest relative residual that is accepted if it no longer decreases. */
#define MAX_RESIDUAL 1e-10
/* Smallest scale of a flux density, as a fraction of the law's scale. A law rounds relative to its
   own scale, and this rounding would dominate tiny drives. */
#define MIN_FLUX_SCALE 1e-2

typedef struct {
  const anhyst_iron_f64 *iron;
  const anhyst_memory_f64 *state;
  const anhyst_circuit_f64 *circuit;
  double drive;
  int flux_given;                       /* whether the total flux is given */
  const double *area_fraction;          /* phi_j */
  double eddy_slope[ANHYST_LAYERS_MAX]; /* d_j*eddy */
  double start_flux[ANHYST_LAYERS_MAX]; /* S_j of the initial state */
  anhyst_reaction_f64 *reaction;
  double field[ANHYST_MEMORIES_MAX];       /* fields H_j, then H_l */
  double field_slope[ANHYST_MEMORIES_MAX]; /* dH/dB of each layer and of the laminated part */
} layer_problem;

static int first_unknown(const layer_problem *problem) { return problem->flux_given ? 1 : 0; }

/* Solves for the field at a flux density, in one layer or in the laminated part. */
static anhyst_status solve_layer(layer_problem *problem, int at, double flux)
{
  const anhyst_iron_f64 *iron = problem->iron;
  anhyst_solution_f64 *found = &problem->reaction->solution[at];
  const double coupled = (1.0 - iron->interaction) * iron->saturation;
  const anhyst_status status =
      iron->law->solve(iron->parameters, &problem->state[at], coupled / iron->shape,
                       flux / (ANHYST_MU0 * iron->shape), found);
  if (status != ANHYST_OK) {
    return status;
  }
  const double self_coupling = iron->interaction * iron->saturation;
  const double field_slope =
      (iron->shape - self_coupling * found->slope) / (iron->shape + coupled * found->slope);
  problem->field[at] = iron->shape * found->x - self_coupling * found->m;
  problem->field_slope[at] =
      (field_slope > MIN_FIELD_SLOPE ? field_slope : MIN_FIELD_SLOPE) / ANHYST_MU0;
  return ANHYST_OK;
}

/* Computes the fields for the fluxes of all sections, and the residuals of the equations. */
static anhyst_status compute_residuals(layer_problem *problem, const double *section,
                                       double *residual)
{
  const int layers = problem->iron->layers;
  const double laminated = problem->iron->laminated_fraction;
  for (int j = 0; j < layers; j++) {
    const double deeper = j + 1 < layers ? section[j + 1] : 0.0;
    const anhyst_status status =
        solve_layer(problem, j, (section[j] - deeper) / problem->area_fraction[j]);
    if (status != ANHYST_OK) {
      return status;
    }
  }
  const anhyst_status status = solve_layer(problem, layers, section[0]);
  if (status != ANHYST_OK) {
    return status;
  }
  residual[0] = laminated * problem->field[layers] + (1.0 - laminated) * problem->field[0] +
                problem->circuit->gap_ratio * section[0] / ANHYST_MU0 - problem->drive;
  for (int j = 1; j < layers; j++) {
    residual[j] =
        (1.0 - laminated) * (problem->field[j] - problem->field[j - 1] +
                             problem->eddy_slope[j] * (section[j] - problem->start_flux[j]));
  }
  return ANHYST_OK;
}

/* Computes the Newton step. Eliminates the tridiagonal system from the middle outwards. */
static void compute_newton_step(const layer_problem *problem, const double *residual, double *step)
{
  const int layers = problem->iron->layers;
  const double solid = 1.0 - problem->iron->laminated_fraction;
  double pivot[ANHYST_LAYERS_MAX];
  double right[ANHYST_LAYERS_MAX];
  double inner[ANHYST_LAYERS_MAX]; /* coupling between a section and the next deeper section */
  for (int j = layers - 1; j >= first_unknown(problem); j--) {
    inner[j] = solid * problem->field_slope[j] / problem->area_fraction[j];
    pivot[j] =
        inner[j] + (j > 0 ? solid * (problem->eddy_slope[j] +
                                     problem->field_slope[j - 1] / problem->area_fraction[j - 1])
                          : problem->iron->laminated_fraction * problem->field_slope[layers] +
                                problem->circuit->gap_ratio / ANHYST_MU0);
    right[j] = -residual[j];
    if (j + 1 < layers) {
      pivot[j] -= inner[j] * inner[j] / pivot[j + 1];
      right[j] += inner[j] * right[j + 1] / pivot[j + 1];
    }
  }
  for (int j = first_unknown(problem); j < layers; j++) {
    step[j] = right[j] / pivot[j];
    if (j > first_unknown(problem)) {
      step[j] += inner[j - 1] * step[j - 1] / pivot[j];
    }
  }
}

static double directional_slope(const layer_problem *problem, const double *residual,
                                const double *step)
{
  double sum = 0.0;
  for (int j = first_unknown(problem); j < problem->iron->layers; j++) {
    sum += residual[j] * step[j];
  }
  return sum;
}

static double larger_of(double a, double b) { return a > b ? a : b; }

/* Returns the largest residual, relative to the fields and to the effect of the fluxes on them. */
static double relative_residual(const layer_problem *problem, const double *residual,
                                const double *section)
{
  const double grain =
      MIN_FLUX_SCALE * ANHYST_MU0 * problem->iron->saturation * problem->iron->state_scale;
  double scale = fabs(problem->drive) + problem->circuit->gap_ratio * fabs(section[0]) / ANHYST_MU0;
  double largest = 0.0;
  for (int j = 0; j < problem->iron->layers; j++) {
    scale = larger_of(scale, fabs(problem->field[j]) + fabs(section[j]) * problem->field_slope[j] /
                                                           problem->area_fraction[j]);
    scale = larger_of(scale, problem->circuit->eddy * fabs(section[j]));
    scale = larger_of(scale, grain * problem->field_slope[j] / problem->area_fraction[j]);
  }
  for (int j = first_unknown(problem); j < problem->iron->layers; j++) {
    largest = larger_of(largest, fabs(residual[j]));
  }
  return largest > 0.0 ? largest / scale : 0.0;
}

static void set_sections(const layer_problem *problem, const double *start, const double *step,
                         double fraction, double *section)
{
  for (int j = first_unknown(problem); j < problem->iron->layers; j++) {
    section[j] = start[j] + fraction * step[j];
  }
}

/* Line search: moves along a step until |slope| has at least halved, or to the end of the step. */
static anhyst_status search_along_step(layer_problem *problem, double *section, double *residual,
                                       const double *step)
{
  const double start_slope = directional_slope(problem, residual, step);
  double start[ANHYST_LAYERS_MAX] = {0};
  double low = 0.0;
  double high = 1.0;
  double fraction = 1.0;
  for (int j = 0; j < problem->iron->layers; j++) {
    start[j] = section[j];
  }
  for (int i = 0; i < MAX_BISECTIONS; i++) {
    set_sections(problem, start, step, fraction, section);
    const anhyst_status status = compute_residuals(problem, section, residual);
    const double slope =
        status == ANHYST_OK ? directional_slope(problem, residual, step) : -start_slope;
    /* The end of the step is outside the law's range. Positions inside are accepted. */
    if (status != ANHYST_OK && (low > 0.0 || i + 1 == MAX_BISECTIONS)) {
      set_sections(problem, start, step, low, section);
      return low > 0.0 ? compute_residuals(problem, section, residual) : status;
    }
    if (status == ANHYST_OK && slope <= -0.5 * start_slope &&
        (slope >= 0.5 * start_slope || fraction >= 1.0)) {
      return ANHYST_OK;
    }
    if (status == ANHYST_OK && relative_residual(problem, residual, section) <= MAX_RESIDUAL) {
      return ANHYST_OK; /* the slopes are only rounding errors */
    }
    if (slope < 0.0) {
      low = fraction;
    } else {
      high = fraction;
    }
    fraction = 0.5 * (low + high);
  }
  return ANHYST_OK;
}

/* Returns whether circuit and input are finite. Rejects NaN, because residuals do not show it. */
static int are_inputs_finite(const anhyst_circuit_f64 *circuit, double given)
{
  return circuit->gap_ratio <= 1e30 && circuit->eddy <= 1e30 && fabs(given) <= 1e30;
}

static anhyst_status solve_sections(layer_problem *problem, double *section)
{
  double residual[ANHYST_LAYERS_MAX] = {0};
  double step[ANHYST_LAYERS_MAX] = {0};
  anhyst_status status = compute_residuals(problem, section, residual);
  double last_norm = HUGE_VAL;
  for (int i = 0; i < MAX_STEPS && status == ANHYST_OK; i++) {
    const double norm = relative_residual(problem, residual, section);
    if (norm <= 64.0 * DBL_EPSILON || (norm <= MAX_RESIDUAL && norm >= 0.75 * last_norm)) {
      return ANHYST_OK;
    }
    last_norm = norm;
    compute_newton_step(problem, residual, step);
    status = search_along_step(problem, section, residual, step);
  }
  if (status != ANHYST_OK) {
    return status;
  }
  return relative_residual(problem, residual, section) <= MAX_RESIDUAL ? ANHYST_OK
                                                                       : ANHYST_NOT_CONVERGED;
}

/* Sets the effect of the eddy currents, and starts the search at the fluxes of the state. */
static void init_layer_problem(layer_problem *problem, double *section)
{
  const anhyst_iron_f64 *iron = problem->iron;
  double flux = 0.0;
  for (int j = iron->layers - 1; j >= 0; j--) {
    double x;
    double m;
    problem->eddy_slope[j] = iron->diffusion_fraction[j] * problem->circuit->eddy;
    iron->law->read(iron->parameters, &problem->state[j], &x, &m);
    flux += problem->area_fraction[j] * anhyst_flux_from_f64(iron, x, m);
    problem->start_flux[j] = flux;
    section[j] = flux;
  }
}

anhyst_status anhyst_layers_forward_f64(const anhyst_iron_f64 *iron, const anhyst_memory_f64 *state,
                                        const anhyst_circuit_f64 *circuit, double drive,
                                        anhyst_reaction_f64 *reaction)
{
  layer_problem problem = {iron, state, circuit,  drive, 0,  iron->area_fraction,
                           {0},  {0},   reaction, {0},   {0}};
  double section[ANHYST_LAYERS_MAX];
  if (!are_inputs_finite(circuit, drive)) {
    return ANHYST_OUT_OF_RANGE;
  }
  init_layer_problem(&problem, section);
  const anhyst_status status = solve_sections(&problem, section);
  reaction->drive = drive;
  reaction->flux = section[0];
  reaction->field = iron->laminated_fraction * problem.field[iron->layers] +
                    (1.0 - iron->laminated_fraction) * problem.field[0];
  return status;
}

anhyst_status anhyst_layers_inverse_f64(const anhyst_iron_f64 *iron, const anhyst_memory_f64 *state,
                                        const anhyst_circuit_f64 *circuit, double flux,
                                        anhyst_reaction_f64 *reaction)
{
  layer_problem problem = {iron, state, circuit,  0.0, 1,  iron->area_fraction,
                           {0},  {0},   reaction, {0}, {0}};
  double section[ANHYST_LAYERS_MAX];
  if (!are_inputs_finite(circuit, flux)) {
    return ANHYST_OUT_OF_RANGE;
  }
  init_layer_problem(&problem, section);
  section[0] = flux;
  const anhyst_status status = solve_sections(&problem, section);
  reaction->flux = flux;
  reaction->field = iron->laminated_fraction * problem.field[iron->layers] +
                    (1.0 - iron->laminated_fraction) * problem.field[0];
  reaction->drive = reaction->field + circuit->gap_ratio * flux / ANHYST_MU0;
  if (status != ANHYST_OK) {
    return status;
  }
  return fabs(reaction->drive) <= 1e30 ? ANHYST_OK : ANHYST_OUT_OF_RANGE;
}
