/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/drive.h"

static int factor_sound(anhyst_factor factor)
{
  return factor.shift >= ANHYST_PIDD2_SHIFT_LOW && factor.shift <= ANHYST_PIDD2_SHIFT_HIGH;
}

static int loop_sound(const anhyst_flux_loop_q31 *loop)
{
  return anhyst_map_check_q31(&loop->wanted) == ANHYST_OK && factor_sound(loop->proportional) &&
         factor_sound(loop->integral) && factor_sound(loop->back) && loop->back.mantissa >= 0 &&
         loop->smoothing.mantissa <= 0 && loop->smoothing.shift >= 0 && loop->smoothing.shift <= 1;
}

static anhyst_drive_q31 fresh(uint16_t kind)
{
  anhyst_drive_q31 drive = {0};
  drive.kind = kind;
  return drive;
}

anhyst_status anhyst_drive_init_map_q31(anhyst_drive_q31 *drive, const anhyst_map_q31 *map,
                                        int32_t low, int32_t high)
{
  if (anhyst_map_check_q31(map) != ANHYST_OK || low > high) {
    return ANHYST_BAD_PARAMETER;
  }
  *drive = fresh(ANHYST_DRIVE_MAP);
  drive->map = map;
  drive->low = low;
  drive->high = high;
  return ANHYST_OK;
}

anhyst_status anhyst_drive_init_compensator_q31(anhyst_drive_q31 *drive,
                                                const anhyst_kernel *kernel, const int16_t *words,
                                                uint16_t capacity)
{
  anhyst_drive_q31 found = fresh(ANHYST_DRIVE_COMPENSATOR);
  const anhyst_status status = anhyst_compensator_init(&found.compensator, kernel, words, capacity);
  if (status == ANHYST_OK) {
    *drive = found;
  }
  return status;
}

anhyst_status anhyst_drive_init_flux_q31(anhyst_drive_q31 *drive, const anhyst_map_q31 *map,
                                         const anhyst_flux_loop_q31 *loop, int32_t low,
                                         int32_t high)
{
  if (!loop_sound(loop) || anhyst_drive_init_map_q31(drive, map, low, high) != ANHYST_OK) {
    return ANHYST_BAD_PARAMETER;
  }
  drive->kind = ANHYST_DRIVE_FLUX;
  drive->loop = loop;
  return ANHYST_OK;
}

/* What the measured flux adds to the current. Compared is what should show by now, not what is
   wanted: the difference between those is delay, which no current removes. Halved, so that no
   difference leaves the format. */
static void correct(anhyst_drive_q31 *drive, int32_t gap, int32_t flux)
{
  drive->correction = 0;
  if (drive->kind == ANHYST_DRIVE_FLUX) {
    drive->flux = anhyst_map_value_q31(&drive->loop->wanted, drive->demand, gap) >> 1;
    drive->error = flux == ANHYST_NO_FLUX ? 0 : drive->expected - (flux >> 1);
    const int32_t half = anhyst_add_q31(
        drive->integral, anhyst_pidd2_product(drive->error, drive->loop->proportional));
    drive->correction = anhyst_shl_q31(half, 1);
  }
}

int32_t anhyst_drive_solve_q31(anhyst_drive_q31 *drive, int32_t demand, int32_t gap, int32_t flux)
{
  drive->solved = 1;
  if (drive->kind == ANHYST_DRIVE_COMPENSATOR) {
    drive->demand = demand;
    drive->current = anhyst_compensator_solve_q31(&drive->compensator, demand, gap);
    drive->flags = drive->compensator.flags;
    return drive->current;
  }
  drive->demand = demand > 0 ? demand : 0;
  drive->flags = 0;
  if (drive->demand != demand) {
    drive->flags |= ANHYST_DEMAND_LIMITED;
  }
  correct(drive, gap, flux);
  drive->wanted =
      anhyst_add_q31(anhyst_map_value_q31(drive->map, drive->demand, gap), drive->correction);
  drive->current = anhyst_clamp(drive->wanted, drive->low, drive->high);
  if (drive->current != drive->wanted) {
    drive->flags |= ANHYST_CURRENT_LIMITED;
  }
  return drive->current;
}

/* What the compensator expects, beside what it expected of the solved current: both have the error
   of the way back from flux to force, which must not reach the integral of whoever asked. */
static int32_t commit_compensator(anhyst_drive_q31 *drive, int32_t applied, int32_t gap)
{
  anhyst_compensator *c = &drive->compensator;
  c->flux_applied = c->flux;
  const int32_t solved = anhyst_compensator_output_q31(c);
  anhyst_compensator_commit_q31(c, applied, gap);
  const int32_t output = anhyst_compensator_output_q31(c);
  const uint16_t other = ANHYST_DEMAND_LIMITED | ANHYST_FLUX_LIMITED;
  if (drive->solved == 0U || (drive->flags & other) != 0U) {
    return output;
  }
  return anhyst_add_q31(drive->demand, anhyst_sub_q31(output, solved));
}

/* Only a limit leads the integral back: a current that was measured differs from the wanted one by
   the error of its sensor too, and by how far the amplifier is behind. */
static void advance_flux(anhyst_drive_q31 *drive, int32_t applied)
{
  const anhyst_flux_loop_q31 *loop = drive->loop;
  const int32_t behind = drive->expected - drive->flux;
  int32_t learnt = anhyst_pidd2_product(drive->error, loop->integral);
  if ((drive->flags & ANHYST_CURRENT_LIMITED) != 0U) {
    const int32_t missing = (applied >> 1) - (drive->wanted >> 1);
    learnt = anhyst_add_q31(learnt, anhyst_pidd2_product(missing, loop->back));
  }
  drive->expected += anhyst_pidd2_product(behind, loop->smoothing);
  drive->integral = anhyst_add_q31(drive->integral, learnt);
}

int32_t anhyst_drive_commit_q31(anhyst_drive_q31 *drive, int32_t applied, int32_t gap)
{
  int32_t output = drive->demand;
  if (drive->kind == ANHYST_DRIVE_COMPENSATOR) {
    output = commit_compensator(drive, applied, gap);
  } else if (drive->solved == 0U) {
    const int32_t held = anhyst_shl_q31(drive->integral, 1);
    output = anhyst_map_force_q31(drive->map, anhyst_sub_q31(applied, held), gap);
  } else if (applied != drive->wanted) {
    output = anhyst_map_force_q31(drive->map, anhyst_sub_q31(applied, drive->correction), gap);
  }
  if (drive->kind == ANHYST_DRIVE_FLUX && drive->solved != 0U) {
    advance_flux(drive, applied);
  }
  drive->solved = 0;
  return output;
}

int32_t anhyst_drive_conditioning_length_q31(const anhyst_drive_q31 *drive)
{
  return drive->kind == ANHYST_DRIVE_COMPENSATOR ? anhyst_conditioning_length(&drive->compensator)
                                                 : 0;
}

int32_t anhyst_drive_conditioning_q31(const anhyst_drive_q31 *drive, int32_t tick)
{
  return drive->kind == ANHYST_DRIVE_COMPENSATOR
             ? anhyst_conditioning_q31(&drive->compensator, tick)
             : 0;
}
