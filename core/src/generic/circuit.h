/* SPDX-License-Identifier: Apache-2.0 */

anhyst_status ANHYST_NAME(anhyst_iron_init)(ANHYST_NAME(anhyst_iron) *iron, anhyst_step step,
                                            ANHYST_REAL saturation, ANHYST_REAL shape,
                                            ANHYST_REAL pinning, ANHYST_REAL reversibility,
                                            ANHYST_REAL interaction, ANHYST_REAL play_width,
                                            const ANHYST_NAME(anhyst_branch) *branch)
{
  /* Written so that NaN and infinity fail too. */
  if (!(saturation > R(0.0)) || !(shape > R(0.0)) || !(interaction < R(1.0)) ||
      !((R(1.0) - interaction) * (saturation / shape) < R(1e12))) {
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
      step == ANHYST_STEP_JA1986 ? interaction * reversibility * saturation / shape : R(0.0);
  iron->law.branch = branch;
  return ANHYST_NAME(anhyst_operator_check)(&iron->law);
}

static ANHYST_REAL ANHYST_NAME(flux_from)(const ANHYST_NAME(anhyst_iron) *iron, ANHYST_REAL x,
                                          ANHYST_REAL m)
{
  return (ANHYST_REAL)ANHYST_MU0 *
         (iron->shape * x + (R(1.0) - iron->interaction) * iron->saturation * m);
}

ANHYST_REAL ANHYST_NAME(anhyst_flux_of)(const ANHYST_NAME(anhyst_iron) *iron,
                                        const ANHYST_NAME(anhyst_state) *state)
{
  return ANHYST_NAME(flux_from)(iron, state->x, ANHYST_NAME(anhyst_operator_m)(&iron->law, state));
}

anhyst_status ANHYST_NAME(anhyst_forward)(const ANHYST_NAME(anhyst_iron) *iron,
                                          const ANHYST_NAME(anhyst_state) *state,
                                          const ANHYST_NAME(anhyst_circuit) *circuit,
                                          ANHYST_REAL drive, ANHYST_NAME(anhyst_reaction) *reaction)
{
  const ANHYST_REAL load = circuit->gap_ratio + circuit->eddy * (ANHYST_REAL)ANHYST_MU0;
  const ANHYST_REAL past =
      circuit->eddy > R(0.0) ? circuit->eddy * ANHYST_NAME(anhyst_flux_of)(iron, state) : R(0.0);
  const ANHYST_REAL omega =
      (load / (R(1.0) + load) - iron->interaction) * (iron->saturation / iron->shape);
  const ANHYST_REAL r = (drive + past) / ((R(1.0) + load) * iron->shape);
  ANHYST_NAME(anhyst_candidate) found;
  const anhyst_status status = ANHYST_NAME(anhyst_solve)(&iron->law, state, omega, r, &found);
  if (status != ANHYST_OK) {
    return status;
  }
  reaction->state = found.state;
  reaction->drive = drive;
  reaction->field = iron->shape * found.state.x - iron->interaction * iron->saturation * found.m;
  reaction->flux = ANHYST_NAME(flux_from)(iron, found.state.x, found.m);
  return ANHYST_OK;
}

anhyst_status ANHYST_NAME(anhyst_inverse)(const ANHYST_NAME(anhyst_iron) *iron,
                                          const ANHYST_NAME(anhyst_state) *state,
                                          const ANHYST_NAME(anhyst_circuit) *circuit,
                                          ANHYST_REAL flux, ANHYST_NAME(anhyst_reaction) *reaction)
{
  const ANHYST_REAL omega = (R(1.0) - iron->interaction) * (iron->saturation / iron->shape);
  const ANHYST_REAL both = flux / (ANHYST_REAL)ANHYST_MU0;
  ANHYST_NAME(anhyst_candidate) found;
  const anhyst_status status =
      ANHYST_NAME(anhyst_solve)(&iron->law, state, omega, both / iron->shape, &found);
  if (status != ANHYST_OK) {
    return status;
  }
  const ANHYST_REAL past =
      circuit->eddy > R(0.0) ? ANHYST_NAME(anhyst_flux_of)(iron, state) : R(0.0);
  reaction->state = found.state;
  reaction->field = iron->shape * found.state.x - iron->interaction * iron->saturation * found.m;
  reaction->flux = flux;
  reaction->drive = reaction->field + circuit->gap_ratio * both + circuit->eddy * (flux - past);
  /* The solver has not seen the circuit: one that is not finite shows only here. */
  return ANHYST_FABS(reaction->drive) <= R(1e30) ? ANHYST_OK : ANHYST_OUT_OF_RANGE;
}

anhyst_status ANHYST_NAME(anhyst_commit)(const ANHYST_NAME(anhyst_iron) *iron,
                                         ANHYST_NAME(anhyst_state) *state,
                                         const ANHYST_NAME(anhyst_circuit) *circuit,
                                         ANHYST_REAL applied_drive)
{
  ANHYST_NAME(anhyst_reaction) reaction;
  const anhyst_status status =
      ANHYST_NAME(anhyst_forward)(iron, state, circuit, applied_drive, &reaction);
  if (status == ANHYST_OK) {
    *state = reaction.state;
  }
  return status;
}

anhyst_status ANHYST_NAME(anhyst_record)(const ANHYST_NAME(anhyst_iron) *iron,
                                         ANHYST_NAME(anhyst_state) *state, int inverse, size_t n,
                                         const ANHYST_REAL *given, const ANHYST_REAL *rho,
                                         const ANHYST_REAL *eddy, ANHYST_REAL *found,
                                         ANHYST_REAL *field, size_t *index)
{
  for (size_t i = 0; i < n; i++) {
    ANHYST_NAME(anhyst_circuit) circuit;
    ANHYST_NAME(anhyst_reaction) reaction;
    circuit.gap_ratio = rho[i];
    circuit.eddy = eddy[i];
    const anhyst_status status =
        inverse ? ANHYST_NAME(anhyst_inverse)(iron, state, &circuit, given[i], &reaction)
                : ANHYST_NAME(anhyst_forward)(iron, state, &circuit, given[i], &reaction);
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
static void ANHYST_NAME(extrapolate)(const ANHYST_NAME(anhyst_operator) *law,
                                     const ANHYST_REAL y[3], ANHYST_NAME(anhyst_state) *state)
{
  const ANHYST_REAL first = y[1] - y[0];
  const ANHYST_REAL second = y[2] - y[1];
  const ANHYST_REAL change = second - first;
  if (!(ANHYST_FABS(second) < ANHYST_FABS(first)) || !(ANHYST_FABS(change) > R(0.0))) {
    return;
  }
  ANHYST_NAME(anhyst_state) limit = *state;
  limit.y -= second * second / change;
  if (ANHYST_NAME(anhyst_state_check)(law, &limit) == ANHYST_OK) {
    *state = limit;
  }
}

anhyst_status ANHYST_NAME(anhyst_settle)(const ANHYST_NAME(anhyst_iron) *iron,
                                         ANHYST_NAME(anhyst_state) *state, int inverse, size_t n,
                                         const ANHYST_REAL *given, const ANHYST_REAL *rho,
                                         const ANHYST_REAL *eddy, ANHYST_REAL tol, int most_cycles,
                                         int *cycles, size_t *index)
{
  ANHYST_REAL y[3] = {state->y, state->y, state->y};
  int fresh = 0;
  for (*cycles = 1; *cycles <= most_cycles; (*cycles)++) {
    const ANHYST_NAME(anhyst_state) before = *state;
    const anhyst_status status =
        ANHYST_NAME(anhyst_record)(iron, state, inverse, n, given, rho, eddy, 0, 0, index);
    if (status != ANHYST_OK) {
      return status;
    }
    if (ANHYST_FABS(state->x - before.x) <= tol && ANHYST_FABS(state->y - before.y) <= tol &&
        ANHYST_FABS(state->p - before.p) <= tol) {
      return ANHYST_OK;
    }
    y[0] = y[1];
    y[1] = y[2];
    y[2] = state->y;
    fresh++;
    if (fresh == 4) {
      ANHYST_NAME(extrapolate)(&iron->law, y, state);
      fresh = 0;
    }
  }
  return ANHYST_NOT_SETTLED;
}
