/* SPDX-License-Identifier: Apache-2.0 */

anhyst_status ANHYST_NAME(anhyst_operator_check)(const ANHYST_NAME(anhyst_operator) *law)
{
  const int ok = law->kappa >= (ANHYST_REAL)ANHYST_KAPPA_MIN &&
                 law->kappa <= (ANHYST_REAL)ANHYST_KAPPA_MAX && law->c >= R(0.0) &&
                 law->c <= R(1.0) && law->play >= R(0.0) &&
                 law->play <= (ANHYST_REAL)ANHYST_X_MAX &&
                 law->eps <= (ANHYST_REAL)ANHYST_EPS_MAX && law->eps > -(ANHYST_REAL)ANHYST_X_MAX;
  const int table_ok =
      law->step != ANHYST_STEP_EXACT || (law->branch != 0 && !(law->branch->kappa < law->kappa) &&
                                         !(law->branch->kappa > law->kappa));
  return ok && table_ok ? ANHYST_OK : ANHYST_BAD_PARAMETER;
}

anhyst_status ANHYST_NAME(anhyst_state_check)(const ANHYST_NAME(anhyst_operator) *law,
                                              const ANHYST_NAME(anhyst_state) *state)
{
  /* NOLINTNEXTLINE(misc-redundant-expression): a constant for each format */
  const ANHYST_REAL slack = sizeof(ANHYST_REAL) == sizeof(double) ? R(1e-9) : R(1e-5);
  ANHYST_REAL slope;
  const ANHYST_REAL pull = ANHYST_NAME(anhyst_langevin)(state->p, &slope) - state->y;
  const int ok =
      ANHYST_FABS(pull) <= law->kappa / R(3.0) + slack &&
      ANHYST_FABS(state->x - state->p) <= law->play + slack * (R(1.0) + ANHYST_FABS(state->x)) &&
      ANHYST_FABS(state->y) < R(1.0) && ANHYST_FABS(state->x) <= (ANHYST_REAL)ANHYST_X_MAX;
  return ok ? ANHYST_OK : ANHYST_BAD_STATE;
}

ANHYST_REAL ANHYST_NAME(anhyst_operator_steepest)(const ANHYST_NAME(anhyst_operator) *law)
{
  if (law->step == ANHYST_STEP_JA1986 && law->eps > R(0.0)) {
    return R(1.0) / (R(3.0) - law->eps);
  }
  return R(1.0) / R(3.0);
}

ANHYST_REAL ANHYST_NAME(anhyst_operator_m)(const ANHYST_NAME(anhyst_operator) *law,
                                           const ANHYST_NAME(anhyst_state) *state)
{
  ANHYST_REAL slope;
  return (R(1.0) - law->c) * state->y + law->c * ANHYST_NAME(anhyst_langevin)(state->x, &slope);
}

/* dy/dp of the law of 1986 at (p, y), moving with sign. */
static ANHYST_REAL ANHYST_NAME(slope_1986)(const ANHYST_NAME(anhyst_path) *path, ANHYST_REAL p,
                                           ANHYST_REAL y)
{
  ANHYST_REAL slope;
  const ANHYST_REAL drive = path->sign * (ANHYST_NAME(anhyst_langevin)(p, &slope) - y);
  const ANHYST_REAL q = drive > R(0.0) ? drive / path->law->kappa : R(0.0);
  const ANHYST_REAL eps = path->law->eps;
  return q * (R(1.0) - eps * slope) / (R(1.0) - eps * q);
}

/* Classical Runge-Kutta from the departure; full sub-steps first, then the rest, so that the
   result is a continuous function of the end. Of a path much longer than the lag remembers only the
   end is followed, from the steady lag kappa*L'. */
