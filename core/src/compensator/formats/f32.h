/* SPDX-License-Identifier: Apache-2.0 */
/* Types of single precision, for the templates of the laws in ../generic. */
#ifndef ANHYST_FORMAT_F32_H
#define ANHYST_FORMAT_F32_H

#include "anhyst/compensator/compensator_f32.h"

typedef float number;       /* a field, a flux, a current */
typedef float entry;        /* a word of a block */
typedef uint32_t bits_type; /* the bits of a word */
typedef anhyst_arms_f32 arms_type;
typedef anhyst_candidate_f32 candidate;
typedef anhyst_memory_f32 memory_type;
typedef anhyst_full_memory_f32 full_memory;
typedef anhyst_simplified_memory_f32 simplified_memory;
typedef anhyst_cells_memory_f32 cells_memory;
typedef anhyst_compensator_f32 compensator;
typedef anhyst_kernel_f32 kernel_type;

#define NUMBER_EPS 1.1920929e-7f /* distance from 1 to the next larger number */

#include "../generic/real.h"
#endif
