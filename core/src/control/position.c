/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/control/position.h"

#include "anhyst/numeric/q31.h"

#include <stddef.h>

/* Positions and demands are already integers in the format of levitation.h. */

static int32_t position_to_code(const anhyst_position_units_q31 *units, int32_t position)
{
  (void)units;
  return position;
}

static int32_t code_to_position(const anhyst_position_units_q31 *units, int32_t code)
{
  (void)units;
  return code;
}

static int32_t demand_to_code(const anhyst_position_units_q31 *units, int32_t demand)
{
  (void)units;
  return demand;
}

static int32_t code_to_demand(const anhyst_position_units_q31 *units, int32_t code)
{
  (void)units;
  return code;
}

static int is_number(int32_t a)
{
  (void)a;
  return 1;
}

static int32_t half(int32_t a) { return a >> 1; }
static int32_t clamp(int32_t a, int32_t low, int32_t high) { return anhyst_clamp(a, low, high); }

static int32_t position_to_gap(const anhyst_gap_line_q31 *line, int32_t position)
{
  const int32_t gap_change = anhyst_shl_q31(anhyst_factor_product(position, line->factor), 1);
  return anhyst_add_q31(line->offset, gap_change);
}

static uint32_t current_range(int32_t low, int32_t high) { return (uint32_t)high - (uint32_t)low; }

static int32_t round_to_grid(const anhyst_position_limits_q31 *limits, int32_t current)
{
  const uint32_t step = (uint32_t)limits->current_step;
  const uint32_t offset = current_range(limits->current_low, current);
  const uint32_t remainder = offset % step;
  const uint32_t rounded =
      remainder >= step - remainder ? offset - remainder + step : offset - remainder;
  return (int32_t)((uint32_t)limits->current_low + rounded);
}

static int are_settings_valid(const anhyst_position_limits_q31 *limits,
                              const anhyst_position_settings_q31 *settings)
{
  int are_factors_valid = 1;
  for (int i = 0; i < ANHYST_POSITION_MAGNETS; i++) {
    are_factors_valid = are_factors_valid && anhyst_factor_is_valid(settings->units.gap[i].factor);
  }
  return are_factors_valid && limits->current_low < limits->current_high &&
         limits->current_step > 0 &&
         current_range(limits->current_low, limits->current_high) %
                 (uint32_t)limits->current_step ==
             0U &&
         limits->release >= limits->current_step;
}

#include "generic/position.h"

/* Computes the currents of the force controllers again, for the demand of the last tick. */
static void recompute_currents(anhyst_position_q31 *c, int32_t *demanded)
{
  const int32_t step = c->levitation.supervisor.step;
  const anhyst_position_sample_q31 empty_sample = {
      0, 0, 0, {0, 0}, {ANHYST_NO_FLUX, ANHYST_NO_FLUX}, 0, 0};
  switch (c->levitation.phase) {
  case ANHYST_PHASE_REST:
  case ANHYST_PHASE_FALL:
    break; /* the ramp to zero does not depend on the method */
  case ANHYST_PHASE_CONDITION:
    for (int i = 0; i < magnet_count(c); i++) {
      demanded[i] = anhyst_force_controller_conditioning_q31(c->magnet[i], step > 0 ? step : 0);
    }
    break;
  default:
    solve_currents(c, &empty_sample, demanded);
    break;
  }
}

/* Stores the difference between last applied and newly demanded currents, which then decays. */
static void start_fading(anhyst_position_q31 *c)
{
  int32_t demanded[ANHYST_POSITION_MAGNETS] = {c->current[0], c->current[1]};
  recompute_currents(c, demanded);
  for (int i = 0; i < magnet_count(c); i++) {
    const int32_t limited =
        anhyst_clamp(demanded[i], c->limits->current_low, c->limits->current_high);
    c->fading[i] = anhyst_sub_q31(c->current[i], limited);
  }
}

void anhyst_position_swap_q31(anhyst_position_q31 *c, const int16_t *words)
{
  anhyst_supervisor *supervisor = &c->levitation.supervisor;
  for (int i = 0; i < magnet_count(c); i++) {
    anhyst_force_controller_carry_q31(c->magnet[i], words);
  }
  if (supervisor->conditioning != 0U) {
    supervisor->step = -1; /* starts the conditioning sequence again */
  }
  start_fading(c);
}

/* Returns the controller state of the next tick, which is in the candidate until the commit. */
static anhyst_pidd2_state_q31 *next_state(anhyst_position_q31 *c)
{
  return c->pending != 0U ? &c->candidate.next : &c->state;
}

/* Sets the net force that the force controllers now expect for the present currents. */
static void match_expected_force(anhyst_position_q31 *c)
{
  int32_t *integral = &next_state(c)->integral;
  int32_t force = anhyst_force_controller_expected_q31(c->magnet[0], c->current[0], c->gap[0]);
  if (c->magnet[1] != NULL) {
    force = anhyst_sub_q31(
        force, anhyst_force_controller_expected_q31(c->magnet[1], c->current[1], c->gap[1]));
  }
  *integral = anhyst_add_q31(*integral, (force >> 1) - (c->demand >> 1));
  c->demand = force;
}

anhyst_status anhyst_position_compensate_q31(anhyst_position_q31 *c, int on)
{
  const anhyst_position_limits_q31 *limits = c->limits;
  const anhyst_map_q31 *map = on ? NULL : c->settings->plain;
  const int is_on = c->magnet[0]->method == &anhyst_force_by_compensator_q31;
  if (!on && map == NULL) {
    return ANHYST_BAD_PARAMETER;
  }
  if (is_on != (on != 0)) {
    for (int i = 0; i < magnet_count(c); i++) {
      anhyst_force_controller_bypass_q31(c->magnet[i], map, limits->current_low,
                                         limits->current_high);
    }
    if (anhyst_levitation_controls(&c->levitation)) {
      match_expected_force(c);
    }
    start_fading(c);
  }
  return ANHYST_OK;
}

anhyst_status anhyst_position_retune_q31(anhyst_position_q31 *c,
                                         const anhyst_position_settings_q31 *settings)
{
  const anhyst_pidd2_gains_q31 *from = &c->settings->gains;
  if (anhyst_pidd2_check_q31(&settings->gains) != ANHYST_OK) {
    return ANHYST_BAD_PARAMETER;
  }
  if (anhyst_levitation_controls(&c->levitation)) {
    anhyst_pidd2_change_q31(from, &settings->gains, next_state(c), c->levitation.reference,
                            c->position, 0);
  }
  c->settings = settings;
  return ANHYST_OK;
}
