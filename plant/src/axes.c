/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst_plant/axes.h"

#include "anhyst/control/axes.h"
#include "anhyst/control/states.h"

static double solve_f32(anhyst_force_controller_f64 *c, double demand, double gap, double flux)
{
  anhyst_force_controller_f32 *force = c->own;
  c->current =
      (double)anhyst_force_controller_solve_f32(force, (float)demand, (float)gap, (float)flux);
  c->flags = force->flags;
  return c->current;
}

static double commit_f32(anhyst_force_controller_f64 *c, double applied, double gap)
{
  return (double)anhyst_force_controller_commit_f32(c->own, (float)applied, (float)gap);
}

void anhyst_axes_drive_init_f32(anhyst_force_controller_f64 *c, anhyst_force_controller_f32 *force)
{
  static const anhyst_force_method_f64 by_drive = {.solve = solve_f32, .commit = commit_f32};
  const anhyst_force_controller_f64 initial = {.method = &by_drive, .own = force};
  *c = initial;
}

uint16_t anhyst_axes_state_word(uint16_t state, uint32_t lost)
{
  static const uint16_t phases[] = {ANHYST_PHASE_HOVER, ANHYST_PHASE_DESCEND, ANHYST_PHASE_REST,
                                    ANHYST_PHASE_RISE};
  const int is_at_rest = state == ANHYST_AXES_REST;
  const int is_fault = lost != 0U && (is_at_rest || state == ANHYST_AXES_LAND);
  const unsigned running = is_at_rest ? ANHYST_STATE_READY : ANHYST_STATE_RUN;
  unsigned highest = 0;
  while ((lost & 0xFFFFU) >> highest) {
    highest++;
  }
  return (uint16_t)(256U * highest + 16U * (is_fault ? ANHYST_STATE_FAULT : running) +
                    phases[state]);
}
