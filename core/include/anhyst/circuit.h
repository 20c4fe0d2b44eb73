/* SPDX-License-Identifier: Apache-2.0 */
/* Physical quantities: drive to flux density and back, through a gap, with eddy currents.
   Declarations are in generic/circuit.h. */
#ifndef ANHYST_CIRCUIT_H
#define ANHYST_CIRCUIT_H

#include <stddef.h>

#include "anhyst/solver.h"

/* Permeability of free space, V s/(A m). */
#define ANHYST_MU0 1.2566370614359173e-6

#ifdef __cplusplus
extern "C" {
#endif

#include "anhyst/f64.h"
#include "anhyst/generic/circuit.h"
#include "anhyst/f32.h"
#include "anhyst/generic/circuit.h"
#include "anhyst/no_format.h"

#ifdef __cplusplus
}
#endif
#endif
