/* SPDX-License-Identifier: Apache-2.0 */
/* The number format a test program is compiled for; include it after the core's headers. */
#ifndef TEST_FORMAT_H
#define TEST_FORMAT_H

#ifdef TEST_f32
#include "anhyst/f32.h"
#define EITHER(double_value, single_value) (single_value)
#else
#include "anhyst/f64.h"
#define EITHER(double_value, single_value) (double_value)
#endif

typedef ANHYST_REAL real;

#endif
