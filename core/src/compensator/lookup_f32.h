/* SPDX-License-Identifier: Apache-2.0 */
/* Limits a number to a range, in single precision. */
#ifndef ANHYST_LOOKUP_F32_H
#define ANHYST_LOOKUP_F32_H

#include <stdint.h>

#include "anhyst/numeric/f32.h"
#include "generic/lookup.h"
#include "anhyst/numeric/no_format.h"

#endif
