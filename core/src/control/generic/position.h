/* SPDX-License-Identifier: Apache-2.0 */

/* What follows is the same in every format; the few operations in which they differ stand before
   it: position.c for q31, generic/position_real.h for the others. */

static int ANHYST_NAME(magnets)(const ANHYST_NAME(anhyst_position) *c)
{
  return c->magnet[1] != NULL ? 2 : 1;
}

/* What counts as no current: of those that can be driven the nearest to it. */
static ANHYST_REAL ANHYST_NAME(zero)(const ANHYST_NAME(anhyst_position_limits) *limits)
{
  return ANHYST_NAME(on_grid)(limits,
                              ANHYST_NAME(within)(0, limits->current_low, limits->current_high));
}

anhyst_status ANHYST_NAME(anhyst_position_init)(
    ANHYST_NAME(anhyst_position) *c, const ANHYST_NAME(anhyst_position_limits) *limits,
    const ANHYST_NAME(anhyst_position_settings) *settings,
    ANHYST_NAME(anhyst_force_controller) *magnet, ANHYST_NAME(anhyst_force_controller) *magnet_2)
{
  const ANHYST_NAME(anhyst_position) fresh = {0};
  if (anhyst_levitation_check(&limits->levitation, &settings->levitation) != ANHYST_OK ||
      ANHYST_NAME(anhyst_pidd2_check)(&settings->gains) != ANHYST_OK ||
      (settings->plain != NULL && ANHYST_NAME(anhyst_map_check)(settings->plain) != ANHYST_OK) ||
      !ANHYST_NAME(are_valid)(limits, settings)) {
    return ANHYST_BAD_PARAMETER;
  }
  *c = fresh;
  c->limits = limits;
  c->settings = settings;
  c->magnet[0] = magnet;
  c->magnet[1] = magnet_2;
  for (int i = 0; i < ANHYST_NAME(magnets)(c); i++) {
    c->current[i] = ANHYST_NAME(zero)(limits);
  }
  anhyst_levitation_start(&c->levitation);
  return ANHYST_OK;
}

/* Whether no current was driven at the tick before. */
static uint16_t ANHYST_NAME(is_at_zero)(const ANHYST_NAME(anhyst_position) *c)
{
  const ANHYST_REAL zero = ANHYST_NAME(zero)(c->limits);
  return c->current[0] == zero && (c->magnet[1] == NULL || c->current[1] == zero) ? 1U : 0U;
}

uint16_t ANHYST_NAME(anhyst_position_command)(ANHYST_NAME(anhyst_position) *c, uint16_t command)
{
  const uint16_t refused =
      anhyst_levitation_command(&c->levitation, command, ANHYST_NAME(is_at_zero)(c));
  if (refused == ANHYST_REFUSED_NOT && command == ANHYST_COMMAND_DEMAGNETISED) {
    for (int i = 0; i < ANHYST_NAME(magnets)(c); i++) {
      ANHYST_NAME(anhyst_force_controller_demagnetise)(c->magnet[i]);
    }
  }
  return refused;
}

/* Ticks until both magnets are through with their conditioning. */
static int32_t ANHYST_NAME(conditioning)(const ANHYST_NAME(anhyst_position) *c)
{
  int32_t length = 0;
  for (int i = 0; i < ANHYST_NAME(magnets)(c); i++) {
    const int32_t one = ANHYST_NAME(anhyst_force_controller_conditioning_length)(c->magnet[i]);
    length = one > length ? one : length;
  }
  return length;
}

/* Lets levitation judge the sample and move on; keeps position and gaps. */
static void ANHYST_NAME(levitate)(ANHYST_NAME(anhyst_position) *c,
                                  const ANHYST_NAME(anhyst_position_sample) *sample)
{
  const ANHYST_NAME(anhyst_position_units) *units = &c->settings->units;
  anhyst_levitation_input input;
  input.position = ANHYST_NAME(position_code)(units, sample->position);
  input.target = ANHYST_NAME(position_code)(units, sample->target);
  input.demand = ANHYST_NAME(demand_code)(units, c->demand);
  input.conditioning = ANHYST_NAME(conditioning)(c);
  input.dropped = sample->dropped != 0U || !ANHYST_NAME(is_number)(sample->position) ? 1U : 0U;
  anhyst_levitation_tick(&c->levitation, &c->limits->levitation, &c->settings->levitation, &input);
  c->flags |= c->levitation.flags;
  if ((c->flags & ANHYST_SAMPLE_IMPLAUSIBLE) == 0U) {
    c->position = sample->position;
  }
  for (int i = 0; i < ANHYST_NAME(magnets)(c); i++) {
    c->gap[i] = ANHYST_NAME(gap_of)(&units->gap[i], c->position);
  }
}

