/* SPDX-License-Identifier: Apache-2.0 */
/* From the code of a sensor or counter to a value: (code - zero)*mantissa/2^shift.

   Format     codes are any 32-bit numbers; values are what the caller counts in (q30, q31).
   Rounding   to the nearest, halves upwards. Exact otherwise: error at most half a unit.
   Saturation at -2147483647 and 2147483647, so that no value is CALIBRATION_NONE. */
#ifndef ANHYST_SERVICES_CALIBRATION_H
#define ANHYST_SERVICES_CALIBRATION_H

#include <stdint.h>

/* Instead of a value: the code is none of a value. The same as PORT_RESERVED. */
#define CALIBRATION_NONE INT32_MIN

#define CALIBRATION_MANTISSA_MOST ((int32_t)1073741824) /* 2^30, of either sign */
#define CALIBRATION_SHIFT_MOST 46

typedef struct {
  int32_t zero;     /* code whose value is 0 */
  int32_t mantissa; /* at most CALIBRATION_MANTISSA_MOST in size, not 0 */
  int32_t shift;    /* 0..CALIBRATION_SHIFT_MOST */
  int32_t low;      /* codes below low or above high are none of a value: a broken wire */
  int32_t high;     /* above low */
} calibration;

/* Whether a calibration is within its ranges. */
int calibration_is_valid(const calibration *c);

/* The value of a code, or CALIBRATION_NONE. */
int32_t calibration_value(const calibration *c, int32_t code);

#endif
