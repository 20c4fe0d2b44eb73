/* SPDX-License-Identifier: Apache-2.0 */

static int ANHYST_NAME(is_finite)(ANHYST_REAL a) { return a >= R(-1e30) && a <= R(1e30); }

/* At rest, without the parameters. */
static ANHYST_NAME(anhyst_drive) ANHYST_NAME(fresh)(uint16_t kind)
{
  ANHYST_NAME(anhyst_drive) drive = {0};
  drive.kind = kind;
  return drive;
}

anhyst_status ANHYST_NAME(anhyst_drive_init_map)(ANHYST_NAME(anhyst_drive) *drive,
                                                 const ANHYST_NAME(anhyst_map) *map,
                                                 ANHYST_REAL low, ANHYST_REAL high)
{
  if (ANHYST_NAME(anhyst_map_check)(map) != ANHYST_OK || !ANHYST_NAME(is_finite)(low) ||
      !ANHYST_NAME(is_finite)(high) || low > high) {
    return ANHYST_BAD_PARAMETER;
  }
  *drive = ANHYST_NAME(fresh)(ANHYST_DRIVE_MAP);
  drive->map = map;
  drive->low = low;
  drive->high = high;
  return ANHYST_OK;
}

anhyst_status ANHYST_NAME(anhyst_drive_init_compensator)(
    ANHYST_NAME(anhyst_drive) *drive, const ANHYST_NAME(anhyst_parameters) *parameters)
{
  ANHYST_NAME(anhyst_drive) found = ANHYST_NAME(fresh)(ANHYST_DRIVE_COMPENSATOR);
  const anhyst_status status = ANHYST_NAME(anhyst_compensator_init)(&found.compensator, parameters);
  if (status == ANHYST_OK) {
    *drive = found;
  }
  return status;
}

anhyst_status ANHYST_NAME(anhyst_drive_init_flux)(ANHYST_NAME(anhyst_drive) *drive,
                                                  const ANHYST_NAME(anhyst_map) *map,
                                                  const ANHYST_NAME(anhyst_flux_loop) *loop,
                                                  ANHYST_REAL low, ANHYST_REAL high)
{
  const int sound = ANHYST_NAME(anhyst_map_check)(&loop->wanted) == ANHYST_OK &&
                    ANHYST_NAME(is_finite)(loop->proportional) &&
                    ANHYST_NAME(is_finite)(loop->integral) && loop->back >= R(0.0) &&
                    loop->back <= R(1.0) && loop->smoothing > R(0.0) && loop->smoothing <= R(1.0);
  if (!sound || ANHYST_NAME(anhyst_drive_init_map)(drive, map, low, high) != ANHYST_OK) {
    return ANHYST_BAD_PARAMETER;
  }
  drive->kind = ANHYST_DRIVE_FLUX;
  drive->loop = loop;
  return ANHYST_OK;
}

/* What the measured flux adds to the current. Compared is what should show by now, not what is
   wanted: the difference between those is delay, which no current removes. */
static void ANHYST_NAME(correct)(ANHYST_NAME(anhyst_drive) *drive, ANHYST_REAL gap,
                                 ANHYST_REAL flux)
{
  drive->correction = R(0.0);
  if (drive->kind == ANHYST_DRIVE_FLUX) {
    drive->flux = ANHYST_NAME(anhyst_map_value)(&drive->loop->wanted, drive->demand, gap);
    drive->error = ANHYST_NAME(is_finite)(flux) ? drive->expected - flux : R(0.0);
    drive->correction = drive->loop->proportional * drive->error + drive->integral;
  }
}

