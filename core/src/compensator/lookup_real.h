/* SPDX-License-Identifier: Apache-2.0 */
/* Interpolation in both precisions. */
#ifndef ANHYST_LOOKUP_REAL_H
#define ANHYST_LOOKUP_REAL_H

#include "lookup_f32.h"
#include "lookup_f64.h"

#endif
