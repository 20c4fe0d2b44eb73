/* SPDX-License-Identifier: Apache-2.0 */

double ANHYST_NAME(anhyst_tracking_solve)(void *self, const anhyst_tracking_scales *scales,
                                          double force, double gap, double flux)
{
  const ANHYST_REAL current = ANHYST_NAME(anhyst_force_controller_solve)(
      self, ANHYST_NAME(code)(force, scales->demand), ANHYST_NAME(gap_code)(gap, scales),
      ANHYST_NAME(flux_code)(flux, scales->flux));
  return ANHYST_NAME(value)(current, scales->current);
}

void ANHYST_NAME(anhyst_tracking_commit)(void *self, const anhyst_tracking_scales *scales,
                                         double applied, double gap)
{
  (void)ANHYST_NAME(anhyst_force_controller_commit)(
      self, ANHYST_NAME(code)(applied, scales->current), ANHYST_NAME(gap_code)(gap, scales));
}
