/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/law/circuit.h"

#include <float.h>
#include <math.h>

#include "layers.h"

/* Maximum number of solutions for one excess loss. */
enum { MAX_EXCESS_STEPS = 50 };
/* Number of bisections for the thickness ratio of layers. */
enum { RATIO_BISECTIONS = 80 };

/* The comparisons in this function also reject NaN and infinity. */
static int is_iron_valid(const anhyst_iron_f64 *iron)
{
  return iron->saturation > 0.0 && iron->shape > 0.0 && iron->interaction < 1.0 &&
         (1.0 - iron->interaction) * (iron->saturation / iron->shape) < 1e12;
}

anhyst_status anhyst_iron_init_f64(anhyst_iron_f64 *iron, anhyst_operator_f64 *law,
                                   anhyst_step step, double saturation, double shape,
                                   double pinning, double reversibility, double interaction,
                                   double play_width, const anhyst_branch_f64 *branch)
{
  iron->law = &anhyst_law_lag_f64;
  iron->parameters = law;
  iron->saturation = saturation;
  iron->shape = shape;
  iron->interaction = interaction;
  iron->state_scale = 1.0;
  iron->layers = 1;
  iron->laminated_fraction = 0.0;
  iron->leaky_fraction = 0.0;
  iron->leaky_delay = 0.0;
  iron->excess = 0.0;
  if (!is_iron_valid(iron)) {
    return ANHYST_BAD_PARAMETER;
  }
  law->step = step;
  law->kappa = pinning / shape;
  law->c = reversibility;
  law->play = play_width / shape;
  law->eps = step == ANHYST_STEP_JA1986 ? interaction * reversibility * saturation / shape : 0.0;
  law->branch = branch;
  return anhyst_operator_check_f64(law);
}

anhyst_status anhyst_iron_of_cells_f64(anhyst_iron_f64 *iron, const anhyst_cells_f64 *cells,
                                       double interaction)
{
  iron->law = &anhyst_law_cells_f64;
  iron->parameters = cells;
  iron->saturation = 1.0;
  iron->shape = 1.0;
  iron->interaction = interaction;
  iron->state_scale = cells->scale;
  iron->layers = 1;
  iron->laminated_fraction = 0.0;
  iron->leaky_fraction = 0.0;
  iron->leaky_delay = 0.0;
  iron->excess = 0.0;
  return is_iron_valid(iron) ? ANHYST_OK : ANHYST_BAD_PARAMETER;
}

/* Returns the sum of a geometric series that starts with 1. */
static double geometric_sum(double ratio, int count)
{
  double sum = 0.0;
  for (int i = 0; i < count; i++) {
    sum = 1.0 + ratio * sum;
  }
  return sum;
}

/* Returns the ratio of the thicknesses of neighbouring layers. */
static double thickness_ratio(int layers, double surface)
{
  double low = 0.0;
  double high = 1.0 / surface;
  for (int i = 0; i < RATIO_BISECTIONS; i++) {
    const double middle = 0.5 * (low + high);
    if (surface * geometric_sum(middle, layers) < 1.0) {
      low = middle;
    } else {
      high = middle;
    }
  }
  return 0.5 * (low + high);
}

static void set_thickness(anhyst_iron_f64 *iron, double surface)
{
  const int layers = iron->layers;
  const double ratio = layers > 1 ? thickness_ratio(layers, surface) : 1.0;
  double fraction = 1.0 / geometric_sum(ratio, layers);
  /* The middles of the first and the last layer are half of these layers from the faces. */
  double depth = 1.0 - 0.5 * fraction;
  iron->area_fraction[0] = fraction;
  iron->diffusion_fraction[0] = 0.0;
  for (int j = 1; j < layers; j++) {
    fraction *= ratio;
    iron->area_fraction[j] = fraction;
  }
  depth -= 0.5 * fraction;
  for (int j = 1; j < layers; j++) {
    iron->diffusion_fraction[j] =
        0.5 * (iron->area_fraction[j - 1] + iron->area_fraction[j]) / depth;
  }
}

anhyst_status anhyst_iron_layers_f64(anhyst_iron_f64 *iron, int layers, double surface,
                                     double laminated)
{
  if (layers < 1 || layers > ANHYST_LAYERS_MAX || !(surface > 0.0 && surface <= 1.0) ||
      (layers > 1 && (surface == 1.0 || iron->leaky_fraction > 0.0 || iron->excess > 0.0)) ||
      !(laminated >= 0.0 && laminated < 1.0)) {
    return ANHYST_BAD_PARAMETER;
  }
  iron->layers = layers;
  iron->laminated_fraction = laminated;
  set_thickness(iron, surface);
  return ANHYST_OK;
}

anhyst_status anhyst_iron_eddy_circuit_f64(anhyst_iron_f64 *iron, double leaky, double leaky_delay,
                                           double excess)
{
  if (iron->layers > 1 || !(leaky >= 0.0 && leaky <= 1.0) ||
      !(leaky_delay >= 0.0 && leaky_delay <= 1e30) || !(excess >= 0.0 && excess <= 1e30)) {
    return ANHYST_BAD_PARAMETER;
  }
  iron->leaky_fraction = leaky;
  iron->leaky_delay = leaky_delay;
  iron->excess = excess;
  return ANHYST_OK;
}