static ANHYST_REAL ANHYST_NAME(march_1986)(const ANHYST_NAME(anhyst_path) *path, ANHYST_REAL p)
{
  const ANHYST_REAL eps = path->law->eps;
  const ANHYST_REAL stretch = R(1.0) - eps / R(3.0);
  /* The closer eps comes to 3, the stiffer the lag. */
  const ANHYST_REAL eighth = path->law->kappa / R(8.0) * (stretch < R(1.0) ? stretch : R(1.0));
  const ANHYST_REAL memory =
      R(40.0) * path->law->kappa * (eps < R(0.0) ? stretch * stretch : R(1.0) / stretch);
  ANHYST_REAL at = path->departure;
  ANHYST_REAL y = path->from.y;
  if (ANHYST_FABS(p - at) > memory) {
    ANHYST_REAL slope;
    at = p - path->sign * memory;
    y = ANHYST_NAME(anhyst_langevin)(at, &slope);
    y -= path->sign * path->law->kappa * slope;
  }
  if (eighth <= R(4.0) * ANHYST_EPS * ANHYST_FABS(p)) {
    /* So far out a sub-step is lost to rounding, for ever; but there L is straight. */
    ANHYST_REAL slope;
    const ANHYST_REAL steady = ANHYST_NAME(anhyst_langevin)(p, &slope);
    const ANHYST_REAL kept = ANHYST_EXP(-ANHYST_FABS(p - at) / path->law->kappa);
    const ANHYST_REAL left = y - ANHYST_NAME(anhyst_langevin)(at, &slope);
    return steady + left * kept - path->sign * path->law->kappa * slope * (R(1.0) - kept);
  }
  int more = 1;
  while (more) {
    const ANHYST_REAL bend = (R(1.0) + ANHYST_FABS(at)) / R(16.0);
    ANHYST_REAL h = path->sign * (eighth < bend ? eighth : bend);
    if (ANHYST_FABS(p - at) <= ANHYST_FABS(h)) {
      h = p - at;
      more = 0;
    }
    const ANHYST_REAL half = R(0.5) * h;
    const ANHYST_REAL k1 = ANHYST_NAME(slope_1986)(path, at, y);
    const ANHYST_REAL k2 = ANHYST_NAME(slope_1986)(path, at + half, y + half * k1);
    const ANHYST_REAL k3 = ANHYST_NAME(slope_1986)(path, at + half, y + half * k2);
    const ANHYST_REAL k4 = ANHYST_NAME(slope_1986)(path, at + h, y + h * k3);
    y += h / R(6.0) * (k1 + R(2.0) * (k2 + k3) + k4);
    at += h;
  }
  return y;
}

static void ANHYST_NAME(find_departure)(ANHYST_NAME(anhyst_path) *path)
{
  const int held = path->sign * (path->pull - path->from.y) < R(0.0);
  path->departure = held ? ANHYST_NAME(anhyst_inverse_langevin)(path->from.y) : path->from.p;
  if (path->law->step == ANHYST_STEP_EXACT) {
    path->lead = path->from.y - path->sign * ANHYST_NAME(anhyst_branch_at)(
                                                 path->law->branch, path->sign * path->departure);
  }
  path->departure_known = 1;
}

/* Linear step to p with pull = L(p), slope = L'(p); *y_slope is dy/dp. */
static ANHYST_REAL ANHYST_NAME(linear_y)(const ANHYST_NAME(anhyst_path) *path, ANHYST_REAL p,
                                         ANHYST_REAL pull, ANHYST_REAL slope, ANHYST_REAL *y_slope)
{
  const ANHYST_REAL y0 = path->from.y;
  const ANHYST_REAL way = p - path->from.p;
  const ANHYST_REAL s = ANHYST_FABS(way) / path->law->kappa;
  const ANHYST_REAL rise = pull - path->pull;
  const ANHYST_REAL ahead = pull - y0;
  const ANHYST_REAL start = path->pull - y0;
  if (path->sign * start >= R(0.0)) {
    const ANHYST_NAME(weights) w = ANHYST_NAME(weights_at)(s);
    *y_slope =
        path->sign / path->law->kappa * (start * (R(1.0) - w.e) + rise * w.g_slope) + slope * w.g;
    return y0 + start * w.e + rise * w.g;
  }
  const ANHYST_REAL share = s * ahead / rise;
  const ANHYST_NAME(weights) w = ANHYST_NAME(weights_at)(share);
  *y_slope =
      slope * w.g + ahead * w.g_slope * share * (R(1.0) / way + slope / ahead - slope / rise);
  return y0 + ahead * w.g;
}

