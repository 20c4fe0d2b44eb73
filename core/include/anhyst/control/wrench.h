/* SPDX-License-Identifier: Apache-2.0 */
/* How a wanted wrench, forces and moments on a body, is shared out to drives that only pull, or to
   drives that go both ways; in floating point.

   Two drives that pull against each other on one line are a pair: its net force is free in sign,
   and the pair shares it out as allocation.h says. A drive that stands alone pulls at least a given
   force, which is below zero where it pushes too. The forces are those of least squares that make
   the wrench; what would pull less than its least is set to it and the rest is found again, as long
   as the others can still make any wrench, in at most ANHYST_WRENCH_PASSES passes. Each pass solves
   as many equations as there are axes.

   A drive that is lost pulls nothing; one that it pulled against stands alone from then on. What
   the others do not make within their bounds is then given up along the axes that yield most: the
   forces are those of least squares of what is missing, each axis by what it yields, and of the
   forces, in so many passes too. What a pass has to solve is kept for the next wrench, which mostly
   asks for the same again: only time depends on what was asked before.

   Nothing here allocates memory; loops are bounded by the numbers of axes and drives. Declarations
   are in generic/wrench.h. */
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
