/* SPDX-License-Identifier: Apache-2.0 */

/* Template: the position controller, for every number format. The operations that depend on the
   format are included before: position.c for q31, position_real.h for floating point. */

static int magnet_count(const anhyst_position_x *c) { return c->magnet[1] != NULL ? 2 : 1; }

/* Returns the current nearest to zero that the D/A converter can produce. */
static ANHYST_REAL zero_current(const anhyst_position_limits_x *limits)
{
  return round_to_grid(limits, clamp(0, limits->current_low, limits->current_high));
}

anhyst_status anhyst_position_init_x(anhyst_position_x *c, const anhyst_position_limits_x *limits,
                                     const anhyst_position_settings_x *settings,
                                     anhyst_force_controller_x *magnet,
                                     anhyst_force_controller_x *magnet_2)
{
  const anhyst_position_x initial = {0};
  if (anhyst_levitation_check(&limits->levitation, &settings->levitation) != ANHYST_OK ||
      anhyst_pidd2_check_x(&settings->gains) != ANHYST_OK ||
      (settings->plain != NULL && anhyst_map_check_x(settings->plain) != ANHYST_OK) ||
      !are_settings_valid(limits, settings)) {
    return ANHYST_BAD_PARAMETER;
  }
  *c = initial;
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

static uint16_t is_at_zero(const anhyst_position_x *c)
{
  const ANHYST_REAL zero = zero_current(c->limits);
  return c->current[0] == zero && (c->magnet[1] == NULL || c->current[1] == zero) ? 1U : 0U;
}

uint16_t anhyst_position_command_x(anhyst_position_x *c, uint16_t command)
{
  const uint16_t reason = anhyst_levitation_command(&c->levitation, command, is_at_zero(c));
  if (reason == ANHYST_REFUSED_NOT && command == ANHYST_COMMAND_DEMAGNETISED) {
    for (int i = 0; i < magnet_count(c); i++) {
      anhyst_force_controller_demagnetise_x(c->magnet[i]);
    }
  }
  return reason;
}

/* Returns the length of the longer conditioning sequence of the magnets, ticks. */
static int32_t conditioning_ticks(const anhyst_position_x *c)
{
  int32_t length = 0;
  for (int i = 0; i < magnet_count(c); i++) {
    const int32_t ticks = anhyst_force_controller_conditioning_length_x(c->magnet[i]);
    length = ticks > length ? ticks : length;
  }
  return length;
}

/* Updates the levitation state with a sample, and stores position and gaps. */
static void update_levitation(anhyst_position_x *c, const anhyst_position_sample_x *sample)
{
  const anhyst_position_units_x *units = &c->settings->units;
  anhyst_levitation_input input;
  input.position = position_to_code(units, sample->position);
  input.target = position_to_code(units, sample->target);
  input.demand = demand_to_code(units, c->demand);
  input.conditioning = conditioning_ticks(c);
  input.dropped = sample->dropped != 0U || !is_number(sample->position) ? 1U : 0U;
  anhyst_levitation_tick(&c->levitation, &c->limits->levitation, &c->settings->levitation, &input);
  c->flags |= c->levitation.flags;
  if ((c->flags & ANHYST_SAMPLE_IMPLAUSIBLE) == 0U) {
    c->position = sample->position;
  }
  for (int i = 0; i < magnet_count(c); i++) {
    c->gap[i] = position_to_gap(&units->gap[i], c->position);
  }
}

/* Returns the net force that the position controller demands. */
static ANHYST_REAL solve_position(anhyst_position_x *c, const anhyst_position_sample_x *sample)
{
  const anhyst_pidd2_gains_x *gains = &c->settings->gains;
  const ANHYST_REAL load = is_number(sample->load) ? sample->load : 0;
  const ANHYST_REAL reference = code_to_position(&c->settings->units, c->levitation.reference);
  if (c->levitation.starts_control != 0U) {
    anhyst_pidd2_start_x(gains, &c->state, reference, c->position, load, c->demand);
  }
  c->pending = 1;
  return anhyst_pidd2_solve_x(gains, &c->state, reference, c->position, load, &c->candidate);
}

static void solve_currents(anhyst_position_x *c, const anhyst_position_sample_x *sample,
                           ANHYST_REAL *demanded)
{
  const int magnets = magnet_count(c);
  ANHYST_REAL force[ANHYST_POSITION_MAGNETS] = {c->demand, 0};
  if (magnets == 2) {
    force[0] = anhyst_add_x(c->settings->bias, half(c->demand));
    force[1] = anhyst_sub_x(force[0], c->demand);
  }
  for (int i = 0; i < magnets; i++) {
    demanded[i] =
        anhyst_force_controller_solve_x(c->magnet[i], force[i], c->gap[i], sample->flux[i]);
    c->flags |= c->magnet[i]->flags;
  }
}

/* Returns the next current of a ramp to zero. A levitated armature is unstable: a constant current
   would accelerate it in either direction. Therefore, a single magnet reduces its current by an
   eighth immediately at the start of a fall, so that the armature moves away from the magnet. The
   remaining current follows the ramp, which is softer than a free fall. Two magnets that pull
   against each other switch off immediately, because an armature without forces only drifts. */
static ANHYST_REAL ramp_to_zero(const anhyst_position_x *c, ANHYST_REAL current)
{
  const ANHYST_REAL release = c->limits->release;
  const ANHYST_REAL zero = zero_current(c->limits);
  ANHYST_REAL from = current;
  if (c->levitation.starts_fall != 0U) {
    const ANHYST_REAL eighth = half(half(half(anhyst_sub_x(current, zero))));
    from = c->magnet[1] != NULL ? zero : anhyst_sub_x(current, eighth);
  }
  return clamp(zero, anhyst_sub_x(from, release), anhyst_add_x(from, release));
}

/* Computes the currents of the present phase, before limits and rounding. */
static void compute_currents(anhyst_position_x *c, const anhyst_position_sample_x *sample,
                             ANHYST_REAL *demanded)
{
  const uint16_t phase = c->levitation.phase;
  if (phase == ANHYST_PHASE_REST || phase == ANHYST_PHASE_FALL) {
    if (phase == ANHYST_PHASE_REST) {
      c->demand = 0; /* state FALL keeps the demand, because a landing starts with it */
    }
    for (int i = 0; i < magnet_count(c); i++) {
      demanded[i] = ramp_to_zero(c, c->current[i]);
    }
  } else if (phase == ANHYST_PHASE_CONDITION) {
    c->demand = 0;
    for (int i = 0; i < magnet_count(c); i++) {
      demanded[i] =
          anhyst_force_controller_conditioning_x(c->magnet[i], c->levitation.supervisor.step);
    }
  } else {
    c->demand = anhyst_levitation_controls(&c->levitation)
                    ? solve_position(c, sample)
                    : code_to_demand(&c->settings->units, c->levitation.demand);
    solve_currents(c, sample, demanded);
  }
}

/* Returns a demanded current plus the decaying jump of a block swap or a method change. The jump
   decreases by one step of the ramp in each tick. During a ramp to zero, the jump is zero. */
static ANHYST_REAL add_fading_jump(anhyst_position_x *c, int magnet, ANHYST_REAL demanded)
{
  const ANHYST_REAL release = c->limits->release;
  const ANHYST_REAL jump = c->fading[magnet];
  const int is_ramping =
      c->levitation.phase == ANHYST_PHASE_REST || c->levitation.phase == ANHYST_PHASE_FALL;
  c->fading[magnet] = is_ramping ? 0 : anhyst_sub_x(jump, clamp(jump, -release, release));
  return anhyst_add_x(demanded, c->fading[magnet]);
}

/* Limits the demanded currents, and rounds them to the grid of the D/A converter. */
static void apply_currents(anhyst_position_x *c, const ANHYST_REAL *demanded)
{
  const anhyst_position_limits_x *limits = c->limits;
  for (int i = 0; i < magnet_count(c); i++) {
    const ANHYST_REAL with_jump = add_fading_jump(c, i, demanded[i]);
    const ANHYST_REAL limited = clamp(with_jump, limits->current_low, limits->current_high);
    if (limited != with_jump) {
      c->flags |= ANHYST_CURRENT_LIMITED;
    }
    c->current[i] = round_to_grid(limits, limited);
  }
  c->limited = c->flags & (ANHYST_DEMAND_LIMITED | ANHYST_CURRENT_LIMITED | ANHYST_FLUX_LIMITED);
}

static void commit_currents(anhyst_position_x *c, const ANHYST_REAL *applied)
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
  ANHYST_REAL demanded[ANHYST_POSITION_MAGNETS] = {0, 0};
  const uint16_t measured = c->settings->measured;
  const uint16_t reason = anhyst_position_command_x(c, sample->command);
  c->flags = reason != ANHYST_REFUSED_NOT ? ANHYST_COMMAND_REFUSED : 0U;
  update_levitation(c, sample);
  if (measured != 0U) {
    commit_currents(c, sample->current);
  }
  compute_currents(c, sample, demanded);
  apply_currents(c, demanded);
  if (measured == 0U) {
    commit_currents(c, c->current);
  }
  out->current[0] = c->current[0];
  out->current[1] = c->current[1];
  out->reference = anhyst_levitation_controls(&c->levitation)
                       ? code_to_position(&c->settings->units, c->levitation.reference)
                       : c->position;
  out->demand = c->demand;
  out->state = (uint16_t)(16U * c->levitation.supervisor.state + c->levitation.phase);
  out->flags = c->flags;
}