void ANHYST_NAME(anhyst_path_begin)(ANHYST_NAME(anhyst_path) *path,
                                    const ANHYST_NAME(anhyst_operator) *law,
                                    const ANHYST_NAME(anhyst_state) *from, ANHYST_REAL sign,
                                    ANHYST_NAME(anhyst_answer) *start)
{
  ANHYST_REAL slope;
  const ANHYST_REAL pull = ANHYST_NAME(anhyst_langevin)(from->p, &slope);
  path->law = law;
  path->from = *from;
  path->sign = sign;
  path->pull = pull;
  path->departure_known = 0;

  ANHYST_REAL x_pull = pull;
  ANHYST_REAL drive = sign * (pull - from->y) / law->kappa;
  start->p_slope = R(1.0);
  if (law->play > R(0.0)) {
    x_pull = ANHYST_NAME(anhyst_langevin)(from->x, &slope);
    if (sign * (from->x - from->p) < law->play) {
      start->p_slope = R(0.0);
      drive = R(0.0);
    }
  }
  start->state = *from;
  start->y_slope = drive > R(0.0) ? drive : R(0.0);
  start->m = (R(1.0) - law->c) * from->y + law->c * x_pull;
  start->m_slope = (R(1.0) - law->c) * start->y_slope + law->c * slope;
}

/* The irreversible part at p, with pull = L(p); *y_slope is dy/dp. */
static ANHYST_REAL ANHYST_NAME(irreversible)(ANHYST_NAME(anhyst_path) *path, ANHYST_REAL p,
                                             ANHYST_REAL pull, ANHYST_REAL slope,
                                             ANHYST_REAL *y_slope)
{
  const ANHYST_NAME(anhyst_operator) *law = path->law;
  *y_slope = R(0.0);
  if (path->sign * (p - path->from.p) <= R(0.0) || path->sign * (pull - path->from.y) <= R(0.0)) {
    return path->from.y; /* the play has not closed, or the anhysteretic is not crossed yet */
  }
  if (law->step == ANHYST_STEP_LINEAR) {
    return ANHYST_NAME(linear_y)(path, p, pull, slope, y_slope);
  }
  if (!path->departure_known) {
    ANHYST_NAME(find_departure)(path);
  }
  if (path->sign * (p - path->departure) <= R(0.0)) {
    return path->from.y;
  }
  if (law->step == ANHYST_STEP_JA1986) {
    const ANHYST_REAL y = ANHYST_NAME(march_1986)(path, p);
    *y_slope = ANHYST_NAME(slope_1986)(path, p, y);
    return y;
  }
  const ANHYST_REAL kept = ANHYST_EXP(-ANHYST_FABS(p - path->departure) / law->kappa);
  const ANHYST_REAL y =
      path->sign * ANHYST_NAME(anhyst_branch_at)(law->branch, path->sign * p) + path->lead * kept;
  const ANHYST_REAL drive = path->sign * (pull - y);
  *y_slope = drive > R(0.0) ? drive / law->kappa : R(0.0);
  return y;
}

void ANHYST_NAME(anhyst_path_at)(ANHYST_NAME(anhyst_path) *path, ANHYST_REAL x,
                                 ANHYST_NAME(anhyst_answer) *answer)
{
  const ANHYST_NAME(anhyst_operator) *law = path->law;
  ANHYST_REAL slope;
  const ANHYST_REAL pull = ANHYST_NAME(anhyst_langevin)(x, &slope);
  ANHYST_REAL p = x;
  ANHYST_REAL p_pull = pull;
  ANHYST_REAL p_pull_slope = slope;
  answer->p_slope = R(1.0);
  if (law->play > R(0.0)) {
    p = x - path->sign * law->play;
    if (path->sign * (p - path->from.p) <= R(0.0)) {
      p = path->from.p;
      answer->p_slope = R(0.0);
    }
    p_pull = ANHYST_NAME(anhyst_langevin)(p, &p_pull_slope);
  }
  ANHYST_REAL y_slope;
  const ANHYST_REAL y = ANHYST_NAME(irreversible)(path, p, p_pull, p_pull_slope, &y_slope);
  answer->state.x = x;
  answer->state.y = y;
  answer->state.p = p;
  answer->m = (R(1.0) - law->c) * y + law->c * pull;
  answer->y_slope = y_slope;
  answer->m_slope = (R(1.0) - law->c) * y_slope + law->c * slope;
}