int anhyst_hysteresis_memories_f64(const anhyst_iron_f64 *iron)
{
  return iron->layers > 1 ? iron->layers + 1 : 1;
}

int anhyst_memories_f64(const anhyst_iron_f64 *iron)
{
  return anhyst_hysteresis_memories_f64(iron) + (iron->leaky_fraction > 0.0 ? 1 : 0);
}

double anhyst_flux_from_f64(const anhyst_iron_f64 *iron, double x, double m)
{
  return ANHYST_MU0 * (iron->shape * x + (1.0 - iron->interaction) * iron->saturation * m);
}

double anhyst_flux_of_f64(const anhyst_iron_f64 *iron, const anhyst_memory_f64 *state)
{
  if (iron->layers > 1) { /* the laminated part carries the flux of all layers */
    state += iron->layers;
  }
  double x;
  double m;
  iron->law->read(iron->parameters, state, &x, &m);
  return anhyst_flux_from_f64(iron, x, m);
}

void anhyst_accept_f64(const anhyst_iron_f64 *iron, anhyst_memory_f64 *state,
                       const anhyst_reaction_f64 *reaction)
{
  const int memories = anhyst_hysteresis_memories_f64(iron);
  for (int i = 0; i < memories; i++) {
    iron->law->accept(iron->parameters, &state[i], &reaction->solution[i]);
  }
  if (iron->leaky_fraction > 0.0) {
    state[memories].flux = reaction->ring_flux;
  }
}

/* The linear eddy field of one step as a line over the flux density: slope*B - constant. */
typedef struct {
  double slope;      /* A/(m T) */
  double constant;   /* A/m */
  double start_flux; /* flux density of the state, T; 0 if the circuit has no eddy currents */
  double ring_flux;  /* flux density inside the leaky ring before the step, T */
} eddy_line;

static eddy_line eddy_line_of(const anhyst_iron_f64 *iron, const anhyst_memory_f64 *state,
                              double eddy)
{
  eddy_line line = {eddy, 0.0, 0.0, 0.0};
  if (eddy > 0.0) {
    line.start_flux = anhyst_flux_of_f64(iron, state);
    line.constant = eddy * line.start_flux;
  }
  if (iron->leaky_fraction > 0.0) {
    const double free = (1.0 - iron->leaky_fraction) * eddy;
    const double leaky = iron->leaky_fraction * eddy / (1.0 + iron->leaky_delay * eddy);
    line.ring_flux = state[1].flux;
    line.slope = free + leaky;
    line.constant = free * line.start_flux + leaky * line.ring_flux;
  }
  return line;
}

static double excess_field(const anhyst_iron_f64 *iron, double eddy, double flux_change)
{
  return copysign(iron->excess * sqrt(eddy * fabs(flux_change)), flux_change);
}

/* Returns the flux density inside the ring after a step, where T*dZ/dt = B - Z. */
static double ring_flux_after(const anhyst_iron_f64 *iron, const eddy_line *line, double eddy,
                              double flux)
{
  const double delay = iron->leaky_delay * eddy;
  return (flux + delay * line->ring_flux) / (1.0 + delay);
}

/* Solves a core with one layer for a drive, with a line for the whole eddy field. */
static anhyst_status solve_with_line(const anhyst_iron_f64 *iron, const anhyst_memory_f64 *state,
                                     double gap_ratio, double slope, double drive,
                                     anhyst_reaction_f64 *reaction)
{
  const double load = gap_ratio + slope * ANHYST_MU0;
  const double omega = (load / (1.0 + load) - iron->interaction) * (iron->saturation / iron->shape);
  const double r = drive / ((1.0 + load) * iron->shape);
  anhyst_solution_f64 *found = reaction->solution;
  const anhyst_status status = iron->law->solve(iron->parameters, state, omega, r, found);
  if (status == ANHYST_OK) {
    reaction->flux = anhyst_flux_from_f64(iron, found->x, found->m);
  }
  return status;
}

/* Solves a core with an excess loss. The excess field is a line through the start of the step, and
   its slope is corrected. For a mean slope A of everything else, the change D of the flux obeys
   A*D + excess*sqrt(eddy*D) = surplus, the drive that the state before the step does not need. */