/* The net force that the position asks for. */
static ANHYST_REAL ANHYST_NAME(control)(ANHYST_NAME(anhyst_position) *c,
                                        const ANHYST_NAME(anhyst_position_sample) *sample)
{
  const ANHYST_NAME(anhyst_pidd2_gains) *gains = &c->settings->gains;
  const ANHYST_REAL load = ANHYST_NAME(is_number)(sample->load) ? sample->load : 0;
  const ANHYST_REAL reference =
      ANHYST_NAME(position_of)(&c->settings->units, c->levitation.reference);
  if (c->levitation.begins != 0U) {
    ANHYST_NAME(anhyst_pidd2_start)(gains, &c->state, reference, c->position, load, c->demand);
  }
  c->pending = 1;
  return ANHYST_NAME(anhyst_pidd2_solve)(gains, &c->state, reference, c->position, load,
                                         &c->candidate);
}

/* The currents that give the demanded net force. */
static void ANHYST_NAME(solve)(ANHYST_NAME(anhyst_position) *c,
                               const ANHYST_NAME(anhyst_position_sample) *sample,
                               ANHYST_REAL *wanted)
{
  const int magnets = ANHYST_NAME(magnets)(c);
  ANHYST_REAL force[ANHYST_POSITION_MAGNETS] = {c->demand, 0};
  if (magnets == 2) {
    force[0] = ANHYST_NAME(anhyst_add)(c->settings->bias, ANHYST_NAME(half)(c->demand));
    force[1] = ANHYST_NAME(anhyst_sub)(force[0], c->demand);
  }
  for (int i = 0; i < magnets; i++) {
    wanted[i] = ANHYST_NAME(anhyst_force_controller_solve)(c->magnet[i], force[i], c->gap[i],
                                                           sample->flux[i]);
    c->flags |= c->magnet[i]->flags;
  }
}

/* A step of a current on its way to zero. What holds an armature in the air is unstable: a current
   that stays lets it go to either side, faster and faster. So, where a fall begins, one magnet lets
   go of an eighth at once, which sends the armature away from it and not into it, and of the rest
   along the ramp, which is softer than a free fall. Two magnets that pull against each other let go
   of everything: what neither pulls only drifts. */
static ANHYST_REAL ANHYST_NAME(release)(const ANHYST_NAME(anhyst_position) *c, ANHYST_REAL current)
{
  const ANHYST_REAL release = c->limits->release;
  const ANHYST_REAL zero = ANHYST_NAME(zero)(c->limits);
  ANHYST_REAL from = current;
  if (c->levitation.let_go != 0U) {
    const ANHYST_REAL eighth = ANHYST_NAME(half)(
        ANHYST_NAME(half)(ANHYST_NAME(half)(ANHYST_NAME(anhyst_sub)(current, zero))));
    from = c->magnet[1] != NULL ? zero : ANHYST_NAME(anhyst_sub)(current, eighth);
  }
  return ANHYST_NAME(within)(zero, ANHYST_NAME(anhyst_sub)(from, release),
                             ANHYST_NAME(anhyst_add)(from, release));
}

/* The currents that this phase asks for, before the limits of the board. */
static void ANHYST_NAME(want)(ANHYST_NAME(anhyst_position) *c,
                              const ANHYST_NAME(anhyst_position_sample) *sample,
                              ANHYST_REAL *wanted)
{
  const uint16_t phase = c->levitation.phase;
  if (phase == ANHYST_PHASE_REST || phase == ANHYST_PHASE_FALL) {
    if (phase == ANHYST_PHASE_REST) {
      c->demand = 0; /* a fall keeps it: a landing out of it begins with it */
    }
    for (int i = 0; i < ANHYST_NAME(magnets)(c); i++) {
      wanted[i] = ANHYST_NAME(release)(c, c->current[i]);
    }
  } else if (phase == ANHYST_PHASE_CONDITION) {
    c->demand = 0;
    for (int i = 0; i < ANHYST_NAME(magnets)(c); i++) {
      wanted[i] = ANHYST_NAME(anhyst_force_controller_conditioning)(c->magnet[i],
                                                                    c->levitation.supervisor.step);
    }
  } else {
    c->demand = anhyst_levitation_controls(&c->levitation)
                    ? ANHYST_NAME(control)(c, sample)
                    : ANHYST_NAME(demand_of)(&c->settings->units, c->levitation.demand);
    ANHYST_NAME(solve)(c, sample, wanted);
  }
}

