/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/law/circuit.h"

#include <math.h>

#include "layers.h"

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
  iron->surface_fraction = 1.0;
  iron->laminated_fraction = 0.0;
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
  iron->surface_fraction = 1.0;
  iron->laminated_fraction = 0.0;
  return is_iron_valid(iron) ? ANHYST_OK : ANHYST_BAD_PARAMETER;
}

anhyst_status anhyst_iron_layers_f64(anhyst_iron_f64 *iron, int layers, double surface,
                                     double laminated)
{
  if (layers < 1 || layers > ANHYST_LAYERS_MAX || !(surface > 0.0 && surface <= 1.0) ||
      (layers > 1 && surface == 1.0) || !(laminated >= 0.0 && laminated < 1.0)) {
    return ANHYST_BAD_PARAMETER;
  }
  iron->layers = layers;
  iron->surface_fraction = surface;
  iron->laminated_fraction = laminated;
  return ANHYST_OK;
}

int anhyst_memories_f64(const anhyst_iron_f64 *iron)
{
  return iron->layers > 1 ? iron->layers + 1 : 1;
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
  const int memories = anhyst_memories_f64(iron);
  for (int i = 0; i < memories; i++) {
    iron->law->accept(iron->parameters, &state[i], &reaction->solution[i]);
  }
}

anhyst_status anhyst_forward_f64(const anhyst_iron_f64 *iron, const anhyst_memory_f64 *state,
                                 const anhyst_circuit_f64 *circuit, double drive,
                                 anhyst_reaction_f64 *reaction)
{
  if (iron->layers > 1) {
    return anhyst_layers_forward_f64(iron, state, circuit, drive, reaction);
  }
  const double load = circuit->gap_ratio + circuit->eddy * ANHYST_MU0;
  const double eddy_term =
      circuit->eddy > 0.0 ? circuit->eddy * anhyst_flux_of_f64(iron, state) : 0.0;
  const double omega = (load / (1.0 + load) - iron->interaction) * (iron->saturation / iron->shape);
  const double r = (drive + eddy_term) / ((1.0 + load) * iron->shape);
  anhyst_solution_f64 *found = reaction->solution;
  const anhyst_status status = iron->law->solve(iron->parameters, state, omega, r, found);
  if (status != ANHYST_OK) {
    return status;
  }
  reaction->drive = drive;
  reaction->field = iron->shape * found->x - iron->interaction * iron->saturation * found->m;
  reaction->flux = anhyst_flux_from_f64(iron, found->x, found->m);
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
  const double eddy_term = circuit->eddy > 0.0 ? anhyst_flux_of_f64(iron, state) : 0.0;
  reaction->field = iron->shape * found->x - iron->interaction * iron->saturation * found->m;
  reaction->flux = flux;
  reaction->drive =
      reaction->field + circuit->gap_ratio * total_field + circuit->eddy * (flux - eddy_term);
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
