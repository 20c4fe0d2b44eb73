/* SPDX-License-Identifier: Apache-2.0 */

/* What follows is the same in every format; the few operations in which they differ stand before
   it: position.c for q31, generic/position_real.h for the others. */

static int magnet_count(const anhyst_position_x *c) { return c->magnet[1] != NULL ? 2 : 1; }

/* What counts as no current: of those that can be driven the nearest to it. */
static ANHYST_REAL zero_current(const anhyst_position_limits_x *limits)
{
  return on_grid(limits, within(0, limits->current_low, limits->current_high));
}

anhyst_status anhyst_position_init_x(anhyst_position_x *c, const anhyst_position_limits_x *limits,
                                     const anhyst_position_settings_x *settings,
                                     anhyst_force_controller_x *magnet,
                                     anhyst_force_controller_x *magnet_2)
{
  const anhyst_position_x fresh = {0};
  if (anhyst_levitation_check(&limits->levitation, &settings->levitation) != ANHYST_OK ||
      anhyst_pidd2_check_x(&settings->gains) != ANHYST_OK ||
      (settings->plain != NULL && anhyst_map_check_x(settings->plain) != ANHYST_OK) ||
      !are_valid(limits, settings)) {
    return ANHYST_BAD_PARAMETER;
  }
  *c = fresh;
  c->limits = limits;
  c->settings = settings;
  c->magnet[0] = magnet;
  c->magnet[1] = magnet_2;
  for (int i = 0; i < magnet_count(c); i++) {
    c->current[i] = zero_current(limits);
  }
  anhyst_levitation_start(&c->levitation);
  return ANHYST_OK;
}

/* Whether no current was driven at the tick before. */
static uint16_t is_at_zero(const anhyst_position_x *c)
{
  const ANHYST_REAL zero = zero_current(c->limits);
  return c->current[0] == zero && (c->magnet[1] == NULL || c->current[1] == zero) ? 1U : 0U;
}

uint16_t anhyst_position_command_x(anhyst_position_x *c, uint16_t command)
{
  const uint16_t refused = anhyst_levitation_command(&c->levitation, command, is_at_zero(c));
  if (refused == ANHYST_REFUSED_NOT && command == ANHYST_COMMAND_DEMAGNETISED) {
    for (int i = 0; i < magnet_count(c); i++) {
      anhyst_force_controller_demagnetise_x(c->magnet[i]);
    }
  }
  return refused;
}

/* Ticks until both magnets are through with their conditioning. */
static int32_t conditioning(const anhyst_position_x *c)
{
  int32_t length = 0;
  for (int i = 0; i < magnet_count(c); i++) {
    const int32_t one = anhyst_force_controller_conditioning_length_x(c->magnet[i]);
    length = one > length ? one : length;
  }
  return length;
}

/* Lets levitation judge the sample and move on; keeps position and gaps. */
static void levitate(anhyst_position_x *c, const anhyst_position_sample_x *sample)
{
  const anhyst_position_units_x *units = &c->settings->units;
  anhyst_levitation_input input;
  input.position = position_code(units, sample->position);
  input.target = position_code(units, sample->target);
  input.demand = demand_code(units, c->demand);
  input.conditioning = conditioning(c);
  input.dropped = sample->dropped != 0U || !is_number(sample->position) ? 1U : 0U;
  anhyst_levitation_tick(&c->levitation, &c->limits->levitation, &c->settings->levitation, &input);
  c->flags |= c->levitation.flags;
  if ((c->flags & ANHYST_SAMPLE_IMPLAUSIBLE) == 0U) {
    c->position = sample->position;
  }
  for (int i = 0; i < magnet_count(c); i++) {
    c->gap[i] = gap_of(&units->gap[i], c->position);
  }
}

/* The net force that the position asks for. */
static ANHYST_REAL control(anhyst_position_x *c, const anhyst_position_sample_x *sample)
{
  const anhyst_pidd2_gains_x *gains = &c->settings->gains;
  const ANHYST_REAL load = is_number(sample->load) ? sample->load : 0;
  const ANHYST_REAL reference = position_of(&c->settings->units, c->levitation.reference);
  if (c->levitation.begins != 0U) {
    anhyst_pidd2_start_x(gains, &c->state, reference, c->position, load, c->demand);
  }
  c->pending = 1;
  return anhyst_pidd2_solve_x(gains, &c->state, reference, c->position, load, &c->candidate);
}

/* The currents that give the demanded net force. */
static void solve(anhyst_position_x *c, const anhyst_position_sample_x *sample, ANHYST_REAL *wanted)
{
  const int magnets = magnet_count(c);
  ANHYST_REAL force[ANHYST_POSITION_MAGNETS] = {c->demand, 0};
  if (magnets == 2) {
    force[0] = anhyst_add_x(c->settings->bias, half(c->demand));
    force[1] = anhyst_sub_x(force[0], c->demand);
  }
  for (int i = 0; i < magnets; i++) {
    wanted[i] = anhyst_force_controller_solve_x(c->magnet[i], force[i], c->gap[i], sample->flux[i]);
    c->flags |= c->magnet[i]->flags;
  }
}

