/* SPDX-License-Identifier: Apache-2.0 */

static double ANHYST_NAME(solve)(anhyst_force_controller_f64 *c, double demand, double gap,
                                 double flux)
{
  const ANHYST_NAME(anhyst_tracking_drive) *drive = c->own;
  const anhyst_tracking_scales *scales = &drive->scales;
  const ANHYST_REAL current = ANHYST_NAME(anhyst_force_controller_solve)(
      drive->force, ANHYST_NAME(code)(demand, scales->demand), ANHYST_NAME(gap_code)(gap, scales),
      ANHYST_NAME(flux_code)(flux, scales->flux));
  c->flags = drive->force->flags;
  return ANHYST_NAME(value)(current, scales->current);
}

static double ANHYST_NAME(commit)(anhyst_force_controller_f64 *c, double applied, double gap)
{
  const ANHYST_NAME(anhyst_tracking_drive) *drive = c->own;
  const anhyst_tracking_scales *scales = &drive->scales;
  const ANHYST_REAL force = ANHYST_NAME(anhyst_force_controller_commit)(
      drive->force, ANHYST_NAME(code)(applied, scales->current),
      ANHYST_NAME(gap_code)(gap, scales));
  return ANHYST_NAME(value)(force, scales->demand);
}

void ANHYST_NAME(anhyst_tracking_drive_init)(anhyst_force_controller_f64 *c,
                                             ANHYST_NAME(anhyst_tracking_drive) *drive)
{
  /* Nothing else is asked of a drive. */
  static const anhyst_force_method_f64 by_drive = {.solve = ANHYST_NAME(solve),
                                                   .commit = ANHYST_NAME(commit)};
  const anhyst_force_controller_f64 fresh = {.method = &by_drive, .own = drive};
  *c = fresh;
}
