/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst_plant/tracking.h"

#include <math.h>

#include "anhyst_plant/sensor.h"

#define ONE 2147483648.0

/* The nearest q31 within its range. */
static int32_t code_q31(double value, double full)
{
  const double place = floor(value / full * ONE + 0.5);
  if (place >= ONE) {
    return ANHYST_Q31_MAX;
  }
  return place > -ONE ? (int32_t)place : ANHYST_Q31_MIN;
}

static int32_t flux_code_q31(double value, double full)
{
  return isnan(value) ? ANHYST_NO_FLUX : code_q31(value, full);
}

static int32_t gap_code_q31(double gap, const anhyst_tracking_scales *scales)
{
  const double low = scales->gap_low;
  return code_q31(anhyst_plant_bound(gap - low, 0.0, scales->gap_high - low),
                  scales->gap_high - low);
}

static double value_q31(int32_t code, double full) { return (double)code / ONE * full; }

#include "anhyst/numeric/q31.h"
#include "generic/tracking.h"
#include "anhyst/numeric/f64.h"
#include "generic/tracking_cast.h"
#include "generic/tracking.h"
#include "anhyst/numeric/f32.h"
#include "generic/tracking_cast.h"
#include "generic/tracking.h"

/* The smaller one as a quotient: a difference of two large forces would lose its digits. */
void anhyst_tracking_allocate(double net, double idle, double force[ANHYST_TRACKING_MAGNETS])
{
  const double larger = sqrt(0.25 * net * net + idle * idle) + 0.5 * fabs(net);
  const double smaller = idle * idle / larger;
  force[0] = net >= 0.0 ? larger : smaller;
  force[1] = net >= 0.0 ? smaller : larger;
}

static double control(anhyst_tracking *c, double error)
{
  const double force = c->forward[0] * error + c->state[0];
  c->state[0] = c->forward[1] * error - c->back[0] * force + c->state[1];
  c->state[1] = c->forward[2] * error - c->back[1] * force;
  return force;
}

void anhyst_tracking_tick(void *self, const anhyst_loop_sample *sample, anhyst_loop_answer *answer)
{
  anhyst_tracking *c = self;
  const double gap[ANHYST_TRACKING_MAGNETS] = {sample->head[0], c->gap_total - sample->head[0]};
  const double net = control(c, sample->position[0] - sample->target[0]) + sample->load[0];
  double force[ANHYST_TRACKING_MAGNETS];
  int j;
  if (c->by_halves) {
    force[0] = c->idle + 0.5 * net;
    force[1] = c->idle - 0.5 * net;
  } else {
    anhyst_tracking_allocate(net, c->idle, force);
  }
  for (j = 0; j < ANHYST_TRACKING_MAGNETS && j < sample->magnets; j++) {
    const anhyst_tracking_drive *drive = &c->drive[j];
    answer->current[j] = anhyst_plant_convert(
        drive->solve(drive->self, &drive->scales, force[j], gap[j], sample->flux[j]),
        c->current_low, c->current_high, c->current_step);
    drive->commit(drive->self, &drive->scales, answer->current[j], gap[j]);
  }
  answer->reference[0] = sample->target[0];
  answer->demand[0] = net;
}
