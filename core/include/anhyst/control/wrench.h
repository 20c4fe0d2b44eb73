/* SPDX-License-Identifier: Apache-2.0 */
/* Allocation of a wrench (forces and moments on a body) to drives that only pull or that act in
   both directions; in floating point.

   Two drives that pull against each other on one line are a pair. The net force of a pair may have
   either sign; allocation.h divides this force between the two drives. A single drive pulls with at
   least a given force, which is negative if the drive also pushes. The result is the forces with
   the least sum of squares that make the wrench. A drive below its minimum is set to the minimum,
   and the others are solved again, as long as they can still make any wrench. The search takes at
   most ANHYST_WRENCH_PASSES passes. Each pass solves as many equations as there are axes.

   A lost drive has no force, and the other drive of its pair becomes a single drive. If the
   remaining drives cannot make the wrench within their bounds, the axes with the largest `yields`
   are given up first. The result then minimises the squares of the forces plus the weighted squares
   of the missing wrench, in the same number of passes. Factorisations are stored for the next
   wrench, which usually needs the same ones. Earlier wrenches change only the run time, not the
   result.

   No function allocates memory. Loops are bounded by the numbers of axes and drives. Declarations:
   generic/wrench.h. */
#ifndef ANHYST_WRENCH_H
#define ANHYST_WRENCH_H

#include "anhyst/control/allocation_real.h"
#include "anhyst/numeric/status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define ANHYST_WRENCH_AXES 6
#define ANHYST_WRENCH_DRIVES 16
#define ANHYST_WRENCH_PASSES 3

#include "anhyst/numeric/f64.h"
#include "anhyst/control/generic/wrench.h"
#include "anhyst/numeric/f32.h"
#include "anhyst/control/generic/wrench.h"
#include "anhyst/numeric/no_format.h"

#ifdef __cplusplus
}
#endif
#endif
