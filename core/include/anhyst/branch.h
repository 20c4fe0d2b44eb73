/* SPDX-License-Identifier: Apache-2.0 */
/* The steady ascending branch of the law, tabulated. Declarations are in generic/branch.h. */
#ifndef ANHYST_BRANCH_H
#define ANHYST_BRANCH_H

#include "anhyst/status.h"

/* Largest |x| (in units of a) the tables cover. */
#define ANHYST_X_MAX 89000.0
/* Range of kappa = k/a. */
#define ANHYST_KAPPA_MIN 1e-3
#define ANHYST_KAPPA_MAX 1e3

/* Layout of the table: even spacing inside, even spacing of ln|x| outside, quintic pieces. */
#define ANHYST_BRANCH_EDGE 30
#define ANHYST_BRANCH_PER_UNIT 8
#define ANHYST_BRANCH_INNER (2 * ANHYST_BRANCH_EDGE * ANHYST_BRANCH_PER_UNIT)
#define ANHYST_BRANCH_PER_LOG 32
#define ANHYST_BRANCH_OUTER (8 * ANHYST_BRANCH_PER_LOG)

#ifdef __cplusplus
extern "C" {
#endif

#include "anhyst/f64.h"
#include "anhyst/generic/branch.h"
#include "anhyst/f32.h"
#include "anhyst/generic/branch.h"
#include "anhyst/no_format.h"

#ifdef __cplusplus
}
#endif
#endif
