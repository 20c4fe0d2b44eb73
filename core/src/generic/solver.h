/* SPDX-License-Identifier: Apache-2.0 */

/* The equation along one path, and the interval known to hold its first solution. */
typedef struct {
  ANHYST_NAME(anhyst_path) path;
  ANHYST_REAL omega, r;
  ANHYST_REAL before; /* residual has the sign of the start here, or it is the start */
  ANHYST_REAL beyond; /* residual has the other sign here */
  int evaluations;
} ANHYST_NAME(search);

static ANHYST_REAL ANHYST_NAME(residual)(ANHYST_NAME(search) *find, ANHYST_REAL x,
                                         ANHYST_NAME(anhyst_answer) *at)
{
  find->evaluations++;
  ANHYST_NAME(anhyst_path_at)(&find->path, x, at);
  return x + find->omega * at->m - find->r;
}

/* What rounding alone leaves of the residual. */
static ANHYST_REAL ANHYST_NAME(rounding)(const ANHYST_NAME(search) *find,
                                         const ANHYST_NAME(anhyst_answer) *at)
{
  return R(4.0) * ANHYST_EPS *
         (ANHYST_FABS(at->state.x) + ANHYST_FABS(find->omega * at->m) + ANHYST_FABS(find->r));
}

static void ANHYST_NAME(accept)(const ANHYST_NAME(search) *find,
                                const ANHYST_NAME(anhyst_answer) *at, ANHYST_REAL step,
                                ANHYST_NAME(anhyst_candidate) *candidate)
{
  candidate->state = at->state;
  candidate->state.x += step;
  candidate->state.y += step * at->y_slope;
  candidate->state.p += step * at->p_slope;
  candidate->m = at->m + step * at->m_slope;
  candidate->m_slope = at->m_slope;
  candidate->evaluations = find->evaluations;
}

/* Newton from x, kept inside the interval; halves it by the geometric mean of the distances from
   the start, since it may span many orders of magnitude. */
static anhyst_status ANHYST_NAME(polish)(ANHYST_NAME(search) *find, ANHYST_REAL x,
                                         ANHYST_NAME(anhyst_candidate) *candidate)
{
  const ANHYST_REAL start = find->path.from.x;
  const ANHYST_REAL sign = find->path.sign;
  /* A last Newton step this short is as good taken along the tangent as evaluated again. */
  const ANHYST_REAL kappa = find->path.law->kappa;
  const ANHYST_REAL tangent = ANHYST_EPS * (R(8.0) + ANHYST_FABS(x)) * kappa / (R(1.0) + kappa);
  ANHYST_REAL longest = ANHYST_FABS(find->beyond - find->before);
  for (int i = 0; i < 200; i++) {
    ANHYST_NAME(anhyst_answer) at;
    const ANHYST_REAL g = ANHYST_NAME(residual)(find, x, &at);
    const ANHYST_REAL step = -g / (R(1.0) + find->omega * at.m_slope);
    const ANHYST_REAL width = ANHYST_FABS(find->beyond - find->before);
    if (ANHYST_FABS(g) <= ANHYST_NAME(rounding)(find, &at) ||
        width <= R(2.0) * ANHYST_EPS * ANHYST_FABS(x)) {
      ANHYST_NAME(accept)(find, &at, R(0.0), candidate);
      return ANHYST_OK;
    }
    if (sign * g < R(0.0)) {
      find->before = x;
    } else {
      find->beyond = x;
    }
    const ANHYST_REAL next = x + step;
    const int inside =
        sign * (next - find->before) > R(0.0) && sign * (find->beyond - next) > R(0.0);
    if (inside && step * step <= tangent) {
      ANHYST_NAME(accept)(find, &at, step, candidate);
      return ANHYST_OK;
    }
    if (inside && ANHYST_FABS(step) <= longest) {
      /* Steps must halve: Newton can swing to and fro across the two bends of the curve. */
      longest = R(0.5) * ANHYST_FABS(step);
      x = next;
      continue;
    }
    longest = R(0.5) * width;
    const ANHYST_REAL near = ANHYST_FABS(find->before - start);
    const ANHYST_REAL far = ANHYST_FABS(find->beyond - start);
    x = near > R(0.0) && far > R(4.0) * near ? start + sign * ANHYST_SQRT(near) * ANHYST_SQRT(far)
                                             : R(0.5) * (find->before + find->beyond);
  }
  return ANHYST_NOT_CONVERGED;
}

/* Where the residual is largest (towards its root) between two places of rising and falling
   residual: a fold. Bisection on the slope. */
static ANHYST_REAL ANHYST_NAME(fold)(ANHYST_NAME(search) *find, ANHYST_REAL rising,
                                     ANHYST_REAL falling)
{
  ANHYST_NAME(anhyst_answer) at;
  for (int i = 0; i < 40; i++) {
    const ANHYST_REAL middle = R(0.5) * (rising + falling);
    const ANHYST_REAL g = ANHYST_NAME(residual)(find, middle, &at);
    if (find->path.sign * g >= R(0.0)) {
      return middle;
    }
    if (R(1.0) + find->omega * at.m_slope > R(0.0)) {
      rising = middle;
    } else {
      falling = middle;
    }
  }
  return rising;
}

