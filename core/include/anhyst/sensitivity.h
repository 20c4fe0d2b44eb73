/* SPDX-License-Identifier: Apache-2.0 */
/* Derivatives of the path with respect to every parameter. Declarations are in generic/sensitivity.h. */
#ifndef ANHYST_SENSITIVITY_H
#define ANHYST_SENSITIVITY_H

#include <stddef.h>

#include "anhyst/solver.h"

#ifdef __cplusplus
extern "C" {
#endif

#include "anhyst/f64.h"
#include "anhyst/generic/sensitivity.h"
#include "anhyst/f32.h"
#include "anhyst/generic/sensitivity.h"
#include "anhyst/no_format.h"

#ifdef __cplusplus
}
#endif
#endif