/* A current of this phase, and what is left of the current before a swap or a switch: less of it by
   one step of the ramp to zero at every tick. On that ramp itself there is no step to soften. */
static ANHYST_REAL ANHYST_NAME(faded)(ANHYST_NAME(anhyst_position) *c, int magnet,
                                      ANHYST_REAL wanted)
{
  const ANHYST_REAL release = c->limits->release;
  const ANHYST_REAL left = c->fading[magnet];
  const int ramps =
      c->levitation.phase == ANHYST_PHASE_REST || c->levitation.phase == ANHYST_PHASE_FALL;
  c->fading[magnet] =
      ramps ? 0 : ANHYST_NAME(anhyst_sub)(left, ANHYST_NAME(within)(left, -release, release));
  return ANHYST_NAME(anhyst_add)(wanted, c->fading[magnet]);
}

/* Applies what is wanted as far as the board lets it. */
static void ANHYST_NAME(apply)(ANHYST_NAME(anhyst_position) *c, const ANHYST_REAL *wanted)
{
  const ANHYST_NAME(anhyst_position_limits) *limits = c->limits;
  for (int i = 0; i < ANHYST_NAME(magnets)(c); i++) {
    const ANHYST_REAL asked = ANHYST_NAME(faded)(c, i, wanted[i]);
    const ANHYST_REAL reached =
        ANHYST_NAME(within)(asked, limits->current_low, limits->current_high);
    if (reached != asked) {
      c->flags |= ANHYST_CURRENT_LIMITED;
    }
    c->current[i] = ANHYST_NAME(on_grid)(limits, reached);
  }
  c->limited = c->flags & (ANHYST_DEMAND_LIMITED | ANHYST_CURRENT_LIMITED | ANHYST_FLUX_LIMITED);
}

/* Commits to force controllers and PIDD2 what was applied. */
static void ANHYST_NAME(commit)(ANHYST_NAME(anhyst_position) *c, const ANHYST_REAL *applied)
{
  ANHYST_REAL force =
      ANHYST_NAME(anhyst_force_controller_commit)(c->magnet[0], applied[0], c->gap[0]);
  if (c->magnet[1] != NULL) {
    force = ANHYST_NAME(anhyst_sub)(
        force, ANHYST_NAME(anhyst_force_controller_commit)(c->magnet[1], applied[1], c->gap[1]));
  }
  if (c->pending != 0U) {
    ANHYST_NAME(anhyst_pidd2_commit)(&c->settings->gains, &c->state, &c->candidate,
                                     c->limited != 0U ? force : c->candidate.output);
    c->pending = 0;
  }
}

void ANHYST_NAME(anhyst_position_tick)(ANHYST_NAME(anhyst_position) *c,
                                       const ANHYST_NAME(anhyst_position_sample) *sample,
                                       ANHYST_NAME(anhyst_position_answer) *out)
{
  ANHYST_REAL wanted[ANHYST_POSITION_MAGNETS] = {0, 0};
  const uint16_t measured = c->settings->measured;
  const uint16_t refused = ANHYST_NAME(anhyst_position_command)(c, sample->command);
  c->flags = refused != ANHYST_REFUSED_NOT ? ANHYST_COMMAND_REFUSED : 0U;
  ANHYST_NAME(levitate)(c, sample);
  if (measured != 0U) {
    ANHYST_NAME(commit)(c, sample->current);
  }
  ANHYST_NAME(want)(c, sample, wanted);
  ANHYST_NAME(apply)(c, wanted);
  if (measured == 0U) {
    ANHYST_NAME(commit)(c, c->current);
  }
  out->current[0] = c->current[0];
  out->current[1] = c->current[1];
  out->reference = anhyst_levitation_controls(&c->levitation)
                       ? ANHYST_NAME(position_of)(&c->settings->units, c->levitation.reference)
                       : c->position;
  out->demand = c->demand;
  out->state = (uint16_t)(16U * c->levitation.supervisor.state + c->levitation.phase);
  out->flags = c->flags;
}
