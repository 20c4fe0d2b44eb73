/* SPDX-License-Identifier: Apache-2.0 */
/* A whole tick of the controller of an axis: any valid settings, any state, any sample, a pair of
   drives and a filter. Filter, PIDD2, allocation and force controllers give way to what their own
   proofs show of them: each call is shown to be allowed, and answers anything. The currents stay
   within the limits. */
#define ANHYST_PORT_HEADER "contracts.h"
#include "any.h"

#include "control/tracking.c"

static anhyst_tracking_settings_q31 settings;
static anhyst_biquad_q31 filter;

static int is_current(int32_t current)
{
  return current >= settings.current_low && current <= settings.current_high;
}

/* ---- contracts ---- */

/* All but the remainder of the converter's steps, on which on_grid_q31 alone depends. */
static int are_limits_q31(const anhyst_tracking_settings_q31 *of)
{
  return of->current_low <= of->current_high && of->current_step >= 0 && nondet_i16() != 0;
}

static int32_t on_grid_q31(const anhyst_tracking_settings_q31 *of, int32_t current)
{
  SHOW(of == &settings && is_current(current) && of->current_step > 0);
  return any_within(settings.current_low, settings.current_high);
}

anhyst_status anhyst_pidd2_check_q31(const anhyst_pidd2_gains_q31 *gains)
{
  return nondet_i16() != 0 || gains->low > gains->high ? ANHYST_BAD_PARAMETER : ANHYST_OK;
}

static int position_holds(const anhyst_pidd2_state_q31 *state)
{
  return state->position >= -ANHYST_Q30_ONE && state->position < ANHYST_Q30_ONE;
}

static anhyst_pidd2_state_q31 any_state(void)
{
  const anhyst_pidd2_state_q31 state = {any_within(-ANHYST_Q30_ONE, ANHYST_Q30_ONE - 1),
                                        nondet_i32(), nondet_i32()};
  return state;
}

int32_t anhyst_pidd2_solve_q31(const anhyst_pidd2_gains_q31 *gains,
                               const anhyst_pidd2_state_q31 *state, int32_t reference,
                               int32_t position, int32_t load,
                               anhyst_pidd2_candidate_q31 *candidate)
{
  SHOW(gains == &settings.pid && position_holds(state));
  candidate->next = any_state();
  candidate->output = any_within(settings.pid.low, settings.pid.high);
  return candidate->output;
}

void anhyst_pidd2_commit_q31(const anhyst_pidd2_gains_q31 *gains, anhyst_pidd2_state_q31 *state,
                             const anhyst_pidd2_candidate_q31 *candidate, int32_t applied)
{
  SHOW(gains == &settings.pid && position_holds(&candidate->next));
  *state = any_state();
}

anhyst_status anhyst_biquad_check_q31(const anhyst_biquad_q31 *of)
{
  SHOW(of == &filter);
  return nondet_i16() != 0 ? ANHYST_BAD_PARAMETER : ANHYST_OK;
}

int32_t anhyst_biquad_step_q31(const anhyst_biquad_q31 *of, anhyst_biquad_state_q31 *state,
                               int32_t in)
{
  SHOW(of == &filter);
  state->integral[0] = nondet_i32();
  state->integral[1] = nondet_i32();
  return nondet_i32();
}

int anhyst_allocation_is_valid_q31(const anhyst_allocation_q31 *allocation)
{
  return allocation->idle > 0 && nondet_i16() != 0;
}

void anhyst_allocate_q31(const anhyst_allocation_q31 *allocation, int32_t net, int32_t force[2])
{
  SHOW(allocation == &settings.allocation && allocation->idle > 0);
  force[0] = nondet_i32();
  force[1] = nondet_i32();
}

/* Any method of a force controller. */
static int32_t any_current(anhyst_force_controller_q31 *drive, int32_t demand, int32_t gap,
                           int32_t flux)
{
  drive->flags = nondet_u16();
  return nondet_i32();
}

static int32_t any_force(anhyst_force_controller_q31 *drive, int32_t applied, int32_t gap)
{
  SHOW(is_current(applied));
  return nondet_i32();
}

/* ---- proof ---- */

int main(void)
{
  const anhyst_force_method_q31 method = {any_current, any_force, 0, 0, 0, 0, 0};
  anhyst_force_controller_q31 magnet[2];
  anhyst_force_controller_q31 *const drive[2] = {&magnet[0], &magnet[1]};
  anhyst_biquad_state_q31 filtered;
  anhyst_tracking_q31 c;
  anhyst_tracking_settings_q31 any_settings;
  settings = any_settings;
  settings.filter = &filter;
  ASSUME(settings.filters <= 1);
  magnet[0].method = &method;
  magnet[1].method = &method;
  ASSUME(anhyst_tracking_init_q31(&c, &settings, drive, 2, &filtered) == ANHYST_OK);
  SHOW(position_holds(&c.state));
  SHOW(c.settings == &settings && c.drive == drive && c.drives == 2 && c.filtered == &filtered);
  /* the same in so many words, from any state */
  c.settings = &settings;
  c.drive = drive;
  c.drives = 2;
  c.filtered = &filtered;
  c.state = any_state();
  filtered.integral[0] = nondet_i32();
  filtered.integral[1] = nondet_i32();
  const int32_t gap[2] = {nondet_i32(), nondet_i32()};
  const int32_t flux[2] = {nondet_i32(), nondet_i32()};
  const anhyst_tracking_sample_q31 sample = {nondet_i32(), nondet_i32(), gap, flux};
  int32_t current[2];
  anhyst_tracking_answer_q31 answer = {current, 0, 0};
  anhyst_tracking_tick_q31(&c, &sample, &answer);
  SHOW(is_current(current[0]) && is_current(current[1]));
  SHOW(position_holds(&c.state));
  return 0;
}
