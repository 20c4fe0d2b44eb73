/* SPDX-License-Identifier: Apache-2.0 */
/* Converts the code of a sensor or counter to a value: (code - zero)*mantissa/2^shift.

   Codes are any 32-bit numbers. The caller chooses the unit of the values (q30, q31). Values are
   rounded to the nearest one, halves upwards, with an error of at most half a unit. They saturate
   at -2147483647 and 2147483647, so that no result equals CALIBRATION_NONE. */
#ifndef ANHYST_SERVICES_CALIBRATION_H
#define ANHYST_SERVICES_CALIBRATION_H

#include <stdint.h>

/* Result for a code outside low..high, without a valid value. Equal to PORT_RESERVED. */
#define CALIBRATION_NONE INT32_MIN

#define CALIBRATION_MAX_MANTISSA ((int32_t)1073741824) /* largest magnitude of a mantissa, 2^30 */
#define CALIBRATION_MAX_SHIFT 46

typedef struct {
  int32_t zero;     /* code whose value is 0 */
  int32_t mantissa; /* nonzero; magnitude at most CALIBRATION_MAX_MANTISSA */
  int32_t shift;    /* 0..CALIBRATION_MAX_SHIFT */
  int32_t low;      /* codes below `low` or above `high` are invalid (broken wire) */
  int32_t high;     /* greater than `low` */
} calibration;

/* Whether all fields of a calibration are in their ranges. */
int calibration_is_valid(const calibration *c);

/* Returns the value of a code, or CALIBRATION_NONE if the code is outside `low`..`high`. */
int32_t calibration_value(const calibration *c, int32_t code);

#endif