ANHYST_REAL ANHYST_NAME(anhyst_drive_solve)(ANHYST_NAME(anhyst_drive) *drive, ANHYST_REAL demand,
                                            ANHYST_REAL gap, ANHYST_REAL flux)
{
  drive->solved = 1;
  if (drive->kind == ANHYST_DRIVE_COMPENSATOR) {
    drive->demand = demand;
    drive->current = ANHYST_NAME(anhyst_compensator_solve)(&drive->compensator, demand, gap);
    drive->flags = drive->compensator.flags;
    return drive->current;
  }
  drive->demand = ANHYST_NAME(anhyst_limited)(demand, R(0.0), drive->map->force_high);
  drive->flags = 0;
  if (drive->demand != demand) {
    drive->flags |= ANHYST_DEMAND_LIMITED;
  }
  ANHYST_NAME(correct)(drive, gap, flux);
  drive->wanted = ANHYST_NAME(anhyst_map_value)(drive->map, drive->demand, gap) + drive->correction;
  drive->current = ANHYST_NAME(anhyst_limited)(drive->wanted, drive->low, drive->high);
  if (drive->current != drive->wanted) {
    drive->flags |= ANHYST_CURRENT_LIMITED;
  }
  return drive->current;
}

/* What the compensator expects, beside what it expected of the solved current: both have the error
   of the way back from flux to force, which must not reach the integral of whoever asked. */
static ANHYST_REAL ANHYST_NAME(commit_compensator)(ANHYST_NAME(anhyst_drive) *drive,
                                                   ANHYST_REAL applied, ANHYST_REAL gap)
{
  ANHYST_NAME(anhyst_compensator) *c = &drive->compensator;
  c->flux_applied = c->flux;
  const ANHYST_REAL solved = ANHYST_NAME(anhyst_compensator_output)(c);
  ANHYST_NAME(anhyst_compensator_commit)(c, applied, gap);
  const ANHYST_REAL output = ANHYST_NAME(anhyst_compensator_output)(c);
  const uint16_t other = ANHYST_DEMAND_LIMITED | ANHYST_FLUX_LIMITED;
  if (drive->solved == 0U || (drive->flags & other) != 0U) {
    return output;
  }
  return drive->demand + (output - solved);
}

/* Only a limit leads the integral back: a current that was measured differs from the wanted one by
   the error of its sensor too, and by how far the amplifier is behind. */
static void ANHYST_NAME(advance_flux)(ANHYST_NAME(anhyst_drive) *drive, ANHYST_REAL applied)
{
  const ANHYST_NAME(anhyst_flux_loop) *loop = drive->loop;
  drive->expected += loop->smoothing * (drive->flux - drive->expected);
  drive->integral += loop->integral * drive->error;
  if ((drive->flags & ANHYST_CURRENT_LIMITED) != 0U) {
    drive->integral += loop->back * (applied - drive->wanted);
  }
}

ANHYST_REAL ANHYST_NAME(anhyst_drive_commit)(ANHYST_NAME(anhyst_drive) *drive, ANHYST_REAL applied,
                                             ANHYST_REAL gap)
{
  ANHYST_REAL output = drive->demand;
  if (drive->kind == ANHYST_DRIVE_COMPENSATOR) {
    output = ANHYST_NAME(commit_compensator)(drive, applied, gap);
  } else if (drive->solved == 0U) {
    output = ANHYST_NAME(anhyst_map_force)(drive->map, applied - drive->integral, gap);
  } else if (applied != drive->wanted) {
    output = ANHYST_NAME(anhyst_map_force)(drive->map, applied - drive->correction, gap);
  }
  if (drive->kind == ANHYST_DRIVE_FLUX && drive->solved != 0U) {
    ANHYST_NAME(advance_flux)(drive, applied);
  }
  drive->solved = 0;
  return output;
}

int32_t ANHYST_NAME(anhyst_drive_conditioning_length)(const ANHYST_NAME(anhyst_drive) *drive)
{
  return drive->kind == ANHYST_DRIVE_COMPENSATOR
             ? ANHYST_NAME(anhyst_conditioning_length)(&drive->compensator)
             : 0;
}

ANHYST_REAL ANHYST_NAME(anhyst_drive_conditioning)(const ANHYST_NAME(anhyst_drive) *drive,
                                                   int32_t tick)
{
  return drive->kind == ANHYST_DRIVE_COMPENSATOR
             ? ANHYST_NAME(anhyst_conditioning)(&drive->compensator, tick)
             : R(0.0);
}
