/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/law/circuit.h"

#include <math.h>

anhyst_status anhyst_iron_init_f64(anhyst_iron_f64 *iron, anhyst_step step, double saturation,
                                   double shape, double pinning, double reversibility,
                                   double interaction, double play_width,
                                   const anhyst_branch_f64 *branch)
{
  /* Written so that NaN and infinity fail too. */
  if (!(saturation > 0.0) || !(shape > 0.0) || !(interaction < 1.0) ||
      !((1.0 - interaction) * (saturation / shape) < 1e12)) {
    return ANHYST_BAD_PARAMETER;
  }
  iron->saturation = saturation;
  iron->shape = shape;
  iron->interaction = interaction;
  iron->law.step = step;
  iron->law.kappa = pinning / shape;
  iron->law.c = reversibility;
  iron->law.play = play_width / shape;
  iron->law.eps =
      step == ANHYST_STEP_JA1986 ? interaction * reversibility * saturation / shape : 0.0;
  iron->law.branch = branch;
  return anhyst_operator_check_f64(&iron->law);
}

static double flux_from(const anhyst_iron_f64 *iron, double x, double m)
{
  return ANHYST_MU0 * (iron->shape * x + (1.0 - iron->interaction) * iron->saturation * m);
}

double anhyst_flux_of_f64(const anhyst_iron_f64 *iron, const anhyst_state_f64 *state)
{
  return flux_from(iron, state->x, anhyst_operator_m_f64(&iron->law, state));
}

anhyst_status anhyst_forward_f64(const anhyst_iron_f64 *iron, const anhyst_state_f64 *state,
                                 const anhyst_circuit_f64 *circuit, double drive,
                                 anhyst_reaction_f64 *reaction)
{
  const double load = circuit->gap_ratio + circuit->eddy * ANHYST_MU0;
  const double past = circuit->eddy > 0.0 ? circuit->eddy * anhyst_flux_of_f64(iron, state) : 0.0;
  const double omega = (load / (1.0 + load) - iron->interaction) * (iron->saturation / iron->shape);
  const double r = (drive + past) / ((1.0 + load) * iron->shape);
  anhyst_candidate_f64 found;
  const anhyst_status status = anhyst_solve_f64(&iron->law, state, omega, r, &found);
  if (status != ANHYST_OK) {
    return status;
  }
  reaction->state = found.state;
  reaction->drive = drive;
  reaction->field = iron->shape * found.state.x - iron->interaction * iron->saturation * found.m;
  reaction->flux = flux_from(iron, found.state.x, found.m);
  return ANHYST_OK;
}

anhyst_status anhyst_inverse_f64(const anhyst_iron_f64 *iron, const anhyst_state_f64 *state,
                                 const anhyst_circuit_f64 *circuit, double flux,
                                 anhyst_reaction_f64 *reaction)
{
  const double omega = (1.0 - iron->interaction) * (iron->saturation / iron->shape);
  const double both = flux / ANHYST_MU0;
  anhyst_candidate_f64 found;
  const anhyst_status status =
      anhyst_solve_f64(&iron->law, state, omega, both / iron->shape, &found);
  if (status != ANHYST_OK) {
    return status;
  }
  const double past = circuit->eddy > 0.0 ? anhyst_flux_of_f64(iron, state) : 0.0;
  reaction->state = found.state;
  reaction->field = iron->shape * found.state.x - iron->interaction * iron->saturation * found.m;
  reaction->flux = flux;
  reaction->drive = reaction->field + circuit->gap_ratio * both + circuit->eddy * (flux - past);
  /* The solver has not seen the circuit: one that is not finite shows only here. */
  return fabs(reaction->drive) <= 1e30 ? ANHYST_OK : ANHYST_OUT_OF_RANGE;
}

anhyst_status anhyst_commit_f64(const anhyst_iron_f64 *iron, anhyst_state_f64 *state,
                                const anhyst_circuit_f64 *circuit, double applied_drive)
{
  anhyst_reaction_f64 reaction;
  const anhyst_status status = anhyst_forward_f64(iron, state, circuit, applied_drive, &reaction);
  if (status == ANHYST_OK) {
    *state = reaction.state;
  }
  return status;
}

anhyst_status anhyst_record_f64(const anhyst_iron_f64 *iron, anhyst_state_f64 *state, int inverse,
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
    *state = reaction.state;
    if (found != 0) {
      found[i] = inverse ? reaction.drive : reaction.flux;
      field[i] = reaction.field;
    }
  }
  return ANHYST_OK;
}

/* Limit of a geometric sequence from three members, kept where the law allows a state. */
static void extrapolate(const anhyst_operator_f64 *law, const double y[3], anhyst_state_f64 *state)
{
  const double first = y[1] - y[0];
  const double second = y[2] - y[1];
  const double change = second - first;
  if (!(fabs(second) < fabs(first)) || !(fabs(change) > 0.0)) {
    return;
  }
  anhyst_state_f64 limit = *state;
  limit.y -= second * second / change;
  if (anhyst_state_check_f64(law, &limit) == ANHYST_OK) {
    *state = limit;
  }
}

anhyst_status anhyst_settle_f64(const anhyst_iron_f64 *iron, anhyst_state_f64 *state, int inverse,
                                size_t n, const double *given, const double *rho,
                                const double *eddy, double tol, int most_cycles, int *cycles,
                                size_t *index)
{
  double y[3] = {state->y, state->y, state->y};
  int fresh = 0;
  for (*cycles = 1; *cycles <= most_cycles; (*cycles)++) {
    const anhyst_state_f64 before = *state;
    const anhyst_status status =
        anhyst_record_f64(iron, state, inverse, n, given, rho, eddy, 0, 0, index);
    if (status != ANHYST_OK) {
      return status;
    }
    if (fabs(state->x - before.x) <= tol && fabs(state->y - before.y) <= tol &&
        fabs(state->p - before.p) <= tol) {
      return ANHYST_OK;
    }
    y[0] = y[1];
    y[1] = y[2];
    y[2] = state->y;
    fresh++;
    if (fresh == 4) {
      extrapolate(&iron->law, y, state);
      fresh = 0;
    }
  }
  return ANHYST_NOT_SETTLED;
}
