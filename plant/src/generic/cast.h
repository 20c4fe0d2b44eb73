/* SPDX-License-Identifier: Apache-2.0 */

/* In floating point, the signals are SI values without conversion. */

static inline ANHYST_REAL ANHYST_NAME(to_code)(double value, double full)
{
  (void)full;
  return (ANHYST_REAL)value;
}

static inline ANHYST_REAL ANHYST_NAME(flux_to_code)(double value, double full)
{
  return ANHYST_NAME(to_code)(value, full);
}

static inline ANHYST_REAL ANHYST_NAME(current_to_code)(double value, double full)
{
  return ANHYST_NAME(to_code)(value, full);
}

static inline double ANHYST_NAME(from_code)(ANHYST_REAL code, double full)
{
  (void)full;
  return (double)code;
}
