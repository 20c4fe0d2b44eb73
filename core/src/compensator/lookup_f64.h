/* SPDX-License-Identifier: Apache-2.0 */
/* Limits a number to a range, in double precision. */
#ifndef ANHYST_LOOKUP_F64_H
#define ANHYST_LOOKUP_F64_H

#include <stdint.h>

#include "anhyst/numeric/f64.h"
#include "generic/lookup.h"
#include "anhyst/numeric/no_format.h"

#endif
