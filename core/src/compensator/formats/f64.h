/* SPDX-License-Identifier: Apache-2.0 */
/* Types of double precision, for the templates of the laws in ../generic. */
#ifndef ANHYST_FORMAT_F64_H
#define ANHYST_FORMAT_F64_H

#include "anhyst/compensator/compensator_f64.h"

typedef double number;      /* a field, a flux, a current */
typedef double entry;       /* a word of a block */
typedef uint64_t bits_type; /* the bits of a word */
typedef anhyst_arms_f64 arms_type;
typedef anhyst_candidate_f64 candidate;
typedef anhyst_memory_f64 memory_type;
typedef anhyst_full_memory_f64 full_memory;
typedef anhyst_simplified_memory_f64 simplified_memory;
typedef anhyst_cells_memory_f64 cells_memory;
typedef anhyst_compensator_f64 compensator;
typedef anhyst_kernel_f64 kernel_type;

#define NUMBER_EPS 2.220446049250313e-16 /* distance from 1 to the next larger number */

#include "../generic/real.h"
#endif