/* Walks from the start until the residual changes sign. omega < 0 and dm/dx >= 0, so the residual
   changes by no more than the way gone: a step of its size cannot pass a solution. Near a fold
   such steps creep, so a least step is kept, and a fold inside one is looked into. */
static anhyst_status ANHYST_NAME(walk)(ANHYST_NAME(search) *find, ANHYST_REAL d)
{
  const ANHYST_REAL sign = find->path.sign;
  const ANHYST_REAL least = R(1.0) / R(64.0);
  const ANHYST_REAL limit = ANHYST_FABS(d) + R(2.0) * ANHYST_FABS(find->omega) + R(1.0);
  ANHYST_REAL x = find->path.from.x;
  ANHYST_REAL gap = ANHYST_FABS(d);
  int was_rising = 1;
  while (ANHYST_FABS(x - find->path.from.x) <= limit) {
    ANHYST_NAME(anhyst_answer) at;
    const ANHYST_REAL next = x + sign * (gap > least ? gap : least);
    if (sign * next > (ANHYST_REAL)ANHYST_X_MAX) {
      /* No solution up to there; and further out a step could be lost to rounding, for ever. */
      return ANHYST_OUT_OF_RANGE;
    }
    const ANHYST_REAL g = sign * ANHYST_NAME(residual)(find, next, &at);
    const int rising = R(1.0) + find->omega * at.m_slope > R(0.0);
    find->before = x;
    if (g >= R(0.0)) {
      find->beyond = next;
      return ANHYST_OK;
    }
    if (was_rising && !rising && gap < least) {
      const ANHYST_REAL top = ANHYST_NAME(fold)(find, x, next);
      if (sign * ANHYST_NAME(residual)(find, top, &at) >= R(0.0)) {
        find->beyond = top;
        return ANHYST_OK;
      }
    }
    was_rising = rising;
    gap = -g;
    x = next;
  }
  return ANHYST_NOT_CONVERGED;
}

anhyst_status ANHYST_NAME(anhyst_solve)(const ANHYST_NAME(anhyst_operator) *law,
                                        const ANHYST_NAME(anhyst_state) *state, ANHYST_REAL omega,
                                        ANHYST_REAL r, ANHYST_NAME(anhyst_candidate) *candidate)
{
  const ANHYST_REAL steepest = ANHYST_NAME(anhyst_operator_steepest)(law);
  if (-omega * law->c > R(3.0)) {
    return ANHYST_REFUSED;
  }
  ANHYST_NAME(search) find;
  ANHYST_NAME(anhyst_answer) start;
  find.omega = omega;
  find.r = r;
  find.evaluations = 1;
  const ANHYST_REAL m = ANHYST_NAME(anhyst_operator_m)(law, state);
  const ANHYST_REAL d = r - state->x - omega * m;
  if (!(ANHYST_FABS(d) < R(4.0) * (ANHYST_REAL)ANHYST_X_MAX * (R(1.0) + ANHYST_FABS(omega)))) {
    return ANHYST_OUT_OF_RANGE;
  }
  const ANHYST_REAL sign = d < R(0.0) ? R(-1.0) : R(1.0);
  ANHYST_NAME(anhyst_path_begin)(&find.path, law, state, sign, &start);
  if (ANHYST_FABS(d) <= ANHYST_NAME(rounding)(&find, &start)) {
    ANHYST_NAME(accept)(&find, &start, R(0.0), candidate);
    return ANHYST_OK;
  }

  const ANHYST_REAL least_slope = R(1.0) + omega * steepest;
  ANHYST_REAL guess;
  anhyst_status status = ANHYST_OK;
  if (least_slope > R(1e-6)) {
    const ANHYST_REAL one = state->x + d / least_slope;
    const ANHYST_REAL other = state->x + d;
    const int shrinks = omega > R(0.0);
    /* The start itself is a safe near end; rounding could put the solution just before it. */
    find.before = state->x;
    find.beyond =
        (shrinks ? other : one) + sign * ANHYST_EPS * (R(8.0) * ANHYST_FABS(other) + R(1e-30));
    guess = state->x + d / (R(1.0) + omega * start.m_slope);
    if (shrinks && sign * (guess - one) < R(0.0)) {
      guess = one;
    }
  } else {
    status = ANHYST_NAME(walk)(&find, d);
    guess = R(0.5) * (find.before + find.beyond);
  }
  if (status == ANHYST_OK) {
    status = ANHYST_NAME(polish)(&find, guess, candidate);
  }
  if (status == ANHYST_OK && !(ANHYST_FABS(candidate->state.x) <= (ANHYST_REAL)ANHYST_X_MAX)) {
    status = ANHYST_OUT_OF_RANGE;
  }
  return status;
}
