/* SPDX-License-Identifier: Apache-2.0 */
/* Template: the law with a linear anhysteretic curve (eqs. 19 and 20 of the paper). Its state u, in
   -1..1, is the hysteresis field divided by its largest value; it follows the flux. The arithmetic
   of a format is included before (../simplified_fixed.h, simplified_real.h), the step along a path
   after it (closed_form.h or ../euler.c). On a path with rising flux, with p = u and v = 1 - p,

     dp/dflux = hold = rate/(1-nu)          for p < 0
     dp/dflux = rate*v/(1 - nu*v)           for p >= 0

   A path starts at the flux `start_flux` and has reached the flux `peak_flux`. The state at the
   peak is computed from the start of the path, so that small steps accumulate no rounding errors.
   If the flux falls below the peak by less than the dead band of the block, u moves on a straight
   line of slope `hold`, in both directions. Beyond the dead band, a new path starts in the other
   direction. Therefore, a reversal smaller than the dead band leaves u unchanged when the flux
   returns. Without the dead band, each such reversal would move u towards 0. */

#define UNKNOWN_PATH_START (-ONE - ONE) /* start of a path whose flux has not exceeded its peak */

/* Returns the stored form of u at the start of a path. Requires |state| <= 1. */
static number stored_path_start(const entry *words, number state);

/* Returns u on a path with rising flux, at a flux beyond the peak of the path. */
static number state_at_flux(const entry *words, const simplified_memory *path, number flux);

/* Limits all numbers of a state to their ranges, because a stored state may be damaged. */
static simplified_memory limit_state(const simplified_memory *memory)
{
  const simplified_memory result = {clamp(memory->flux, -ONE, ONE), clamp(memory->u, -ONE, ONE),
                                    clamp(memory->start_flux, -ONE, ONE),
                                    clamp(memory->peak_flux, -ONE, ONE),
                                    clamp(memory->start_state, -ONE, MAX_DISTANCE)};
  return result;
}

/* Returns a state in the direction of travel: mirrored if the flux falls. */
static simplified_memory to_travel_direction(const simplified_memory *memory, int is_falling)
{
  const simplified_memory mirror = {-memory->flux, -memory->u, -memory->start_flux,
                                    -memory->peak_flux, memory->start_state};
  return is_falling ? mirror : *memory;
}

static number state_at_memory(const entry *words, const simplified_memory *at)
{
  if (at->flux == at->peak_flux) {
    return at->u;
  }
  const number change = linear_state_change(words, absolute(difference(at->flux, at->peak_flux)));
  const number state = at->flux < at->peak_flux ? difference(at->u, change) : sum(at->u, change);
  return clamp(state, -ONE, ONE);
}

static number current_at(const entry *words, const simplified_memory *at, const arms_type *arms)
{
  return scaled(at->flux, arms->flux_arm) + scaled(state_at_memory(words, at), arms->field_arm);
}

/* Returns the path with rising flux that continues beyond the peak of the result. */
static simplified_memory rising_path(const entry *words, const simplified_memory *from)
{
  simplified_memory path = *from;
  if (from->peak_flux > from->start_flux) {
    return path;
  }
  if (from->peak_flux < from->start_flux) { /* the flux reverses */
    const number band = weight_to_number(words[ANHYST_WORD_SIMPLE_BAND]);
    path.peak_flux = sum(from->peak_flux, band);
    path.u = clamp(sum(from->u, linear_state_change(words, band)), -ONE, ONE);
  }
  path.start_flux = path.peak_flux;
  path.start_state = UNKNOWN_PATH_START;
  return path;
}

/* Advances a state along a path with rising flux. The flux is not below the flux of the state.
   Computes the start of the path when the flux exceeds the peak for the first time. */
static void advance_state(const entry *words, const simplified_memory *from,
                          simplified_memory *path, number flux, simplified_memory *to)
{
  *to = *from;
  if (flux > path->peak_flux) {
    if (path->start_state < -ONE) {
      path->start_state = stored_path_start(words, path->u);
    }
    const number state = state_at_flux(words, path, flux);
    to->u = state > path->u ? state : path->u;
    to->start_flux = path->start_flux;
    to->peak_flux = flux;
    to->start_state = path->start_state;
  }
  to->flux = flux;
}