/* A step of a current on its way to zero. What holds an armature in the air is unstable: a current
   that stays lets it go to either side, faster and faster. So, where a fall begins, one magnet lets
   go of an eighth at once, which sends the armature away from it and not into it, and of the rest
   along the ramp, which is softer than a free fall. Two magnets that pull against each other let go
   of everything: what neither pulls only drifts. */
static ANHYST_REAL release(const anhyst_position_x *c, ANHYST_REAL current)
{
  const ANHYST_REAL release = c->limits->release;
  const ANHYST_REAL zero = zero_current(c->limits);
  ANHYST_REAL from = current;
  if (c->levitation.let_go != 0U) {
    const ANHYST_REAL eighth = half(half(half(anhyst_sub_x(current, zero))));
    from = c->magnet[1] != NULL ? zero : anhyst_sub_x(current, eighth);
  }
  return within(zero, anhyst_sub_x(from, release), anhyst_add_x(from, release));
}

/* The currents that this phase asks for, before the limits of the board. */
static void want(anhyst_position_x *c, const anhyst_position_sample_x *sample, ANHYST_REAL *wanted)
{
  const uint16_t phase = c->levitation.phase;
  if (phase == ANHYST_PHASE_REST || phase == ANHYST_PHASE_FALL) {
    if (phase == ANHYST_PHASE_REST) {
      c->demand = 0; /* a fall keeps it: a landing out of it begins with it */
    }
    for (int i = 0; i < magnet_count(c); i++) {
      wanted[i] = release(c, c->current[i]);
    }
  } else if (phase == ANHYST_PHASE_CONDITION) {
    c->demand = 0;
    for (int i = 0; i < magnet_count(c); i++) {
      wanted[i] =
          anhyst_force_controller_conditioning_x(c->magnet[i], c->levitation.supervisor.step);
    }
  } else {
    c->demand = anhyst_levitation_controls(&c->levitation)
                    ? control(c, sample)
                    : demand_of(&c->settings->units, c->levitation.demand);
    solve(c, sample, wanted);
  }
}

/* A current of this phase, and what is left of the current before a swap or a switch: less of it by
   one step of the ramp to zero at every tick. On that ramp itself there is no step to soften. */
static ANHYST_REAL faded(anhyst_position_x *c, int magnet, ANHYST_REAL wanted)
{
  const ANHYST_REAL release = c->limits->release;
  const ANHYST_REAL left = c->fading[magnet];
  const int ramps =
      c->levitation.phase == ANHYST_PHASE_REST || c->levitation.phase == ANHYST_PHASE_FALL;
  c->fading[magnet] = ramps ? 0 : anhyst_sub_x(left, within(left, -release, release));
  return anhyst_add_x(wanted, c->fading[magnet]);
}

/* Applies what is wanted as far as the board lets it. */
static void apply(anhyst_position_x *c, const ANHYST_REAL *wanted)
{
  const anhyst_position_limits_x *limits = c->limits;
  for (int i = 0; i < magnet_count(c); i++) {
    const ANHYST_REAL asked = faded(c, i, wanted[i]);
    const ANHYST_REAL reached = within(asked, limits->current_low, limits->current_high);
    if (reached != asked) {
      c->flags |= ANHYST_CURRENT_LIMITED;
    }
    c->current[i] = on_grid(limits, reached);
  }
  c->limited = c->flags & (ANHYST_DEMAND_LIMITED | ANHYST_CURRENT_LIMITED | ANHYST_FLUX_LIMITED);
}

/* Commits to force controllers and PIDD2 what was applied. */
static void commit(anhyst_position_x *c, const ANHYST_REAL *applied)
{
  ANHYST_REAL force = anhyst_force_controller_commit_x(c->magnet[0], applied[0], c->gap[0]);
  if (c->magnet[1] != NULL) {
    force =
        anhyst_sub_x(force, anhyst_force_controller_commit_x(c->magnet[1], applied[1], c->gap[1]));
  }
  if (c->pending != 0U) {
    anhyst_pidd2_commit_x(&c->settings->gains, &c->state, &c->candidate,
                          c->limited != 0U ? force : c->candidate.output);
    c->pending = 0;
  }
}

void anhyst_position_tick_x(anhyst_position_x *c, const anhyst_position_sample_x *sample,
                            anhyst_position_answer_x *out)
{
  ANHYST_REAL wanted[ANHYST_POSITION_MAGNETS] = {0, 0};
  const uint16_t measured = c->settings->measured;
  const uint16_t refused = anhyst_position_command_x(c, sample->command);
  c->flags = refused != ANHYST_REFUSED_NOT ? ANHYST_COMMAND_REFUSED : 0U;
  levitate(c, sample);
  if (measured != 0U) {
    commit(c, sample->current);
  }
  want(c, sample, wanted);
  apply(c, wanted);
  if (measured == 0U) {
    commit(c, c->current);
  }
  out->current[0] = c->current[0];
  out->current[1] = c->current[1];
  out->reference = anhyst_levitation_controls(&c->levitation)
                       ? position_of(&c->settings->units, c->levitation.reference)
                       : c->position;
  out->demand = c->demand;
  out->state = (uint16_t)(16U * c->levitation.supervisor.state + c->levitation.phase);
  out->flags = c->flags;
}
