/* SPDX-License-Identifier: Apache-2.0 */

/* In floating point, the signals are SI values without conversion. */

static inline ANHYST_REAL ANHYST_NAME(code)(double value, double full)
{
  (void)full;
  return (ANHYST_REAL)value;
}

static inline ANHYST_REAL ANHYST_NAME(flux)(double value, double full)
{
  return ANHYST_NAME(code)(value, full);
}

static inline ANHYST_REAL ANHYST_NAME(measured)(double value, double full)
{
  return ANHYST_NAME(code)(value, full);
}

static inline double ANHYST_NAME(value)(ANHYST_REAL code, double full)
{
  (void)full;
  return (double)code;
}