static number simplified_field_for_flux(compensator *c)
{
  const entry *words = c->words;
  const simplified_memory now = limit_state(&c->memory.simplified);
  const int is_falling = c->flux < now.flux;
  const simplified_memory from = to_travel_direction(&now, is_falling);
  simplified_memory path = rising_path(words, &from);
  simplified_memory to;
  advance_state(words, &from, &path, is_falling ? -c->flux : c->flux, &to);
  c->next.memory.simplified = to_travel_direction(&to, is_falling);
  return state_at_memory(words, &c->next.memory.simplified);
}

/* Solves flux_arm*flux + field_arm*u = target for rising flux, starting at a state on the path. For
   rising flux, the left side is a concave function of the flux. Therefore, Newton steps from below
   the solution never pass it, and a step from above leads below it. */
static void solve_upwards(const entry *words, const simplified_memory *from,
                          simplified_memory *path, const arms_type *arms, number target,
                          simplified_memory *to)
{
  for (int32_t i = (int32_t)words[ANHYST_WORD_SIMPLE_ITERATIONS]; i > 0; i--) {
    const number residual = difference(target, current_at(words, to, arms));
    if (!(absolute(residual) > RESIDUAL_DEADBAND)) {
      break;
    }
    const number state = to->flux < path->peak_flux ? -ONE : to->u; /* negative: straight line */
    const number slope = current_slope(arms, state_slope(words, state));
    if (!(slope > 0)) {
      break;
    }
    const number flux = sum(to->flux, newton_step(residual, slope));
    advance_state(words, from, path, clamp(flux, from->flux, ONE), to);
  }
}

static number simplified_flux_for_current(compensator *c, number current)
{
  const entry *words = c->words;
  const arms_type *arms = &c->arms;
  const simplified_memory now = limit_state(&c->memory.simplified);
  const number target = clamp(difference(current, arms->bias), -MAX_CURRENT, MAX_CURRENT);
  const number residual = difference(target, current_at(words, &now, arms));
  const int is_falling = residual < 0;
  const simplified_memory from = to_travel_direction(&now, is_falling);
  simplified_memory to = from;
  if (absolute(residual) > RESIDUAL_DEADBAND) {
    simplified_memory path = rising_path(words, &from);
    const number goal = is_falling ? -target : target;
    if (c->stage == ANHYST_STAGE_AHEAD) {
      const simplified_memory solved = limit_state(&c->next.memory.simplified);
      const simplified_memory guess = to_travel_direction(&solved, is_falling);
      if (guess.flux > from.flux &&
          absolute(difference(goal, current_at(words, &guess, arms))) < absolute(residual)) {
        to = guess; /* the step of the last solve is on the same path */
      }
    }
    solve_upwards(words, &from, &path, arms, goal, &to);
  }
  c->next.memory.simplified = to_travel_direction(&to, is_falling);
  return c->next.memory.simplified.flux;
}

/* Keeps the hysteresis field u, and starts a new path. */
static void simplified_transfer_state(compensator *c, const entry *words, number flux)
{
  const simplified_memory now = limit_state(&c->memory.simplified);
  const simplified_memory carried = {flux, state_at_memory(c->words, &now), flux, flux, 0};
  (void)words;
  c->memory.simplified = carried;
}

/* Returns whether the words are valid that the simplified law and Euler's form have in common. */
static int are_path_words_valid(const entry *words)
{
  return is_in_range(words[ANHYST_WORD_SIMPLE_RATE], MIN_WEIGHT, MAX_ENTRY) &&
         is_integer(words[ANHYST_WORD_SIMPLE_RATE_SHIFT], 0, MAX_WEIGHT_SHIFT) &&
         is_in_range(words[ANHYST_WORD_SIMPLE_HOLD], MIN_WEIGHT, MAX_ENTRY) &&
         is_integer(words[ANHYST_WORD_SIMPLE_HOLD_SHIFT], 0, MAX_WEIGHT_SHIFT) &&
         is_in_range(words[ANHYST_WORD_SIMPLE_REST], MIN_WEIGHT, ENTRY_ONE) &&
         is_in_range(words[ANHYST_WORD_SIMPLE_BAND], 0, ENTRY_ONE) &&
         is_integer(words[ANHYST_WORD_SIMPLE_ITERATIONS], 2, 16) &&
         is_table_over_gap(words, ANHYST_WORD_GAP_FLUX_ARM, 0);
}