static anhyst_status solve_with_excess(const anhyst_iron_f64 *iron, const anhyst_memory_f64 *state,
                                       const anhyst_circuit_f64 *circuit, const eddy_line *line,
                                       double drive, anhyst_reaction_f64 *reaction)
{
  double x;
  double m;
  iron->law->read(iron->parameters, state, &x, &m);
  const double start_drive = iron->shape * x - iron->interaction * iron->saturation * m +
                             circuit->gap_ratio * line->start_flux / ANHYST_MU0 +
                             line->slope * line->start_flux - line->constant;
  const double surplus = fabs(drive - start_drive);
  const double root_slope = iron->excess * sqrt(circuit->eddy);
  double change = 0.0;
  double secant = 0.0;
  anhyst_status status = solve_with_line(iron, state, circuit->gap_ratio, line->slope,
                                         drive + line->constant, reaction);
  for (int i = 0; i < MAX_EXCESS_STEPS && status == ANHYST_OK; i++) {
    const double next_change = fabs(reaction->flux - line->start_flux);
    if (next_change <= DBL_EPSILON * fabs(line->start_flux) ||
        fabs(next_change - change) <= 1e-12 * next_change) {
      return ANHYST_OK;
    }
    change = next_change;
    const double other_slope = surplus / change - secant;
    const double positive_slope = other_slope > 0.0 ? other_slope : 0.0;
    const double root =
        2.0 * surplus /
        (root_slope + sqrt(root_slope * root_slope + 4.0 * positive_slope * surplus));
    secant = root_slope / root;
    status = solve_with_line(iron, state, circuit->gap_ratio, line->slope + secant,
                             drive + line->constant + secant * line->start_flux, reaction);
  }
  return status;
}

anhyst_status anhyst_forward_f64(const anhyst_iron_f64 *iron, const anhyst_memory_f64 *state,
                                 const anhyst_circuit_f64 *circuit, double drive,
                                 anhyst_reaction_f64 *reaction)
{
  if (iron->layers > 1) {
    return anhyst_layers_forward_f64(iron, state, circuit, drive, reaction);
  }
  const eddy_line line = eddy_line_of(iron, state, circuit->eddy);
  const anhyst_status status = iron->excess > 0.0 && circuit->eddy > 0.0
                                   ? solve_with_excess(iron, state, circuit, &line, drive, reaction)
                                   : solve_with_line(iron, state, circuit->gap_ratio, line.slope,
                                                     drive + line.constant, reaction);
  if (status != ANHYST_OK) {
    return status;
  }
  const anhyst_solution_f64 *found = reaction->solution;
  reaction->drive = drive;
  reaction->field = iron->shape * found->x - iron->interaction * iron->saturation * found->m;
  reaction->ring_flux = ring_flux_after(iron, &line, circuit->eddy, reaction->flux);
  return ANHYST_OK;
}

anhyst_status anhyst_inverse_f64(const anhyst_iron_f64 *iron, const anhyst_memory_f64 *state,
                                 const anhyst_circuit_f64 *circuit, double flux,
                                 anhyst_reaction_f64 *reaction)
{
  if (iron->layers > 1) {
    return anhyst_layers_inverse_f64(iron, state, circuit, flux, reaction);
  }
  const double omega = (1.0 - iron->interaction) * (iron->saturation / iron->shape);
  const double total_field = flux / ANHYST_MU0;
  anhyst_solution_f64 *found = reaction->solution;
  const anhyst_status status =
      iron->law->solve(iron->parameters, state, omega, total_field / iron->shape, found);
  if (status != ANHYST_OK) {
    return status;
  }
  const eddy_line line = eddy_line_of(iron, state, circuit->eddy);
  reaction->field = iron->shape * found->x - iron->interaction * iron->saturation * found->m;
  reaction->flux = flux;
  reaction->ring_flux = ring_flux_after(iron, &line, circuit->eddy, flux);
  reaction->drive = reaction->field + circuit->gap_ratio * total_field +
                    (line.slope * flux - line.constant) +
                    excess_field(iron, circuit->eddy, flux - line.start_flux);
  /* The solver does not use the circuit, so that an infinite or NaN circuit appears only here. */
  return fabs(reaction->drive) <= 1e30 ? ANHYST_OK : ANHYST_OUT_OF_RANGE;
}

anhyst_status anhyst_commit_f64(const anhyst_iron_f64 *iron, anhyst_memory_f64 *state,
                                const anhyst_circuit_f64 *circuit, double applied_drive)
{
  anhyst_reaction_f64 reaction;
  const anhyst_status status = anhyst_forward_f64(iron, state, circuit, applied_drive, &reaction);
  if (status == ANHYST_OK) {
    anhyst_accept_f64(iron, state, &reaction);
  }
  return status;
}

anhyst_status anhyst_record_f64(const anhyst_iron_f64 *iron, anhyst_memory_f64 *state, int inverse,
                                size_t n, const double *given, const double *rho,
                                const double *eddy, double *found, double *field, size_t *index)
{
  for (size_t i = 0; i < n; i++) {
    anhyst_circuit_f64 circuit;
    anhyst_reaction_f64 reaction;
    circuit.gap_ratio = rho[i];
    circuit.eddy = eddy[i];
    const anhyst_status status =
        inverse ? anhyst_inverse_f64(iron, state, &circuit, given[i], &reaction)
                : anhyst_forward_f64(iron, state, &circuit, given[i], &reaction);
    if (status != ANHYST_OK) {
      *index = i;
      return status;
    }
    anhyst_accept_f64(iron, state, &reaction);
    if (found != 0) {
      found[i] = inverse ? reaction.drive : reaction.flux;
      field[i] = reaction.field;
    }
  }
  return ANHYST_OK;
}
