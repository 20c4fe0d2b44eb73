/* SPDX-License-Identifier: Apache-2.0 */

/* In floating point the signals are SI as they are. */

static ANHYST_REAL ANHYST_NAME(code)(double value, double full)
{
  (void)full;
  return (ANHYST_REAL)value;
}

static ANHYST_REAL ANHYST_NAME(flux_code)(double value, double full)
{
  return ANHYST_NAME(code)(value, full);
}

static ANHYST_REAL ANHYST_NAME(gap_code)(double gap, const anhyst_tracking_scales *scales)
{
  (void)scales;
  return (ANHYST_REAL)gap;
}

static double ANHYST_NAME(value)(ANHYST_REAL code, double full)
{
  (void)full;
  return (double)code;
}
