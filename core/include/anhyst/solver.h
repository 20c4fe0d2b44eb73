/* SPDX-License-Identifier: Apache-2.0 */
/* The one scalar equation x + omega*m(x) = r. Declarations are in generic/solver.h. */
#ifndef ANHYST_SOLVER_H
#define ANHYST_SOLVER_H

#include "anhyst/operator.h"

#ifdef __cplusplus
extern "C" {
#endif

#include "anhyst/f64.h"
#include "anhyst/generic/solver.h"
#include "anhyst/f32.h"
#include "anhyst/generic/solver.h"
#include "anhyst/no_format.h"

#ifdef __cplusplus
}
#endif
#endif
