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

static double ANHYST_NAME(expected)(const anhyst_force_controller_f64 *c, double applied,
                                    double gap)
{
  const ANHYST_NAME(anhyst_tracking_drive) *drive = c->own;
  const anhyst_tracking_scales *scales = &drive->scales;
  const ANHYST_REAL force = ANHYST_NAME(anhyst_force_controller_expected)(
      drive->force, ANHYST_NAME(code)(applied, scales->current),
      ANHYST_NAME(gap_code)(gap, scales));
  return ANHYST_NAME(value)(force, scales->demand);
}

static int32_t ANHYST_NAME(length)(const anhyst_force_controller_f64 *c)
{
  const ANHYST_NAME(anhyst_tracking_drive) *drive = c->own;
  return ANHYST_NAME(anhyst_force_controller_conditioning_length)(drive->force);
}

static double ANHYST_NAME(conditioning)(const anhyst_force_controller_f64 *c, int32_t tick)
{
  const ANHYST_NAME(anhyst_tracking_drive) *drive = c->own;
  return ANHYST_NAME(value)(ANHYST_NAME(anhyst_force_controller_conditioning)(drive->force, tick),
                            drive->scales.current);
}

static void ANHYST_NAME(demagnetise)(anhyst_force_controller_f64 *c)
{
  const ANHYST_NAME(anhyst_tracking_drive) *drive = c->own;
  ANHYST_NAME(anhyst_force_controller_demagnetise)(drive->force);
}

/* A block of double precision is none of this format. */
static void ANHYST_NAME(carry)(anhyst_force_controller_f64 *c, const anhyst_block_f64 *block)
{
  (void)c;
  (void)block;
}

void ANHYST_NAME(anhyst_tracking_drive_init)(anhyst_force_controller_f64 *c,
                                             ANHYST_NAME(anhyst_tracking_drive) *drive)
{
  static const anhyst_force_method_f64 by_drive = {
      ANHYST_NAME(solve),  ANHYST_NAME(commit),       ANHYST_NAME(expected),
      ANHYST_NAME(length), ANHYST_NAME(conditioning), ANHYST_NAME(demagnetise),
      ANHYST_NAME(carry)};
  const anhyst_force_controller_f64 fresh = {.method = &by_drive, .own = drive};
  *c = fresh;
}
